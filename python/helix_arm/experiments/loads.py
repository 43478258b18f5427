"""Stiffness of the tip and what a payload does, by forces that hang at the tip."""
from __future__ import annotations

import itertools
import re
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from helix_arm.experiments.figures import Figure, of_repeats
from helix_arm.experiments.protocol import Analysis, Course, Curve, Options, Plot, Recordings, Trial
from helix_arm.experiments.repeatability import LOOK_S, holds_of, poses
from helix_arm.experiments.rig import Recording, Rig, with_load
from helix_arm.scene import Scene

FORCE_N, LEVELS = 0.5, (0.2, 0.6)  # shares of the range of all pressures together
REPEATS = 3
WITHIN = 0.4  # share of such a displacement that is bend within sections, which vision takes from the model
STIFFNESS = r"^(\d+) % ([xyz])([+-]) (\d+)$"  # names of trials
GRAVITY, MASSES_KG, TOLD_KG = 9.81, (0.0, 0.05, 0.1), 0.1
SHIFT, TIP = r"^hung (\d+) g (\d+)$", r"^tip (\d) (told|untold) (\d+)$"


def _hold(rig: Rig, pressure_pa: np.ndarray, options: Options, name: str, force: np.ndarray) -> Trial:
    course = Course(rig).go(pressure_pa).hold((options.hold_s or 2 * options.settle_s) + LOOK_S)
    return Trial(name, course.inputs(), force)


def tip_of(recording: Recording) -> np.ndarray:
    """(3,) at the end of the longest hold; NaN where it is not seen."""
    held = [one for one in holds_of(recording, LOOK_S) if np.any(one[0] > 0)]
    return held[-1][1] if held else np.full(3, np.nan)


def plan_stiffness(rig: Rig, scene: Scene, options: Options) -> List[Trial]:
    """A force to and fro along each axis of the base, at two levels of all pressures together."""
    trials = []
    for repeat, level, axis, sign in itertools.product(range(options.repeats or REPEATS), LEVELS, range(3), (1, -1)):
        pressure = Course(rig).share(np.full(len(rig.limits_pa), level))
        name = f"{100 * level:.0f} % {'xyz'[axis]}{'+-'[sign < 0]} {repeat + 1}"
        trials.append(_hold(rig, pressure, options, name, sign * FORCE_N * np.eye(3)[axis]))
    return trials


def _ways_of_model(scene: Optional[Scene]) -> Dict[Tuple[str, str], float]:
    """Displacements of the tip by the force to and fro, by level and axis [m]; empty without a scene, or one that no force bends."""
    ways: Dict[Tuple[str, str], float] = {}
    if scene is None or not scene._bends:
        return ways
    for axis, force in zip("xyz", FORCE_N * np.eye(3)):
        there, back = (with_load(scene, force_n=sign * force) for sign in (1, -1))
        for level in LEVELS:
            pressure = scene.limits_pa[:, 0] + level * np.ptp(scene.limits_pa, axis=1)
            way = there.forward(pressure).tips - back.forward(pressure).tips
            ways[f"{100 * level:.0f}", axis] = float(way.ravel()["xyz".index(axis)])
    return ways


def analyse_stiffness(recordings: Recordings, names: Sequence[str], scene: Optional[Scene] = None) -> Analysis:
    """recordings: named as in "20 % x+ 1": level of the pressures, direction of a force of 0.5 N, repeat."""
    tips: Dict[Tuple[str, str, str], Dict[str, np.ndarray]] = {}
    pressures: Dict[str, float] = {}
    for trial, recording in recordings.items():
        told = re.match(STIFFNESS, trial)
        if told:
            tips.setdefault((told[1], told[2], told[4]), {})[told[3]] = tip_of(recording)
            pressures[told[1]] = float(np.median(np.nanmax(recording.measured_pa, axis=0)))
    out, found, expected = Analysis(), {}, _ways_of_model(scene)
    for level in sorted(pressures, key=int):
        for axis in "xyz":
            ways = [float((pair["+"] - pair["-"])["xyz".index(axis)]) for (one, along, _), pair in tips.items()
                    if one == level and along == axis and len(pair) == 2]
            name = f"stiffness along {axis} at {level} %"
            mean, error = of_repeats(ways) if len(ways) > 1 and np.isfinite(ways).all() else (0.0, 1.0)
            if mean < 3 * error:
                out.figures.append(Figure.unknown(name, "k", "N/mm", "the tip moves by less than three standard errors."))
                continue
            error = float(np.hypot(error, WITHIN * (mean - expected.get((level, axis), mean))))
            stiffness = 2e-3 * FORCE_N / mean
            found[level, axis] = (stiffness, stiffness * error / mean)
            out.figures.append(Figure(name, "k", *found[level, axis], "N/mm", f"Force of {FORCE_N} N to and fro by the way of the tip "
                                      f"along it, all pressures at {level} % of their ranges; scatter of the repeats, and {WITHIN} of the "
                                      "difference to the model's displacement."))
    for axis in "xyz":
        levels = [level for level in sorted(pressures, key=int) if (level, axis) in found]
        if len(levels) > 1:
            (a, a_error), (b, b_error) = found[levels[0], axis], found[levels[-1], axis]
            step = 1e-5 * (pressures[levels[-1]] - pressures[levels[0]])
            out.figures.append(Figure(f"stiffness along {axis} by co-contraction", "dk/dp", (b - a) / step,
                                      float(np.hypot(a_error, b_error)) / step, "N/mm/100 kPa",
                                      "Difference of these stiffnesses by that of the pressures; scatter of the repeats."))
            out.plots.append(Plot(f"Stiffness along {axis}", "all pressures [% of range]", "stiffness [N/mm]",
                                  [Curve(np.array([int(one) for one in levels]), np.array([found[one, axis][0] for one in levels]),
                                         axis, "o-")]))
    out.figures.append(Figure.unknown("blocked force", "Fb", "N", "the tip is not held; read a scale that it pushes."))
    return out


