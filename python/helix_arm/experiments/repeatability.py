"""Accuracy and repeatability of poses and of a path by ISO 9283:1998; the loop is open: pressures of the model."""
from __future__ import annotations

import re
from typing import Dict, Iterable, List, Optional, Sequence, Tuple

import numpy as np

from helix_arm.experiments import iso9283
from helix_arm.experiments.bode import PERIOD
from helix_arm.experiments.figures import Figure, bootstrap
from helix_arm.experiments.protocol import Analysis, Course, Curve, Options, Plot, Recordings, Trial
from helix_arm.experiments.rig import Recording, Rig
from helix_arm.scene import Scene

CYCLES, TURNS, TURN_S = 30, 10, 20.0  # of the poses, and of the circle
CENTRE, REACH = 0.35, 0.25  # shares of the ranges: of the first pose, and by how much the others differ from it
RADIUS = 0.06  # of the circle, by the arm's length
LOOK_S = 1.0  # at the end of a hold, whose mean is the attained position
POINTS, POINT_S = 36, 0.05
NO_SCENE = "the commanded tips are those of a scene; give --scene."


def poses(count: int) -> np.ndarray:
    """(5, count) shares of the ranges: in the middle, and four around it."""
    around = np.cos(2 * np.pi * (np.arange(count)[None] / count - np.arange(4)[:, None] / 4))
    return np.concatenate([np.full((1, count), CENTRE), CENTRE + REACH * around])


def circle(scene: Scene, centre_pa: np.ndarray) -> Optional[np.ndarray]:
    """(k, n) [Pa] of a circle of the model's tip around that of centre_pa, in the plane in which it moves most; None where the arm
    moves in a line or does not reach it."""
    directions, sizes, _ = np.linalg.svd(scene.jacobian(centre_pa, by="pressures").tip_by_pressures[:3])
    if sizes[1] < 1e-3 * sizes[0]:
        return None
    turn = 2 * np.pi * np.arange(round(TURN_S / POINT_S)) / round(TURN_S / POINT_S)
    ring = np.cos(turn)[:, None] * directions[:, 0] + np.sin(turn)[:, None] * directions[:, 1]
    pressures = [centre_pa]
    for tip in scene.tips(centre_pa) + RADIUS * scene.length_m * ring:
        found = scene.inverse(tip, start=pressures[-1], prefer="min-change")
        if not found.reached:
            return None
        pressures.append(found.pressures_pa)
    return np.array(pressures[1:])


def plan(rig: Rig, scene: Scene, options: Options) -> List[Trial]:
    """The five poses after each other, a cycle that conditions and then the others; then a circle."""
    course, cycles = Course(rig), options.repeats or CYCLES
    wanted = [course.share(one) for one in poses(len(rig.limits_pa))]
    for _ in range(cycles + 1):
        for pressure in wanted:
            course.go(pressure).hold((options.hold_s or options.settle_s) + LOOK_S)
    trials, ring = [Trial("poses", course.inputs())], circle(scene, wanted[0])
    if ring is not None:
        turns = min(cycles, TURNS) + 1
        course = Course(rig).go(ring[0]).hold(options.settle_s)
        points = np.tile(ring, (turns, 1))
        trials.append(Trial(f"circle period {TURN_S:g} s",
                            course.points(POINT_S * np.arange(1, len(points) + 1), points).hold(1.0).inputs()))
    return trials


