"""Frequency response of the tip, per actuator, by a multisine."""
from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np
from scipy import stats

from helix_arm.arguments import require
from helix_arm.experiments.figures import NORMAL, Figure, jackknife
from helix_arm.experiments.protocol import Analysis, Course, Curve, Options, Plot, Recordings, Trial, driven
from helix_arm.experiments.rig import Recording, Rig
from helix_arm.scene import Scene

REPEATS, PERIOD_S = 6, 20.0
CENTRE, AMPLITUDE = 0.35, 0.15  # shares of the range
LINES, HIGHEST_HZ = 24, 10.0
CORNER_HZ = 0.5  # from which on amplitudes fall with the frequency
POINT_S = 0.02  # between the points of the inputs
LEAST_LINE = 0.02  # of the largest amplitude, that is a line of the signal
REFERENCE_HZ, DISTORTED_HZ = 1.0, 1.5
PERIOD = r"period ([0-9.]+) s$"  # in the name of a trial
END_S, SETTLED, PAUSE_S = 0.5, 0.8, 0.5  # left out at the end; part of the first period that has to be there; before the signal


def lines_of(period_s: float, rate_hz: float) -> np.ndarray:
    """Harmonics of the period that are excited: odd ones, evenly spread on a logarithmic scale, up to a third of the rate."""
    highest = min(HIGHEST_HZ, rate_hz / 3) * period_s
    wanted = np.geomspace(1, highest, LINES)
    return np.unique(2 * np.floor((wanted - 1) / 2).astype(int) + 1)


def multisine(time_s: np.ndarray, lines: np.ndarray, period_s: float) -> np.ndarray:
    """(m,) within -1 and 1. Phases by Schroeder (IEEE Trans. Inf. Theory 16, 1970, 85), which keep its peaks low."""
    amplitude = np.minimum(1.0, CORNER_HZ * period_s / lines)
    power = amplitude**2 / np.sum(amplitude**2)
    phase = -2 * np.pi * np.array([np.sum((k - np.arange(k)) * power[:k]) for k in range(len(lines))])
    value = amplitude @ np.cos(2 * np.pi * np.outer(lines, time_s) / period_s + phase[:, None])
    return value / np.abs(value).max()


def plan(rig: Rig, scene: Scene, options: Options) -> List[Trial]:
    """The centre for a period, and a period of the signal, in which the arm settles; then one per repeat. The amplitude is what
    the slew rate allows, at most AMPLITUDE."""
    repeats, period, trials = options.repeats or REPEATS, options.hold_s or PERIOD_S, []
    lines = lines_of(period, rig.rate_hz)
    time = POINT_S * np.arange(1, round((repeats + 1) * period / POINT_S) + 1)
    signal = multisine(time, lines, period)
    for actuator in options.actuators:
        course = Course(rig)
        width = float(np.ptp(rig.limits_pa[actuator]))
        fastest = float(np.abs(np.diff(signal)).max()) / POINT_S
        share = min(AMPLITUDE, course.slew_pa_s / (fastest * width))
        middle = course.drive(actuator, CENTRE)
        course.go(middle).hold(max(2 * options.settle_s, period))  # creep after that step would look like a drift
        points = np.tile(middle, (len(time), 1))
        # From the centre to the signal in half a second.
        points[:, actuator] += share * width * signal * np.minimum(1, time / 0.5)
        trials.append(Trial(f"{scene.actuators[actuator]} period {period:g} s", course.points(time, points).inputs()))
    return trials


@dataclass(frozen=True)
class Period:
    """Complex amplitudes at the lines of one period. target: (L,) [Pa]; tip: (L, 3) [m]."""

    target: np.ndarray
    tip: np.ndarray


