"""Creep at a held pressure, and fatigue over cycles, per actuator."""
from __future__ import annotations

from typing import List, Optional, Sequence, Tuple

import numpy as np
from scipy import stats

from helix_arm.experiments.figures import Figure, correlated_mean, t_factor
from helix_arm.experiments.hysteresis import Cycle, cycles_course, cycles_of
from helix_arm.experiments.protocol import BASE, Analysis, Course, Curve, Options, Plot, Recordings, Trial, driven
from helix_arm.experiments.rig import Recording, Rig
from helix_arm.experiments.step import steps_of
from helix_arm.scene import Scene

HOLD_S, TOP = 112.0, 0.6
CYCLES, CYCLE_S = 20, 4.0
DECADE_S, WIDTH = (10.0, 100.0), 0.1  # where the drift is read, each over so much of the time around it
FATIGUE = "fatigue"  # in the name of its trial
NO_STEP = "no step of it alone is held; record one of 2 min, as helix_arm experiment creep does."


def plan(rig: Rig, scene: Scene, options: Options) -> List[Trial]:
    """A step that is held; then cycles of 4 s."""
    cycles, hold, trials = options.repeats or CYCLES, options.hold_s or HOLD_S, []
    for actuator in options.actuators:
        name, course = scene.actuators[actuator], Course(rig)
        low, high = course.drive(actuator, BASE), course.drive(actuator, TOP)
        trials.append(Trial(name, course.go(low).hold(2 * options.settle_s).go(high).hold(hold).inputs()))
        course = Course(rig).go(low).hold(2 * options.settle_s)
        trials.append(Trial(f"{name} {FATIGUE}", cycles_course(course, low, high, cycles + 1, CYCLE_S).inputs()))
    return trials


def drift_of(name: str, recording: Recording) -> Tuple[List[Figure], List[Curve]]:
    actuator, pressure = driven(recording)
    steps = steps_of(recording.time_s, pressure)
    if not steps:
        return [Figure.unknown(f"{name} creep", "c", "mm/decade", NO_STEP)], []
    held = max(steps, key=lambda one: recording.time_s[one.end] - recording.time_s[one.begin])
    begin, end = recording.time_s[[held.begin, held.end]]
    since = recording.time_s - begin
    last = min(DECADE_S[1], (end - begin) / (1 + WIDTH))
    first = DECADE_S[0] if last > 5 * DECADE_S[0] else last / 5
    before = (recording.time_s < begin) & (recording.time_s > begin - 1) & recording.seen()
    around = (np.abs(since - first) < WIDTH * first) & recording.seen()
    if before.sum() < 3 or around.sum() < 3:
        return [Figure.unknown(f"{name} creep", "c", "mm/decade", "the tip is not seen at rest before the step, or after it.")], []
    way = recording.tip_m[around].mean(axis=0) - recording.tip_m[before].mean(axis=0)
    along = recording.tip_m @ (way / np.linalg.norm(way))
    decades = np.log10(last / first)
    out = []
    for words, symbol, values, unit, scale, text in (
            ("creep", "c", along, "mm/decade", 1e3, "Drift of the tip along its step"),
            ("sag", "s", recording.measured_pa[:, actuator], "kPa/decade", 1e-3, "Drift of the measured pressure")):
        (a, a_error), (b, b_error) = (
            correlated_mean(values[(np.abs(since - centre) <= WIDTH * centre) & np.isfinite(values)]) for centre in (first, last))
        out.append(Figure(f"{name} {words}", symbol, scale * (b - a) / decades, scale * float(np.hypot(a_error, b_error)) / decades,
                          unit, f"{text} per decade of time at a held pressure, from {first:.3g} to {last:.3g} s after its start, each "
                          "read over a tenth of the time to both sides; readings correlated in time count as fewer."))
    share = 1e3 * float(np.linalg.norm(way))
    out.append(Figure(f"{name} creep of the step", "c/S", 100 * out[0].value / share, 100 * out[0].standard_error / share,
                      "%/decade", f"The same in parts of the step at {first:.3g} s."))
    rows = (since > 0.3) & (since < end - begin) & recording.seen()
    return out, [Curve(since[rows], 1e3 * (along[rows] - along[around].mean()), name)]


def fatigue_of(name: str, cycles: Sequence[Cycle]) -> List[Figure]:
    if len(cycles) < 5:
        return [Figure.unknown(f"{name} drift per cycle", "dS/dN", "mm/cycle", "fewer than five cycles.")]
    number = np.arange(len(cycles))
    rows = [("start drift", "dx/dN", [1e3 * one.up[0] for one in cycles], "mm/cycle", "tip at 20 % of the range, rising"),
            ("stroke drift", "dS/dN", [1e3 * one.stroke for one in cycles], "mm/cycle", "stroke"),
            ("loop width drift", "dH/dN", [100 * one.width()[len(one.pressure) // 2] for one in cycles], "%/cycle",
             "loop width at half of the range of pressure")]
    out = []
    for words, symbol, values, unit, text in rows:
        fit = stats.linregress(number, values)
        out.append(Figure(f"{name} {words}", symbol, float(fit.slope), float(fit.stderr * t_factor(len(number) - 2)), unit,
                          f"Slope of the {text} over the number of the cycle, by least squares over {len(cycles)} cycles after the "
                          "first one; scatter about the line."))
    return out


def analyse(recordings: Recordings, names: Sequence[str], scene: Optional[Scene] = None) -> Analysis:
    """recordings: a step that is held; and cycles, if the name of the trial ends in "fatigue"."""
    out, curves, strokes = Analysis(), [], []
    for trial, recording in recordings.items():
        name = names[driven(recording)[0]]
        if trial.endswith(FATIGUE):
            cycles = cycles_of(recording)[1:]
            out.figures += fatigue_of(name, cycles)
            strokes.append(Curve(np.arange(1.0, len(cycles) + 1), np.array([1e3 * one.up[0] for one in cycles]), name, "o-"))
        else:
            figures, drawn = drift_of(name, recording)
            out.figures += figures
            curves += drawn
    why = "the regulators replace what leaks; close their valves and read the fall."
    out.figures.append(Figure.unknown("leak", "q", "kPa/s", why))
    out.plots.append(Plot("Creep at a held pressure", "time since the step [s]", "tip along its step [mm]", curves, log=True))
    out.plots.append(Plot("Fatigue", "cycle", "tip at the low end [mm]", strokes))
    return out