def holds_of(recording: Recording, least_s: float = 2 * LOOK_S) -> List[Tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Where the targets stand still for long: targets (n) [Pa], mean of the tips at their end (3) [m] and its variance (3)."""
    moves = np.flatnonzero(np.any(np.abs(np.diff(recording.target_pa, axis=0)) > 1.0, axis=1))
    begins, ends = np.append(0, moves + 1), np.append(moves, len(recording.time_s) - 1)
    out = []
    for begin, end in zip(begins, ends):
        time = recording.time_s[begin:end + 1]
        if time[-1] - time[0] < 0.9 * least_s:
            continue
        tips = recording.tip_m[begin:end + 1][time > time[-1] - LOOK_S]
        tips = tips[np.isfinite(tips).all(axis=1)]
        if len(tips) >= 3:
            out.append((recording.target_pa[end], tips.mean(axis=0), tips.var(axis=0, ddof=1) / len(tips)))
    return out


def held_of(recordings: Iterable[Recording]) -> List[List[Tuple[np.ndarray, np.ndarray]]]:
    """Targets (n) [Pa] and tips (3,) [m] of the holds, by target; of targets that are held as often as any other."""
    groups: Dict[Tuple[int, ...], List[Tuple[np.ndarray, np.ndarray]]] = {}
    known = (one for one in recordings if np.isfinite(one.target_pa).all())
    for target, tip, _ in (one for recording in known for one in holds_of(recording)):
        groups.setdefault(tuple(np.round(1e-2 * target).astype(int)), []).append((target, tip))
    most = max(map(len, groups.values()), default=0)
    return [group for group in groups.values() if len(group) == most]


def attained_of(recording: Recording) -> Dict[str, Tuple[np.ndarray, np.ndarray]]:
    """Commanded pressures (n) and attained tips (cycles, 3) of the poses that are held as often as any other."""
    kept = [group for group in held_of([recording]) if len(group) > 3]
    return {f"P{i + 1}": (group[0][0], np.array([tip for _, tip in group[1:]])) for i, group in enumerate(kept)}


def _figure(name: str, symbol: str, found: Tuple[float, float], definition: str) -> Figure:
    return Figure(name, symbol, 1e3 * found[0], 1e3 * found[1], "mm", f"{definition}; bootstrap over the cycles.")


def pose_figures(recording: Recording, scene: Optional[Scene]) -> List[Figure]:
    found, out = attained_of(recording), []
    if not found:
        return [Figure.unknown("pose repeatability", "RP", "mm", "no known targets are held for 2 s more than three times.")]
    wanted = {name: None if scene is None else scene.tips(target) for name, (target, _) in found.items()}
    for name, (_, tips) in found.items():
        tip = wanted[name]
        if tip is None:
            out.append(Figure.unknown(f"{name} accuracy", "AP", "mm", NO_SCENE))
        else:
            out.append(_figure(f"{name} accuracy", "AP", bootstrap(tips, lambda some: iso9283.pose_accuracy(some, tip)),
                               f"Distance of the mean attained tip from the commanded one (ISO 9283, 7.2.1), {len(tips)} cycles"))
        out.append(_figure(f"{name} repeatability", "RP", bootstrap(tips, iso9283.pose_repeatability),
                           "Mean distance from the mean attained tip plus three standard deviations (ISO 9283, 7.2.2)"))
    names = list(found)
    if len(names) >= 4:
        pair = np.stack([found[names[1]][1], found[names[3]][1]], axis=1)
        out.append(_figure(f"{names[1]}-{names[3]} distance repeatability", "RD",
                           bootstrap(pair, lambda some: iso9283.distance_repeatability(some[:, 0], some[:, 1])),
                           "Three standard deviations of the distance between two poses (ISO 9283, 7.3.3)"))
        if scene is not None:
            distance = float(np.linalg.norm(wanted[names[1]] - wanted[names[3]]))
            out.append(_figure(f"{names[1]}-{names[3]} distance accuracy", "AD",
                               bootstrap(pair, lambda some: iso9283.distance_accuracy(some[:, 0], some[:, 1], distance)),
                               "Mean distance between two poses minus the commanded one (ISO 9283, 7.3.2)"))
    tips, tip = found[names[0]][1], wanted[names[0]]
    third = len(tips) // 3
    if third >= 3:
        # First and last cycles are drawn together, each from its own.
        ends = np.stack([tips[:third], tips[-third:]], axis=1)
        if tip is not None:
            out.append(_figure(f"{names[0]} drift of accuracy", "dAP",
                               bootstrap(ends, lambda some: iso9283.accuracy_drift(some[:, 0], some[:, 1], tip)),
                               f"AP of the last {third} cycles minus that of the first (ISO 9283, 7.6, which gives its size)"))
        out.append(_figure(f"{names[0]} drift of repeatability", "dRP",
                           bootstrap(ends, lambda some: iso9283.repeatability_drift(some[:, 0], some[:, 1])),
                           f"RP of the last {third} cycles minus that of the first (ISO 9283, 7.6, which gives its size)"))
    return out


def crossings(time: np.ndarray, tips: np.ndarray, commanded: np.ndarray, period: float) -> Tuple[np.ndarray, np.ndarray]:
    """Crossings of a circle: attained (turns, POINTS, 3) and commanded (POINTS, 3) where paths cross planes through the circle's axis; each
    the mean over a part of the turn. The first turn is left out."""
    last, seen = commanded[time > time[-1] - period], np.isfinite(tips).all(axis=1)
    centre = (last.max(axis=0) + last.min(axis=0)) / 2
    axes = np.linalg.svd(last - last.mean(axis=0), full_matrices=False)[2][:2]

    def means(positions: np.ndarray) -> np.ndarray:
        angle = np.arctan2(*((positions - centre) @ axes.T).T[::-1])
        at = np.minimum(((angle / (2 * np.pi) % 1) * POINTS).astype(int), POINTS - 1)
        return np.array([positions[at == i].mean(axis=0) if np.any(at == i) else np.full(3, np.nan) for i in range(POINTS)])

    turns = [means(tips[seen & (time > time[-1] - (k + 1) * period) & (time <= time[-1] - k * period)])
             for k in range(int((time[-1] - time[0]) / period - 0.9))]
    return np.array(turns[::-1]), means(last)


def path_figures(trial: str, recording: Recording, scene: Optional[Scene]) -> List[Figure]:
    told = re.search(PERIOD, trial)
    if scene is None or told is None:
        why = NO_SCENE if scene is None else "the name of the trial does not end in \"period 20 s\"."
        return [Figure.unknown("path accuracy", "AT", "mm", why)]
    moves = np.flatnonzero(np.any(np.diff(recording.target_pa, axis=0) != 0, axis=1))
    gaps = np.flatnonzero(np.diff(recording.time_s[moves]) > 0.3)
    path = np.arange(moves[gaps[0]] + 1, moves[gaps[-1]] + 1)
    commanded = scene.tips(np.clip(recording.target_pa[path], *scene.limits_pa.T))
    attained, points = crossings(recording.time_s[path], recording.tip_m[path], commanded, float(told[1]))
    known = np.isfinite(attained).all(axis=(0, 2)) & np.isfinite(points).all(axis=1)
    if len(attained) < 3 or known.sum() < POINTS // 2:
        return [Figure.unknown("path accuracy", "AT", "mm", "fewer than three whole turns are seen.")]
    attained, points = attained[:, known], points[known]
    return [_figure("path accuracy", "AT", bootstrap(attained, lambda some: iso9283.path_accuracy(some, points)),
                    f"Largest distance of the mean path from the commanded circle (ISO 9283, 8.2), {len(attained)} turns of "
                    f"{told[1]} s"),
            _figure("path repeatability", "RT", bootstrap(attained, iso9283.path_repeatability),
                    "Largest mean distance from the mean path plus three standard deviations (ISO 9283, 8.3)")]


def analyse(recordings: Recordings, names: Sequence[str], scene: Optional[Scene] = None) -> Analysis:
    """recordings: poses that are held for 2 s or more, again and again; and turns of a circle, if the name of the trial begins with
    "circle" and ends in its period."""
    out = Analysis()
    for trial, recording in recordings.items():
        if trial.startswith("circle"):
            out.figures += path_figures(trial, recording, scene)
            continue
        out.figures += pose_figures(recording, scene)
        curves = [Curve(np.arange(1.0, len(tips) + 1), 1e3 * np.linalg.norm(tips - tips.mean(axis=0), axis=1), name, "o-")
                  for name, (_, tips) in attained_of(recording).items()]
        out.plots.append(Plot("Distance from the mean attained tip", "cycle", "distance [mm]", curves))
    return out