def plan_payload(rig: Rig, scene: Scene, options: Options) -> List[Trial]:
    """Masses at one pose; then three poses with a mass, by pressures of the model without it and with it."""
    shares, weight = poses(len(rig.limits_pa)), -GRAVITY * scene._rotation_WB[2]
    middle, trials = Course(rig).share(shares[0]), []
    wanted = [scene.tips(Course(rig).share(one)) for one in shares[1:4]]
    loaded = with_load(scene, TOLD_KG)
    for repeat in range(options.repeats or REPEATS):
        for mass in MASSES_KG:
            trials.append(_hold(rig, middle, options, f"hung {1e3 * mass:.0f} g {repeat + 1}", mass * weight))
        for i, tip in enumerate(wanted):
            for model, word in ((scene, "untold"), (loaded, "told")):
                pressure = model.inverse(tip, start=Course(rig).share(shares[i + 1]), prefer="min-change").pressures_pa
                trials.append(_hold(rig, pressure, options, f"tip {i + 1} {word} {repeat + 1}", TOLD_KG * weight))
    return trials


def analyse_payload(recordings: Recordings, names: Sequence[str], scene: Optional[Scene] = None) -> Analysis:
    """recordings: named as in "hung 50 g 1" (mass, repeat) and "tip 1 told 1" (number of the tip, model, repeat)."""
    out, tips, errors, wanted = Analysis(), {}, {}, None
    if scene is not None:
        limits = scene.limits_pa
        wanted = [scene.tips(limits[:, 0] + one * np.ptp(limits, axis=1)) for one in poses(len(limits))[1:4]]
    for trial, recording in recordings.items():
        told, tip = re.match(SHIFT, trial), re.match(TIP, trial)
        if told:
            tips.setdefault(told[2], {})[int(told[1])] = tip_of(recording)
        elif tip and wanted is not None:
            errors.setdefault((tip[2], tip[3]), []).append(float(np.linalg.norm(tip_of(recording) - wanted[int(tip[1]) - 1])))
    masses = sorted({mass for one in tips.values() for mass in one})
    whole = [one for one in tips.values() if sorted(one) == masses and len(masses) > 1]
    if len(whole) < 2:
        out.figures.append(Figure.unknown("shift by a payload", "dx", "mm/50 g", "there are no two repeats of two masses or more."))
    else:
        ways = np.array([[one[mass] - one[masses[0]] for mass in masses[1:]] for one in whole])
        shifts, mass_g = [], np.array(masses[1:], float)
        for i in range(len(ways)):
            # The other repeats tell the direction, so that noise does not lengthen the way.
            others = np.delete(ways, i, 0).mean(axis=0)[-1]
            along = ways[i] @ (others / np.linalg.norm(others))
            loads = mass_g - masses[0]
            shifts.append(1e3 * 50 * float(along @ loads / (loads @ loads)))
        out.figures.append(Figure("shift by a payload", "dx", *of_repeats(shifts), "mm/50 g",
                                  f"Slope of the tip's way over the hung mass, up to {masses[-1]} g, in the middle pose; scatter of "
                                  "the repeats."))
        out.plots.append(Plot("Tip shift by payload", "mass [g]", "shift [mm]", [Curve(
            np.append(0, mass_g), np.append(0, 1e3 * np.linalg.norm(ways.mean(axis=0), axis=1)), "", "o-")]))
    for word, text in (("untold", "by pressures of the model without it"), ("told", "by those of the model that is told of it")):
        values = [1e3 * float(np.sqrt(np.mean(np.square(one)))) for (model, _), one in errors.items() if model == word]
        if len(values) > 1:
            out.figures.append(Figure(f"error of the inverse, load {word}", "e", *of_repeats(values), "mm",
                                      f"RMS distance of three tips from the commanded ones under {1e3 * TOLD_KG:.0f} g, {text}; "
                                      "scatter of the repeats."))
    return out
