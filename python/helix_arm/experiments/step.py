"""Step response of pressure and tip, per actuator."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np
from scipy.optimize import least_squares

from helix_arm import _core
from helix_arm.experiments.figures import NORMAL, Figure, correlated_mean, jackknife
from helix_arm.experiments.protocol import BASE, Analysis, Course, Curve, Options, Plot, Recordings, Trial, driven
from helix_arm.experiments.rig import Recording, Rig
from helix_arm.scene import Scene

REPEATS, HOLD_S, TOP = 5, 8.0, 0.6  # TOP: share of the range
LEVELS = {"t5": (0.05, "5 % time"), "t63": (0.63, "63 % time"), "t90": (0.90, "90 % time"), "t98": (0.98, "98 % time")}
LEAST, STILL, STILL_S = 0.15, 0.05, 0.1  # changes of the range of pressure that are a step, and that are none
RESIDUAL_RATIO, LEAST_WIDTH = 1.3, 1.5  # variance about a fit, by that of the noise; half width of a fit, by the spacing of readings
RINGING = 2 / 3  # of the releases and steps, that have to ring
SURE = 4.5  # standard deviations of a fitted value
NO_STEPS = "no step of it alone is made twice; record steps of its pressure, as helix_arm experiment step does."
FINAL, BEFORE_S = 0.2, 1.0  # part of the hold whose mean is the final value; time before a step whose mean is the start


def plan(rig: Rig, scene: Scene, options: Options) -> List[Trial]:
    """One cycle that conditions the arm, then the repeats. Each begins at another phase of the camera, so that together they
    sample the response more densely than its pictures."""
    repeats, hold, trials = options.repeats or REPEATS, options.hold_s or HOLD_S, []
    for actuator in options.actuators:
        course = Course(rig)
        low, high = course.drive(actuator, BASE), course.drive(actuator, TOP)
        course.go(low).hold(hold)
        for repeat in range(repeats + 1):
            wait = hold + repeat / (repeats + 1) / rig.rate_hz
            course.go(high).hold(wait).go(low).hold(wait)
        trials.append(Trial(scene.actuators[actuator], course.inputs()))
    return trials


@dataclass(frozen=True)
class Response:
    """Response to one step, as a fraction of it. time: since the command began to change [s]."""

    time: np.ndarray
    part: np.ndarray
    spacing: float  # of the readings [s]


@dataclass(frozen=True)
class Step:
    """begin: last row before the command changes. end: last row before the next change. From and to [Pa]."""

    begin: int
    end: int
    before: float
    after: float


def steps_of(time: np.ndarray, pressure: np.ndarray) -> List[Step]:
    """The steps of one pressure (m,), commanded or measured; each at least LEAST of its range."""
    width = float(np.ptp(pressure))
    quiet = max(1e-6 * width, 3 * float(np.median(np.abs(np.diff(pressure)))))
    begins, level, since, moves = [], pressure[0], time[0], False
    earlier = max(1, round(STILL_S / float(np.median(np.diff(time)))))
    for row, (now, value) in enumerate(zip(time, pressure)):
        if abs(value - level) > (STILL if moves else LEAST) * width:
            if not moves:
                begin = row
                while begin > 0 and abs(pressure[begin] - level) > quiet:
                    begin -= 1
                begins.append(begin)
            moves, level, since = True, value, now
        elif now >= since + STILL_S:
            moves = False
            if abs(value - pressure[max(row - earlier, 0)]) <= quiet:
                level = value
    bounds = [0, *begins, len(time) - 1]
    levels = [float(np.median(pressure[a + (b - a) // 2:b + 1])) for a, b in zip(bounds, bounds[1:])]
    return [Step(*one) for one in zip(begins, bounds[2:], levels, levels[1:])]


def response_of(time: np.ndarray, values: np.ndarray, step: Step, earlier: int) -> Optional[Response]:
    """values: (m, k), NaN where not seen. earlier: row of the step before. None where start or end is not seen."""
    begin, end = time[step.begin], time[step.end]
    seen = np.isfinite(values).all(axis=1)
    before = seen & (time > max(begin - BEFORE_S, time[earlier])) & (time <= begin)
    final = seen & (time > end - FINAL * (end - begin)) & (time <= end)
    if before.sum() < 2 or final.sum() < 2:
        return None
    start, way = values[before].mean(axis=0), values[final].mean(axis=0) - values[before].mean(axis=0)
    rows = seen & (time > begin - BEFORE_S / 4) & (time <= end)
    part = (values[rows] - start) @ way / (way @ way)
    return Response(time[rows] - begin, part, float(np.median(np.diff(time[rows]))))


def _pooled(parts: Sequence[Response]) -> Tuple[np.ndarray, np.ndarray]:
    """All readings in the order of their times."""
    time, value = (np.concatenate([getattr(one, name) for one in parts]) for name in ("time", "part"))
    order = np.argsort(time, kind="stable")
    return time[order], value[order]


def _smooth(parts: Sequence[Response]) -> Tuple[np.ndarray, np.ndarray]:
    """Each reading the mean of its neighbours."""
    width = 2 * len(parts) + 1
    time, value = (np.convolve(one, np.ones(width) / width, "valid") for one in _pooled(parts))
    return time, value


def _local(parts: Sequence[Response], centres: np.ndarray, half: float) -> Tuple[np.ndarray, np.ndarray]:
    """Values at times (k,) of quadratics through the readings within half of each, at least four, and the variances about these."""
    time, value = _pooled(parts)
    begins, ends = np.searchsorted(time, centres - half), np.searchsorted(time, centres + half)
    lack = np.maximum(4 - (ends - begins), 0)
    begins = np.clip(begins - (lack + 1) // 2, 0, len(time) - 4)
    ends = np.maximum(ends, begins + 4)
    rows = begins[:, None] + np.arange((ends - begins).max())
    near = rows < ends[:, None]
    rows = np.minimum(rows, len(time) - 1)
    x, y = np.where(near, (time[rows] - centres[:, None]) / half, 0.0), np.where(near, value[rows], 0.0)
    columns = np.stack([near.astype(float), x, x * x], axis=2)
    normal = np.einsum("kri,krj->kij", columns, columns) + 1e-12 * np.eye(3)
    fit = np.linalg.solve(normal, np.einsum("kri,kr->ki", columns, y)[..., None])[..., 0]
    rest = np.sum((y - np.einsum("kri,ki->kr", columns, fit)) ** 2, axis=1)
    return fit[:, 0], rest / np.maximum(ends - begins - 3, 1)


def _noise(parts: Sequence[Response]) -> float:
    """Variance of a reading, from the final part, of each repeat by itself."""
    rests = [one.part[one.time > (1 - FINAL) * one.time[-1]] for one in parts]
    return float(np.mean([np.var(np.diff(rest)) / 2 for rest in rests]))


def _width(parts: Sequence[Response], centre: float, widest: float) -> float:
    """Half of the largest width at which a quadratic fits within the noise, so that its bias is far below that."""
    noise, half, least = _noise(parts), 2 * LEAST_WIDTH * parts[0].spacing, LEAST_WIDTH * parts[0].spacing
    while half < widest and _local(parts, np.array([centre]), 1.4 * half)[1][0] < RESIDUAL_RATIO * noise:
        half *= 1.4
    return max(half / 2, least)


def _sure(parts: Sequence[Response], centre: float, half: float) -> float:
    """SURE standard deviations of a fitted value, with those of start and end of the step."""
    last = np.mean([np.sum(one.time > (1 - FINAL) * one.time[-1]) for one in parts])
    ends = (1 / last + parts[0].spacing / BEFORE_S) / len(parts)
    near = max(float(np.sum(np.abs(_pooled(parts)[0] - centre) <= half)), 4.0)
    return SURE * float(np.sqrt(_noise(parts) * (2.25 / near + ends)))  # 2.25: of a quadratic, in its middle


def time_to(parts: Sequence[Response], level: float) -> Tuple[float, float]:
    """When the responses together first reach this part [s], and its standard error."""
    time, value = _smooth(parts)

    def first(part: float) -> float:
        above = value >= part
        return float(time[np.argmax(above)]) if above.any() else float(time[-1])

    rough = first(level)
    half = _width(parts, rough, max(rough, 4 * parts[0].spacing))
    begin = max(first(level - 0.25) - half, float(time[0])) if level > 0.25 else max(rough - 4 * half, float(time[0]))

    def crossing(some: Sequence[Response], beyond: float = 0.0, end: float = min(rough + 6 * half, float(time[-1]))) -> float:
        grid = np.arange(begin, end, half / 3)
        above = _local(some, grid, half)[0] - level - beyond
        i = int(np.argmax((above[1:] >= 0) & (above[:-1] < 0)))
        if not above[i] < 0 <= above[i + 1]:
            return end if end == time[-1] else crossing(some, beyond, float(time[-1]))
        return float(grid[i] - above[i] * (grid[i + 1] - grid[i]) / (above[i + 1] - above[i]))

    found, error = jackknife(parts, crossing)
    # Ringing that almost touches the level: by noise, the first crossing may be another one.
    sure = _sure(parts, rough, half)
    other = max(abs(crossing(parts, beyond, float(time[-1])) - found) for beyond in (sure, -sure))
    return found, max(error, other / NORMAL if other > 2 * SURE * error else 0.0)


def overshoot(parts: Sequence[Response]) -> Optional[Tuple[float, float]]:
    """Largest part beyond 1 before the final part [%], and its standard error; None where noise may be all of it."""
    time, value = _smooth(parts)
    inside = (time > 0) & (time < (1 - FINAL) * min(one.time[-1] for one in parts))
    peak = float(time[inside][np.argmax(value[inside])])
    half = max(min(_width(parts, peak, peak), float(time[np.argmax(value >= 0.63)]) / 4), LEAST_WIDTH * parts[0].spacing)
    grid = np.arange(half, time[inside][-1], half / 3)
    found = jackknife(parts, lambda some: 100 * float(_local(some, grid, half)[0].max() - 1))
    return found if found[0] > max(100 * _sure(parts, peak, half), 3 * found[1]) else None


Group = List[Tuple[Recording, int, Step, int]]  # recording, actuator, step, row of the step before


def _groups(recordings: Recordings, names: Sequence[str]) -> Dict[str, Group]:
    """Steps by what they have in common, in their order; those that are made but once are left out."""
    found: Dict[Tuple[int, int, int], Group] = {}
    moved = [(recording, *driven(recording)) for recording in recordings.values() if recording.measured_pa.size]
    widths: Dict[int, float] = {}
    for _, actuator, pressure in moved:
        widths[actuator] = max(widths.get(actuator, 0.0), float(np.ptp(pressure)))
    for recording, actuator, pressure in moved:
        earlier = 0
        for step in steps_of(recording.time_s, pressure):
            low, high = (round(level / (0.05 * widths[actuator])) for level in (step.before, step.after))
            found.setdefault((actuator, low, high), []).append((recording, actuator, step, earlier))
            earlier = step.begin
    kept = {key: group for key, group in found.items() if len(group) > 1}
    out: Dict[str, Group] = {}
    for (actuator, low, high), group in kept.items():
        name = f"{names[actuator]} {'up' if high > low else 'down'}"
        if sum(key[0] == actuator for key in kept) > 2:
            name += f" {1e-3 * group[-1][2].before:.0f} to {1e-3 * group[-1][2].after:.0f} kPa"
        out[name] = group
    return out


def _time(name: str, symbol: str, found: Tuple[float, float], definition: str) -> Figure:
    value, error = found
    if error > value:
        return Figure.unknown(name, symbol, "s", f"its error of {error:.2g} s is larger than its value of {value:.2g} s.")
    return Figure(name, symbol, value, error, "s", definition)


def _dead_time(name: str, group: Group, parts: List[Response]) -> Figure:
    """Dead time of the pressure behind its command, whose ramp is not part of it."""
    if not all(np.isfinite(recording.target_pa).all() for recording, *_ in group):
        return Figure.unknown(name, "D", "s", "the commands are not known.")
    ramps = []
    for recording, actuator, step, _ in group:
        rows = slice(step.begin, step.end + 1)
        part = (recording.target_pa[rows, actuator] - step.before) / (step.after - step.before)
        early, late = np.interp([0.1, 0.9], part, recording.time_s[rows] - recording.time_s[step.begin])
        ramps.append([early - (late - early) / 8, (late - early) / 0.8])
    begin, ramp = np.median(ramps, axis=0)

    def fitted(some: Sequence[Response]) -> float:
        time, value = _pooled(some)

        def rest(numbers: np.ndarray) -> np.ndarray:
            dead, lag = numbers
            since = np.maximum((time - begin - dead)[:, None] - [0, ramp], 0)
            reached = since - lag * -np.expm1(-since / lag)
            return (reached[:, 0] - reached[:, 1]) / ramp - value

        return float(least_squares(rest, [0, max(ramp / 4, 0.01)], bounds=([-1, 1e-4], [10, 10]), x_scale=0.01).x[0])

    return _time(name, "D", jackknife(parts, fitted),
                 f"Dead time before a lag of first order, fitted to the pressure behind the commanded ramp of {ramp:.2g} s: as the key "
                 "dead_time_s of a scene's regulator; all repeats together, jackknife.")


def _times(name: str, what: str, parts: List[Response]) -> List[Figure]:
    out = []
    for symbol, (level, words) in LEVELS.items():
        out.append(_time(f"{name} {words}, {what}", symbol, time_to(parts, level),
                         f"Time from the start of the commanded step, with its ramp, until the {what} has gone {100 * level:g} % of its "
                         "way to the mean of the last fifth of the hold (step response of IEC 60050-351); all repeats together, "
                         "jackknife."))
    found = overshoot(parts)
    if found is None:
        return out + [Figure.unknown(f"{name} overshoot, {what}", "o", "%", "what exceeds the end may be noise.")]
    out.append(Figure(f"{name} overshoot, {what}", "o", *found, "%",
                      f"Largest excess of the {what} over that mean before the last fifth of the hold, in parts of the way; "
                      "jackknife over the repeats."))
    return out


def _responses(group: Group, what: str) -> List[Response]:
    """The first of more than three repeats conditions the arm."""
    found = []
    for recording, actuator, step, earlier in group[len(group) > 3:]:
        values = recording.tip_m if what == "tip" else recording.measured_pa[:, actuator:actuator + 1]
        found.append(response_of(recording.time_s, values, step, earlier))
    return [one for one in found if one is not None]


def analyse(recordings: Recordings, names: Sequence[str], scene: Optional[Scene] = None) -> Analysis:
    """recordings: steps of one actuator at a time, each size at least twice; or releases without a pressure."""
    out = Analysis()
    groups = _groups(recordings, names)
    for actuator in {driven(one)[0] for one in recordings.values() if one.measured_pa.size}:
        if not any(name.startswith(f"{names[actuator]} ") for name in groups):
            out.figures.append(Figure.unknown(f"{names[actuator]} 63 % time", "t63", "s", NO_STEPS))
    for name, group in groups.items():
        curves = []
        for what in ("pressure", "tip"):
            parts = _responses(group, what)
            if len(parts) < 2:
                why = "start and end are seen in fewer than two repeats."
                out.figures.append(Figure.unknown(f"{name}, {what}", "t63", "s", why))
                continue
            out.figures += _times(name, what, parts)
            if what == "pressure":
                out.figures.append(_dead_time(f"{name} dead time, pressure", group, parts))
            curves.append(Curve(*_smooth(parts), what))
        out.plots.append(Plot(f"{name}: response", "time since the command [s]", "part of the step", curves))
        if " up" in name:
            out.figures.append(_drift(name, group))
    rings: Dict[str, List[Tuple[np.ndarray, np.ndarray]]] = {}
    for name, group in groups.items():
        quiet = [one.value for one in out.figures
                 if one.symbol == "t98" and one.value is not None and one.name.startswith(name) and one.name.endswith("pressure")]
        for recording, actuator, step, _ in group:
            time = recording.time_s
            rows = recording.seen() & (time > time[step.begin] + max(quiet, default=0.0)) & (time <= time[step.end])
            rings.setdefault(names[actuator], []).append((time[rows] - time[step.begin], recording.tip_m[rows]))
    for recording in recordings.values():
        if not recording.measured_pa.size:
            rings.setdefault("arm", []).append((recording.time_s[recording.seen()], recording.tip_m[recording.seen()]))
    for name, some in rings.items():
        out.figures += _ringing(name, some)
    return out


def _drift(name: str, group: Group) -> Figure:
    """Drift of the tip from before the first to before the last step."""
    means, errors = [], []
    for recording, _, step, earlier in (group[0], group[-1]):
        time, tip = recording.time_s, recording.tip_m
        before = (time > max(time[step.begin] - BEFORE_S, time[earlier])) & (time <= time[step.begin]) & recording.seen()
        if before.sum() < 3:
            return Figure.unknown(f"{name} drift of the start", "d0", "mm", "the tip is not seen before the steps.")
        pairs = [correlated_mean(one) for one in tip[before].T]
        means.append([value for value, _ in pairs])
        errors.append([error for _, error in pairs])
    way = 1e3 * (np.array(means[1]) - means[0])
    length = float(np.linalg.norm(way))
    error = 1e3 * np.sqrt(np.sum((way / max(length, 1e-12)) ** 2 * np.sum(np.square(errors), axis=0)))
    return Figure(f"{name} drift of the start", "d0", length, float(error), "mm",
                  f"Distance of the tip before the last of {len(group)} steps from that before the first; readings correlated in "
                  "time count as fewer.")


def _ringing(name: str, rings: List[Tuple[np.ndarray, np.ndarray]]) -> List[Figure]:
    """rings: times and tips of releases, or after steps, once the pressure has come to its end; as of calibrate --fit mode."""
    time, tip = (np.concatenate(parts) for parts in zip(*rings))
    found = _core._ringing(time, np.zeros((len(time), 0)), tip)
    out = []
    for key, symbol, words, unit in (("frequency_hz", "f", "frequency", "Hz"), ("damping", "zeta", "damping ratio", "1")):
        if not found["reason"] and found["found"] < RINGING * found["all"]:
            found["reason"] = f"ringing found only in {found['found']} of {found['all']} releases or steps"
        if found["reason"]:
            out.append(Figure.unknown(f"{name} {words}", symbol, unit, found["reason"] + "."))
        else:
            out.append(Figure(f"{name} {words}", symbol, *found[key], unit,
                              f"Natural {words} of the slowest ringing after releases, or after steps once the pressure has gone "
                              "98 % of its way; a decaying sine beside an exponential, residuals correlated in time."))
    return out