def _amplitudes(time: np.ndarray, values: np.ndarray, frequencies: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """(L, k) and means (k,) of values (m, k), NaN where not seen, by least squares."""
    seen = np.isfinite(values).all(axis=1)
    angle = 2 * np.pi * np.outer(time[seen], frequencies)
    found = np.linalg.lstsq(np.column_stack([np.cos(angle), np.sin(angle), np.ones(seen.sum())]), values[seen], rcond=None)[0]
    return found[:len(frequencies)] - 1j * found[len(frequencies):-1], found[-1]


def periods_of(name: str, recording: Recording) -> Tuple[np.ndarray, List[Period]]:
    """Frequencies (L,) [Hz] of the lines in the targets, and the periods after the first one.

    Raises ValueError saying what the trial lacks.
    """
    told, target, time = re.search(PERIOD, name), driven(recording)[1], recording.time_s
    if told is None:
        raise ValueError("the name of the trial does not end in its period, as in \"muscle_1 period 20 s\"")
    require(bool(np.isfinite(recording.target_pa).all()), "the commanded pressures are not recorded")
    period, third = float(told[1]), len(time) // 3
    inside = np.flatnonzero(target >= target[third:2 * third].min())  # not on the way from and to vented
    end, rate = time[inside[-1]] - END_S, 1 / float(np.median(np.diff(time[recording.seen()])))
    moves = inside[1:][np.diff(target[inside]) != 0]
    pauses = np.flatnonzero(np.diff(time[moves]) > PAUSE_S)
    begin = time[moves[pauses[-1] + 1] if len(pauses) else moves[0]]
    count = int((end - begin - SETTLED * period) / period)
    require(count >= 2, "there are fewer than two whole periods after the first one")
    harmonics = np.arange(1, int(min(HIGHEST_HZ, rate / 3) * period) + 1)
    last = (time > end - period) & (time <= end)
    amplitude = np.abs(_amplitudes(time[last], target[last, None], harmonics / period)[0][:, 0])
    frequencies = harmonics[amplitude > LEAST_LINE * amplitude.max()] / period
    parts = [(time > end - i * period) & (time <= end - (i - 1) * period) for i in range(count, 0, -1)]
    # A drift shows in the means of the periods. Fitted within each, it would take its part of the lines.
    drift = np.gradient([_amplitudes(time[rows], recording.tip_m[rows], frequencies)[1] for rows in parts], axis=0) / period
    # An arm that is not linear moves at the harmonics between the lines, too.
    modelled = np.union1d(frequencies, harmonics[harmonics <= DISTORTED_HZ * period] / period)
    excited, periods = np.searchsorted(modelled, frequencies), []
    for rows, slope in zip(parts, drift):
        driving, since = _amplitudes(time[rows], target[rows, None], frequencies)[0], time[rows] - time[rows].mean()
        moved = _amplitudes(time[rows], recording.tip_m[rows] - np.outer(since, slope), modelled)[0]
        periods.append(Period(driving[:, 0], moved[excited]))
    return frequencies, periods


def response(periods: Sequence[Period], direction: np.ndarray) -> np.ndarray:
    """(L,) complex, tip by target [m/Pa]."""
    target = np.mean([one.target for one in periods], axis=0)
    return np.mean([one.tip for one in periods], axis=0) @ direction / target


def direction_of(periods: Sequence[Period]) -> np.ndarray:
    """(3,) unit vector along which the tip moves at the lowest line, with the pressure."""
    lowest = np.mean([one.tip[0] / one.target[0] for one in periods], axis=0)
    direction = np.linalg.svd(np.stack([lowest.real, lowest.imag]))[2][0]
    return direction * (1 if (lowest @ direction).real > 0 else -1)


def corner(frequencies: np.ndarray, found: np.ndarray) -> float:
    """Where the gain first is 3 dB below that of the lowest line, by straight lines in dB over log f; NaN where it never is."""
    fall = 20 * np.log10(np.abs(found) / np.abs(found[0])) + 3
    below = np.flatnonzero(fall < 0)
    if len(below) == 0:
        return float("nan")
    i = below[0]
    part = fall[i - 1] / (fall[i - 1] - fall[i])
    return float(frequencies[i - 1] * (frequencies[i] / frequencies[i - 1]) ** part)


def delay(frequencies: np.ndarray, found: np.ndarray) -> float:
    """Mean slope of the phase over the angular frequency, with the sign of a delay [s]."""
    return float(-np.polyfit(2 * np.pi * frequencies, np.unwrap(np.angle(found)), 1)[0])


def coherence(periods: Sequence[Period], direction: np.ndarray) -> np.ndarray:
    """(L,) magnitude-squared, over the periods."""
    tips = np.array([one.tip @ direction for one in periods])
    targets = np.array([one.target for one in periods])
    cross, tip, target = (np.sum(one, axis=0) for one in (tips * targets.conj(), np.abs(tips) ** 2, np.abs(targets) ** 2))
    return np.abs(cross) ** 2 / tip / target


def mean_coherence(found: np.ndarray, count: int) -> Tuple[float, float]:
    """Mean of coherences (L,) over so many periods, without their bias, and its standard error: what they lack of 1 is a sum of
    squares of noise, so that its interval is that of chi square, of which this is the longer side."""
    lack = (1 - found) * count / (count - 1)
    freedom = 2 * (count - 1) * float(np.sum(lack) ** 2 / np.sum(lack**2))
    return float(1 - lack.mean()), float(lack.mean() * (freedom / stats.chi2.ppf(0.025, freedom) - 1) / NORMAL)


def figures_of(name: str, frequencies: np.ndarray, periods: List[Period]) -> List[Figure]:
    direction = direction_of(periods)
    whole = response(periods, direction)
    end = corner(frequencies, whole)
    passed = frequencies <= (end if np.isfinite(end) else frequencies[-1])
    near = int(np.argmin(np.abs(frequencies - REFERENCE_HZ)))

    def of(figure: Callable[[np.ndarray], float]) -> Tuple[float, float]:
        return jackknife(periods, lambda some: figure(response(some, direction)))

    at = f"at {frequencies[near]:.3g} Hz"
    turn = np.angle(whole[near])
    rows = [("gain", "G0", of(lambda g: 1e6 * abs(g[0])), "mm/kPa", f"Amplitude of the tip, along its motion at {frequencies[0]:.3g} "
             "Hz, by that of the commanded pressure, there"),
            (f"gain {at}", "G1", of(lambda g: 1e6 * abs(g[near])), "mm/kPa", f"The same {at}"),
            (f"phase {at}", "phi1", of(lambda g: np.degrees(turn + np.angle(g[near] * np.exp(-1j * turn)))), "deg",
             f"Phase of the tip behind the commanded pressure {at}"),
            ("coherence", "gamma2", mean_coherence(coherence(periods, direction)[passed], len(periods)), "1",
             "Mean magnitude-squared coherence of tip and commanded pressure over the lines up to -3 dB, across periods")]
    if passed.sum() >= 3:
        rows.append(("delay", "Td", of(lambda g: delay(frequencies[passed], g[passed])), "s",
                     "Mean slope of the phase over the angular frequency up to -3 dB, by least squares"))
    out = [Figure(f"{name} {words}", symbol, *found, unit, f"{text}; jackknife over {len(periods)} periods.")
           for words, symbol, found, unit, text in rows]
    if np.isfinite(end):
        out.append(Figure(f"{name} -3 dB frequency", "f3dB", *of(lambda g: corner(frequencies, g)), "Hz",
                          "Where the gain first is 3 dB below that of the lowest line; jackknife over the periods."))
    else:
        why = f"the gain falls by less up to {frequencies[-1]:.3g} Hz."
        out.append(Figure.unknown(f"{name} -3 dB frequency", "f3dB", "Hz", why))
    return out


def analyse(recordings: Recordings, names: Sequence[str], scene: Optional[Scene] = None) -> Analysis:
    """recordings: a periodic signal in the target of one actuator each; the name of the trial ends in "period 20 s"."""
    out = Analysis()
    gains, phases, sure = [], [], []
    for trial, recording in recordings.items():
        name = names[driven(recording)[0]]
        try:
            frequencies, periods = periods_of(trial, recording)
        except ValueError as reason:
            out.figures.append(Figure.unknown(f"{name} gain", "G0", "mm/kPa", f"{reason}."))
            continue
        out.figures += figures_of(name, frequencies, periods)
        direction = direction_of(periods)
        found = response(periods, direction)
        gains.append(Curve(frequencies, 20 * np.log10(np.abs(found) / np.abs(found[0])), name, "-o"))
        phases.append(Curve(frequencies, np.degrees(np.unwrap(np.angle(found))), name, "-o"))
        sure.append(Curve(frequencies, coherence(periods, direction), name, "-o"))
    for title, unit, curves in (("Gain", "dB", gains), ("Phase", "deg", phases), ("Coherence", "1", sure)):
        out.plots.append(Plot(f"{title} of tip by command", "frequency [Hz]", f"{title.lower()} [{unit}]", curves, log=True))
    return out
