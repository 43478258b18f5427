"""Hysteresis of the tip over the pressure, per actuator, at two rates; fatigue is measured with the same cycles."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Optional, Sequence, Tuple, Union

import numpy as np

from helix_arm.experiments.figures import Figure, jackknife, of_repeats
from helix_arm.experiments.protocol import BASE, Analysis, Course, Curve, Options, Plot, Recordings, Trial, driven
from helix_arm.experiments.rig import Recording, Rig
from helix_arm.scene import Scene

REPEATS, SLOW_S, FAST_S, TOP = 5, 32.0, 8.0, 0.8  # periods of the cycles; TOP: share of the range
BINS, PICTURES, FEWEST = 32, 4, 6  # parts of a branch: most; pictures in each, by which short branches have fewer; least
NODES, DEGREE = np.linspace(0.2, 0.8, 25), 8  # parts of the range where branches are compared; polynomial through their distance
LEAST = 0.5  # of the largest range, that a cycle has


def cycles_course(course: Course, low: np.ndarray, high: np.ndarray, cycles: int, period_s: float) -> Course:
    for _ in range(cycles):
        course.go(high, period_s / 2).go(low, period_s / 2)
    return course


def plan(rig: Rig, scene: Scene, options: Options) -> List[Trial]:
    """Triangles of the pressure: a cycle that conditions, then the repeats, slowly and four times as fast."""
    repeats, slow, trials = options.repeats or REPEATS, options.hold_s or SLOW_S, []
    for actuator in options.actuators:
        course = Course(rig)
        low, high = course.drive(actuator, BASE), course.drive(actuator, TOP)
        course.go(low).hold(2 * options.settle_s)
        for period in (slow, slow * FAST_S / SLOW_S):
            cycles_course(course, low, high, repeats + 1, period)
        trials.append(Trial(scene.actuators[actuator], course.inputs()))
    return trials


@dataclass(frozen=True)
class Cycle:
    """Branches over the pressures of its nodes.

    pressure: (NODES,) [Pa]. up, down: (NODES,) along the stroke [m]. stroke: [m]. gap: difference of the pressures of down and up
    at half of the stroke [Pa], negative where falling pressures act later. rate: mean rate of the pressure [Pa/s].
    """

    pressure: np.ndarray
    up: np.ndarray
    down: np.ndarray
    stroke: float
    gap: float
    rate: float
    period: float

    def width(self) -> np.ndarray:
        """(NODES,) by which the falling branch is ahead of the rising one, in parts of the stroke."""
        return (self.down - self.up) / self.stroke


def turns_of(pressure: np.ndarray) -> List[Tuple[int, int, int]]:
    """Rows at which each cycle begins, turns at its top and ends. Between tops the pressure falls by LEAST of its range."""
    reach = LEAST * float(np.ptp(pressure))
    tops, best, rising = [], 0, True
    for row, value in enumerate(pressure):
        if value > pressure[best] if rising else value < pressure[best]:
            best = row
        elif abs(value - pressure[best]) > reach:
            if rising:
                tops.append(best)
            rising, best = not rising, row
    lows = [a + int(np.argmin(pressure[a:b])) for a, b in zip(tops, tops[1:])]
    if not lows:
        return []
    low, near = float(np.median(pressure[lows])), 0.01 * float(np.ptp(pressure))
    before, after = np.flatnonzero(pressure[:tops[0]] <= low + near), np.flatnonzero(pressure[tops[-1]:] <= low + near)
    begins = ([int(before[-1])] if len(before) else []) + lows
    rest = 1 - near / (pressure[tops[-1]] - low)  # of the way down, that is gone where it is near
    ends = lows + ([min(tops[-1] + round(after[0] / rest), len(pressure) - 1)] if len(after) else [])
    first = 0 if len(before) else 1  # the first top may have no begin
    return list(zip(begins, tops[first:], ends[first:]))


def _branch(recording: Recording, pressure: np.ndarray, rows: slice) -> Tuple[np.ndarray, np.ndarray]:
    """(k,) pressures and (k, 3) tips, of lines through parts of the time at their middles, and of the last one at the turn; parts
    with fewer than three pictures are left out, and all where the last one is such a part."""
    time, seen = recording.time_s[rows], recording.seen()[rows]
    edges = np.linspace(time[0], time[-1], min(BINS, max(int(seen.sum() / PICTURES), FEWEST)) + 1)
    values = np.column_stack([pressure[rows], recording.tip_m[rows]])
    middles = []
    for begin, end in zip(edges, edges[1:]):
        near = seen & (time >= begin) & (time <= end)
        line = np.polyfit(time[near] - (begin + end) / 2, values[near], 1) if near.sum() >= 3 else None
        if line is not None:
            middles.append(line[1])
    found = np.array([*middles, line[1] + line[0] * (edges[-1] - edges[-2]) / 2] if line is not None else []).reshape(-1, 4)
    return found[:, 0], found[:, 1:]


def cycles_of(recording: Recording) -> List[Cycle]:
    """Whole cycles of the actuator that moves most, in their order; tips are projected on the chord of the first one."""
    actuator, command = driven(recording)
    measured, time = recording.measured_pa[:, actuator], recording.time_s
    out, chord = [], None
    for begin, top, end in turns_of(command):
        (up_p, up_x), (down_p, down_x) = (_branch(recording, measured, slice(*ends)) for ends in ((begin, top + 1), (top, end + 1)))
        if min(len(up_p), len(down_p)) <= FEWEST:
            continue
        if chord is None:
            chord = (up_x[-1] - down_x[-1]) / np.linalg.norm(up_x[-1] - down_x[-1])
        up_s, down_s = up_x @ chord, down_x @ chord
        nodes = down_p[-1] + NODES * (up_p[-1] - down_p[-1])
        stroke, half = float(up_s[-1] - down_s[-1]), float(up_s[-1] + down_s[-1]) / 2
        gap = float(_over(up_s, up_p, half) - _over(down_s, down_p, half))
        out.append(Cycle(nodes, _over(up_p, up_s, nodes), _over(down_p, down_s, nodes), stroke, gap,
                         2 * float(np.ptp(command[begin:end])) / (time[end] - time[begin]), time[end] - time[begin]))
    return out


def _over(x: np.ndarray, y: np.ndarray, wanted: Union[float, np.ndarray]) -> Any:
    order = np.argsort(x)
    return np.interp(wanted, x[order], y[order])


def loop_width(cycles: Sequence[Cycle]) -> Tuple[float, float]:
    """Largest width of the loop [% of the stroke], of a polynomial through the nodes."""
    powers = np.vander(NODES - 0.5, DEGREE + 1)
    smooth = powers @ np.linalg.pinv(powers)
    return jackknife(cycles, lambda some: 100 * float(np.max(smooth @ np.mean([one.width() for one in some], axis=0))))


def analyse(recordings: Recordings, names: Sequence[str], scene: Optional[Scene] = None) -> Analysis:
    """recordings: triangles or sines of one actuator each, at one rate or several. The first cycle at each rate conditions."""
    out = Analysis()
    for trial, recording in recordings.items():
        name, found = names[driven(recording)[0]], cycles_of(recording)
        rates: List[List[Cycle]] = []
        for cycle in found:
            if not rates or abs(cycle.period / rates[-1][0].period - 1) > 0.1:
                rates.append([])
            rates[-1].append(cycle)
        rates = sorted((one[1:] for one in rates if len(one) > 2), key=lambda one: one[0].rate)
        if not rates:
            why = f"fewer than two cycles of it alone after the first one in {trial}; record triangles of its pressure, as helix_arm " \
                "experiment hysteresis does."
            out.figures.append(Figure.unknown(f"{name} loop width", "H", "%", why))
            continue
        for cycles in rates:
            out.figures.append(Figure(
                f"{name} loop width at {cycles[0].period:.3g} s", "H", *loop_width(cycles), "%",
                "Largest difference of the tip, along the chord of its motion, between falling and rising pressure, from 20 to 80 % "
                "of the range of the measured pressure, in parts of the stroke (hysteresis error of IEC 61298-2, with dead band); "
                "jackknife over the cycles."))
        out.figures.append(Figure(f"{name} stroke", "S", *of_repeats([1e3 * one.stroke for one in rates[0]]), "mm",
                                  "Distance of the tip between top and end of the slow cycle, along the chord; scatter of the cycles."))
        out.figures += _play_and_lag(name, rates)
        out.plots.append(_plot(name, rates))
    return out


def _play_and_lag(name: str, rates: List[List[Cycle]]) -> List[Figure]:
    if len(rates) < 2 or rates[-1][0].rate < 1.5 * rates[0][0].rate:
        why = "it takes cycles at two rates."
        return [Figure.unknown(f"{name} play", "r", "kPa", why), Figure.unknown(f"{name} lag", "tau", "s", why)]
    pairs = list(zip(rates[0], rates[-1]))  # slow, fast
    lags = [(b.gap - a.gap) / 2 / (b.rate - a.rate) for a, b in pairs]
    plays = [1e-3 * (a.gap / 2 - lag * a.rate) for (a, _), lag in zip(pairs, lags)]
    return [Figure(f"{name} play", "r", *of_repeats(plays), "kPa",
                   "Half of the loop's width in pressure at half of the stroke, extrapolated in a straight line from both rates to "
                   "rate 0 (half width of a play operator; Krasnosel'skii and Pokrovskii 1989); scatter of the cycles."),
            Figure(f"{name} lag", "tau", *of_repeats(lags), "s",
                   "Slope of that half width over the rate of the pressure: time by which the tip follows the measured pressure late; "
                   "scatter of the cycles.")]


def _plot(name: str, rates: List[List[Cycle]]) -> Plot:
    curves = []
    for cycles in rates:
        pressure = 1e-3 * np.mean([one.pressure for one in cycles], axis=0)
        branches = [1e3 * np.mean([getattr(one, side) for one in cycles], axis=0) for side in ("up", "down")]
        curves.append(Curve(np.append(pressure, pressure[::-1]), np.append(branches[0], branches[1][::-1]) - branches[0][0],
                            f"{cycles[0].period:.3g} s"))
    return Plot(f"{name}: hysteresis", "measured pressure [kPa]", "tip along its chord [mm]", curves)
