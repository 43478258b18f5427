"""A scene file and what its model computes."""
from __future__ import annotations

import copy
import json
import os
import pathlib
import warnings
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from helix_arm import _core, arguments, results
from helix_arm.arguments import require
from helix_arm.dynamics import ENERGIES, Dynamics, Start, order_and_step, start_of

REST_OFFSET = 0.0005  # of the tip from trial to trial of a series, per axis [m]

Numbers = Union[np.ndarray, Sequence[Any]]
PathLike = Union[str, "os.PathLike[str]"]
Data = Union[PathLike, Mapping[str, Numbers]]

# Columns of the numbers of a run, before those of the pressures.
FOLLOW_COLUMNS = {"times_s": 1, "wanted_tips": 3, "true_tips": 3, "measured_tips": 3, "measured_times_s": 1,
                  "predicted_tips": 3, "path_times_s": 1, "load_scores": 1}


def shipped_scenes() -> List[str]:
    """Names of the shipped scenes, for Scene.load()."""
    return _core.shipped_scenes()


def _path_of(path_or_name: PathLike) -> str:
    text = os.fspath(path_or_name) if isinstance(path_or_name, os.PathLike) else path_or_name
    if not isinstance(text, str):
        raise TypeError(f"path_or_name is {type(path_or_name).__name__}; expected str or os.PathLike of str")
    arguments.text(text, "path_or_name")
    try:
        path = _core.scene_path(text)
    except ValueError as error:
        raise type(error)(f"path_or_name: {error}") from None
    # Another process, or this one later, may be in another folder. "" stays what no file is called.
    return str(pathlib.Path(path).absolute()) if path else path


def _yaml_of(key: str, value: Any) -> str:
    if isinstance(value, str):
        return value
    try:
        return json.dumps(value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"overrides[{key!r}] is {type(value).__name__}; expected text, numbers, or lists and "
                        "dicts of them") from error


class Scene(_core.Scene):
    """A scene file: an arm and its rig. Immutable; threads may share it. Another process reads the file again."""

    def __init__(self, path: str, overrides: Sequence[Tuple[str, str]] = ()) -> None:
        expected = "a list of pairs of key and YAML text"
        if not isinstance(overrides, (list, tuple)):
            arguments.refuse_type(overrides, "overrides", expected)
        pairs = []
        for one in overrides:
            if not isinstance(one, tuple) or len(one) != 2:
                arguments.refuse_type(one, "an entry of overrides", expected)
            key = arguments.text(one[0], "a key of overrides")
            pairs.append((key, arguments.text(one[1], f"overrides['{key}']")))
        super().__init__(arguments.text(path, "path"), pairs)

    @classmethod
    def load(cls, path_or_name: PathLike, overrides: Mapping[str, Any] = {}) -> "Scene":
        """Reads and checks a scene file.

        path_or_name: path of a scene file, or name of a shipped scene.
        overrides: values by dotted key, as of --set: {"arm.stiffness.K_gamma": 100}. Text counts as YAML.
        Raises DocumentError, a ValueError, with all faults: `file:line key value rule`.
        """
        if not isinstance(overrides, Mapping):
            raise TypeError(f"overrides is {type(overrides).__name__}; expected a dict of values by dotted key")
        return cls(_path_of(path_or_name), [(str(key), _yaml_of(key, value)) for key, value in overrides.items()])

    def __reduce__(self) -> Any:
        return type(self), (self.path, self._overrides), vars(self) or None

    def __copy__(self) -> "Scene":
        other = self._again()
        vars(other).update(vars(self))
        return other

    def __deepcopy__(self, memo: Dict[int, Any]) -> "Scene":
        other = memo[id(self)] = self._again()
        vars(other).update(copy.deepcopy(vars(self), memo))
        return other

    def _again(self) -> "Scene":
        """Itself, as it is immutable, unless someone gave it attributes."""
        return type(self)(self.path, self._overrides) if vars(self) else self

    def forward(self, pressures_pa: Numbers, threads: int = 1) -> results.Forward:
        """Shapes at gauge pressures.

        pressures_pa: (n,) or (N, n) within the limits [Pa]; of tendons, angles [rad].
        threads: of a batch; 0 for all cores. The result does not depend on it.
        Returns a Forward: tips [m], quaternions_xyzw, twists [m, rad], converged.
        Raises TypeError or ValueError naming argument and rule.
        """
        return results.Forward(*self._forward(pressures_pa, arguments.threads(threads)))

    def tips(self, pressures_pa: Numbers, out: Optional[np.ndarray] = None, threads: int = 1) -> np.ndarray:
        """Tip positions alone, the fastest way from pressures to tips.

        pressures_pa, threads: as of forward().
        out: float64 array of the result's shape that is written instead of a new one; it must not overlap the pressures.
        Returns (3,) or (N, 3), base frame [m]; NaN where no shape balances the load.
        """
        if out is not None:
            pressures_pa = arguments.apart(_core.rows(pressures_pa, "pressures_pa", len(self.limits_pa)), out)
        return self._tips(pressures_pa, out, arguments.threads(threads))

    def curve(self, pressures_pa: Numbers, points: int = 50, threads: int = 1) -> results.Curve:
        """Points of the base curve at gauge pressures, evenly along it, with base and tip.

        pressures_pa: (n,) or (N, n) [Pa]. points: per row, >= 2. threads: of a batch; 0 for all cores.
        """
        arguments.integer(points, "points", 2, 100_000)
        found = self._curve(pressures_pa, points, arguments.threads(threads))
        return results.Curve(s=float(self.sections) * np.arange(points) / (points - 1), **found)

    def inverse(self, tip: Optional[Numbers] = None, *, pose: Optional[Numbers] = None, twists: Optional[Numbers] = None,
                start: Optional[Numbers] = None, prefer: str = "min-pressure", cocontraction: float = 0.5,
                position_tolerance_m: float = 1e-6, threads: int = 1) -> results.Inverse:
        """Pressures within the limits for one kind of target, base frame.

        tip: (3,) or (N, 3) positions [m]. pose: (7,) or (N, 7) x, y, z [m], qx, qy, qz, qw.
        twists: (sections, 6) or (N, sections, 6), v [m] and w [rad].
        start: (n,) or (N, n) pressures at which the search begins [Pa]; default: the lower limits.
        prefer: which of the pressures that reach it: "min-pressure", "min-change" (from the start), "cocontract",
        with cocontraction in [0, 1] as the wanted fraction of each range, or "stiff": the least compliance of the tip.
        """
        given = [(kind, target) for kind, target in [("tip", tip), ("pose", pose), ("twists", twists)] if target is not None]
        require(len(given) == 1, f"inverse() got {len(given)} targets; expected exactly one of tip, pose and twists")
        (kind, target), = given
        if kind == "twists":
            target, rows = _core.array(target, kind), f"{self.sections}, 6"
            fits = target.ndim in (2, 3) and target.shape[-2:] == (self.sections, 6)
            require(fits, f"twists has shape {target.shape}; expected ({rows}) or (N, {rows})")
            target = target.reshape(*target.shape[:-2], 6 * self.sections)
        found = self._inverse(kind, target, start, arguments.text(prefer, "prefer"),
                              arguments.number(cocontraction, "cocontraction"),
                              arguments.number(position_tolerance_m, "position_tolerance_m"), arguments.threads(threads))
        self._warn_of_millimetres(target, kind)
        status = np.array(["reached", "unreachable", "not_converged"])[found.pop("status")]
        if isinstance(status, str):  # of one row
            status = str(status)
        return results.Inverse(reached=status == "reached", status=status, **found)

    def motion(self, pressures_pa: Numbers, times_s: Numbers, *, start: Start = "rest", order: Optional[int] = None,
               step_s: Optional[float] = None, threads: int = 1) -> results.Motion:
        """Motion of the tip while pressures go linearly from row to row; needs load.mass_kg of the scene.

        pressures_pa: (T, n), or (rollouts, T, n) within the limits [Pa]. times_s: (T,) ascending [s].
        start: "rest", in equilibrium under load at the first row, "straight", at natural length, or a state (2, n) of Dynamics.
        order: degree of the strain along each section, 0 to 4. step_s: longest step. By default those of the scene's `dynamics`.
        threads: of a batch; 0 for all cores. The result does not depend on it.
        Equations: docs/motion.md. Raises ValueError naming the row that breaks a rule.
        """
        times = _core.array(times_s, "times_s")
        require(times.ndim == 1 and len(times) > 0, f"times_s has shape {times.shape}; expected (T,)")
        pressures, n = _core.array(pressures_pa, "pressures_pa"), len(self.limits_pa)
        fits = pressures.ndim in (2, 3) and pressures.shape[-2:] == (len(times), n)
        require(fits, f"pressures_pa has shape {pressures.shape}; expected ({len(times)}, {n}) or (rollouts, {len(times)}, {n})")
        tips, quaternions, energies, steps = self._motion(
            pressures.reshape(-1, n), times.tolist(), start_of(start), threads=arguments.threads(threads), **order_and_step(order, step_s))
        if pressures.ndim == 2:
            tips, quaternions, energies, steps = tips[0], quaternions[0], energies[0], int(steps[0])
        return results.Motion(times, tips, quaternions, steps, dict(zip(ENERGIES, np.moveaxis(energies, -1, 0))))

    def dynamics(self, pressures_pa: Optional[Numbers] = None, *, start: Start = "rest", order: Optional[int] = None,
                 step_s: Optional[float] = None) -> Dynamics:
        """The arm in motion, step by step, and its small motions; needs load.mass_kg of the scene.

        pressures_pa: (n,) where it starts [Pa]; default: the lower limits. start, order, step_s: as of motion().
        """
        return Dynamics(self, self.limits_pa[:, 0] if pressures_pa is None else pressures_pa, start, order, step_s)

    def jacobian(self, pressures_pa: Numbers, threads: int = 1, *,
                 by: Union[str, Sequence[str]] = ("pressures", "lengths", "stiffness", "load")) -> results.Jacobian:
        """Derivatives of tip and twists with respect to pressures, free lengths, stiffness and a load at the tip.

        pressures_pa: (n,) or (N, n) [Pa]. threads: of a batch; 0 for all cores. by: with respect to what, one or several of
        these words; the fields of the others are None. Stiffness and load take most of the time. Analytic; under load, by the
        implicit function theorem at the tier's own equilibrium.
        """
        words, known = arguments.words(by, "by", "pressures"), ["pressures", "lengths", "stiffness", "load"]
        expected = "expected one or several of " + ", ".join(known)
        require(bool(words), f"by is empty; {expected}")
        for word in words:
            require(word in known, f"by holds \"{repr(word[:60])[1:-1]}\"; {expected}")
        converged, found = self._jacobian(pressures_pa, [word in words for word in known], arguments.threads(threads))
        names = [f"{part}_by_{word}" for word in known for part in ["tip", "twists"]]
        return results.Jacobian(converged=converged, **dict(zip(names, found)))

    def payload(self, tip: Numbers, directions: Optional[Numbers] = None, *, moment: Numbers = (0.0, 0.0, 0.0),
                tolerance: float = 0.01, threads: int = 1) -> results.Payload:
        """The largest forces that the tip carries at places, in D directions, base frame.

        tip: (3,) or (N, 3) [m]. directions: (3,) or (D, 3), of any length; default: 26. moment: also acts on the tip [N m].
        tolerance: distance up to which the tip counts as there, as a fraction of the arm's length. threads: of a batch; 0 for
        all cores. The scene's load acts, too. Raises ValueError for an arm without K_eps_n.
        """
        ways = _core.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z]
                           if directions is None else directions, "directions")
        require(ways.ndim in (1, 2) and ways.shape[-1] == 3, f"directions has shape {ways.shape}; expected (3,) or (D, 3)")
        ways = ways.reshape(-1, 3)
        lengths = np.linalg.norm(ways, axis=1, keepdims=True)
        require(bool(len(ways)) and bool((lengths > 0).all()), "directions is empty, or one is 0; expected other vectors")
        turn, = arguments.rows(moment, "moment", 3, most=1)
        found = self._payload(tip, ways / lengths, turn.tolist(), arguments.number(tolerance, "tolerance"),
                              arguments.threads(threads))
        ends = np.array(["limits", "unstable", "unactuated", "unreached", "none"])[found.pop("ends")]
        return results.Payload(directions=ways / lengths, ends=ends, **found)

    def attain(self, twists: Numbers, force: Optional[Numbers] = None, moment: Optional[Numbers] = None, *,
               tolerance: float = 0.01, threads: int = 1) -> results.Attainment:
        """Whether the arm can hold shapes under loads, and what is missing.

        twists: (sections, 6) or (N, sections, 6), v [m] and w [rad]; or of m pieces of each section, (m sections, 6) and so on.
        force, moment: (4,) or (N, 4): s, which runs over [k, k + 1] along section k and whose end is the tip, and x, y, z, base
        frame [N], [N m]. The scene's load acts, too. tolerance: residual up to which a shape counts as attainable, as a fraction of
        largest_force_n. threads: of a batch; 0 for all cores. Raises ValueError for an arm without K_eps_n.
        """
        shapes = _core.array(twists, "twists")
        fits = shapes.ndim in (2, 3) and shapes.shape[-1] == 6 and shapes.shape[-2] > 0 and shapes.shape[-2] % self.sections == 0
        require(fits, f"twists has shape {shapes.shape}; expected ({self.sections}, 6) or (N, {self.sections}, 6), or a multiple "
                "of these rows for pieces")
        loads = [np.array([[float(self.sections), 0.0, 0.0, 0.0]]) if one is None else arguments.rows(one, name, 4, 1, 10**9)
                 for one, name in [(force, "force"), (moment, "moment")]]
        most = max(len(one) for one in loads)
        for one, name in zip(loads, ["force", "moment"]):
            require(len(one) in (1, most), f"{name} has {len(one)} rows; expected one, or {most}")
        rows = np.hstack([np.broadcast_to(one, (most, 4)) for one in loads])
        return results.Attainment(**self._attain(
            shapes.reshape(*shapes.shape[:-2], 6 * shapes.shape[-2]), shapes.shape[-2] // self.sections, rows,
            arguments.number(tolerance, "tolerance"), arguments.threads(threads)))

    def workspace(self, points: int = 100_000, *, seed: int = 1, sensitivity: bool = False, extremes: bool = False,
                  threads: int = 0) -> results.Workspace:
        """Reachable tips, at pressures drawn uniformly within the limits.

        seed: the same seed gives the same points, on any number of threads. sensitivity: adds the tip displacements for errors
        of 1 kPa, 1 mm and 1 %. extremes: adds the farthest tips, by a search. threads: 0 for all cores.
        """
        points, seed = arguments.integer(points, "points", 0, 100_000_000), arguments.integer(seed, "seed", 0, 2**63 - 1)
        pieces, unbalanced, farthest = self._workspace(points, seed, arguments.flag(sensitivity, "sensitivity"),
                                                       arguments.flag(extremes, "extremes"), arguments.threads(threads))
        pressures, tips, moved = [np.concatenate(part) for part in zip(*pieces)]
        by_error = moved.T.copy() if sensitivity else [None] * 3
        return results.Workspace(pressures, tips, unbalanced, *by_error, *(farthest or [None] * 2))

    def fit(self, captures: Data) -> results.Fit:
        """Measured tags to one shape per capture.

        captures: data set of tag poses or tag corners: a path, or a dict of columns by the names that a file has, such as
        capture, pressure_1_kpa, tag, x_m, y_m, z_m, qx, qy, qz, qw, in those units.
        """
        found = self._fit(arguments.data_set(captures, "captures"))
        n, size = len(self.actuators), 6 * self.sections

        def column(name: str, *shape: int, dtype: Any = float) -> np.ndarray:
            return np.array([one[name] for one in found], dtype).reshape(len(found), *shape)

        return results.Fit(
            captures=column("capture", dtype=np.intc), pressures_pa=column("pressures_pa", n), status=column("status", dtype=str),
            twists=column("twists", self.sections, 6), covariances=column("covariance", size, size), tips=column("tip", 3),
            quaternions_xyzw=column("quaternion_xyzw", 4), tip_covariances=column("tip_covariance", 3, 3), rms=column("rms"),
            outlier_tags=[one["outlier_tags"] for one in found])

    def evaluate(self, data: Data) -> results.Evaluation:
        """The model against measurements, as `helix_arm evaluate`.

        data: data set of curvatures, tag poses, tag corners or a series of the tip: a path, or a dict of columns as of fit().
        """
        kind, unit, errors = self._evaluate(arguments.data_set(data, "data"))
        sizes = np.abs(errors[np.isfinite(errors)])
        require(len(sizes) > 0, "no row or capture of data can be compared with the model; `helix_arm evaluate` says why")
        return results.Evaluation(kind, unit, errors, float(np.sqrt(np.mean(sizes**2))), float(np.median(sizes)), float(sizes.max()))

    def _warn_of_millimetres(self, given: Any, name: str) -> None:
        """Warns of positions (3) or rows that begin with them, all far beyond the arm; twists are no positions."""
        rows = np.atleast_2d(given)
        if name == "twists" or not len(rows):
            return
        nearest = np.linalg.norm(rows[:, :3], axis=1).min()
        if nearest > 20 * self.length_m:
            warnings.warn(f"{name} is {nearest:g} m or more from the base of an arm of {self.length_m:g} m; expected metres, and "
                          "these seem to be millimetres", stacklevel=3)

    def localize(self, image: np.ndarray, pressures_pa: Optional[Numbers] = None) -> Union[results.Sight, List[results.Sight]]:
        """The arm's shape in a gray picture of the scene's camera, or in each picture of a series.

        image: (height, width) or (N, height, width) uint8. A series counts as successive pictures of one camera: tags are
        tracked. pressures_pa: (n,) or (N, n) [Pa], where the search begins; default: the lower limits.
        """
        shape = self._picture_shape
        require(shape is not None, f"localize() needs camera and tags, but scene {self.name} lacks one; expected a scene with "
                "sections camera and tags")
        pictures = arguments.pictures(image, shape)
        found = self._localize(pictures, self.limits_pa[:, 0] if pressures_pa is None else pressures_pa)
        for one in found:
            one["rms_px"], one["corners_px"] = one.pop("rms"), one["corners_px"].reshape(-1, 4, 2)
        sights = [results.Sight(**one) for one in found]
        return sights[0] if image.ndim == 2 else sights

    def calibrate(self, data: Union[Data, Sequence[Data]], fit: Sequence[str] = ("stiffness",), *, contraction: str = "",
                  curvature_noise_rad: float = 0.0, corner_noise_px: float = 0.0, position_noise_m: float = 0.0,
                  rotation_noise_rad: float = 0.0, rest_offset_m: float = REST_OFFSET, errors: bool = True,
                  force: bool = False, apply_suspect: int = 0) -> results.Calibration:
        """Stiffness, lengths, base and placements of tags from measurements, with their standard errors.

        data: one or several data sets: curvatures, tag poses, tag corners, free lengths or series of the tip; each a path, or a dict of
        columns as of fit(), of which trial may hold texts. fit: words of docs/calibration.md, such as stiffness, length_scale, base, tags, contraction.
        contraction: name of the curve to fit, if the scene has several. Noises: expected standard deviations; 0: the scene's.
        rest_offset_m: expected standard deviation of the tip's offset from trial to trial, per axis, of a series; 0: none.
        errors: False fits the values alone, in the least time: standard errors, verdicts and what follows from them are None or
        empty in the result, and no parameter is held at the scene's value. force: accept a fit that a suspect explains by 90 %, that
        predicts worse than before, or stays beyond five times the noise. apply_suspect: correct the captures as it does, from 1; 0: none.
        """
        sets = [data] if isinstance(data, (str, os.PathLike, Mapping)) else arguments.items(
            data, "data", "the path of a data set, a dict of its columns, or a list of those")
        words = arguments.words(fit, "fit", "stiffness")
        noises = [arguments.number(value, name, 0, expected="a finite number >= 0, 0 for the scene's")
                  for name, value in [("curvature_noise_rad", curvature_noise_rad), ("corner_noise_px", corner_noise_px),
                                      ("position_noise_m", position_noise_m), ("rotation_noise_rad", rotation_noise_rad)]]
        noises.append(arguments.number(rest_offset_m, "rest_offset_m", 0, expected="a finite number >= 0, 0 for none"))
        arguments.text(contraction, "contraction")
        arguments.flag(errors, "errors")
        arguments.flag(force, "force")
        require(bool(sets), "data is empty; expected paths of data sets, or dicts of columns")
        tables = [arguments.data_set(one, f"data[{i}]") for i, one in enumerate(sets)]
        suspect = arguments.integer(apply_suspect, "apply_suspect", 0, 5)
        found = self._calibrate(tables, words, contraction, noises, errors, force=force, apply_suspect=suspect)
        if found["next_pressures_pa"] is not None:
            found["next_pressures_pa"] = np.array(found["next_pressures_pa"] or np.zeros((0, 0)))
        for name, kind in (("parameters", results.Parameter), ("combinations", results.Combination),
                           ("suspects", results.Suspect), ("contractions", results.Contraction)):
            found[name] = [kind.of(one) for one in found[name]]
        return results.Calibration.of(found)

    def follow(self, tips: Optional[Numbers] = None, *, path: Optional[Numbers] = None, seconds: Optional[float] = None, open: bool = False,
               sight: str = "corners", force: Optional[Numbers] = None, blind: Optional[Numbers] = None,
               latency_s: float = 0.06, seed: int = 1, rig: Optional["Scene"] = None,
               plant: Optional[str] = None) -> results.FollowRun:
        """The simulated arm follows tips or a path, with the loop closed over vision. In one thread, with a simulated time.

        tips: (3,) or (N, 3) [m], which share the seconds evenly. path: (N, 4) times [s] and positions x, y, z [m];
        without seconds, the run ends with it.
        open: the model alone commands. sight: "corners" (with noise, fast) or "rendered" (pictures). force: (4,) a time [s]
        and the force on the true tip from then on [N], base frame. blind: (2,) times between which pictures are lost [s].
        rig: scene of the true arm, if it is another one. plant: command of a program that is the true arm (docs/closed_loop.md);
        RuntimeError names it if it fails.
        """
        require(seconds is not None or tips is None, "seconds is missing, which tips need")
        seconds = None if seconds is None else arguments.number(seconds, "seconds", 0.1, 3600)
        latency_s = arguments.number(latency_s, "latency_s", 0, 1)
        seed = arguments.integer(seed, "seed", 0, 2**32 - 1)
        arguments.flag(open, "open")
        require(arguments.text(sight, "sight") in ("corners", "rendered"),
                f"sight is \"{sight[:40]}\"; expected corners or rendered")
        if rig is not None and not isinstance(rig, _core.Scene):
            arguments.refuse_type(rig, "rig", "a Scene or None")
        plant = "" if plant is None else arguments.text(plant, "plant")
        require((tips is None) != (path is None), "follow() needs either tips or path; expected exactly one")
        targets, path = arguments.rows(tips, "tips", 3, most=1000), arguments.rows(path, "path", 4, 2, 100_000)
        if targets is not None and seconds is not None:
            self._warn_of_millimetres(targets, "tips")
            require(seconds >= len(targets),
                    f"seconds is {seconds:g}, too short for {len(targets)} tips; expected at least 1 s for each")
            for i in np.flatnonzero(np.abs(targets).max(axis=1) > 1e6):
                raise ValueError(f"tips is farther than 1e6 m in row {i}; expected metres from the base")
        push, times = [None if rows is None else rows[0].tolist() for rows in
                       [arguments.rows(force, "force", 4), arguments.rows(blind, "blind", 2)]]
        require(push is None or np.linalg.norm(push[1:]) <= 100, "force is more than 100 N; expected time, x, y, z in s and N")
        if times is not None:
            require(times[0] <= times[1], f"blind ends at {times[1]:g} before it begins at {times[0]:g}; expected from, to [s]")
        found = self._follow(targets, path, seconds, open, sight == "rendered", push, times, latency_s, seed,
                             self if rig is None else rig, plant)
        numbers, states, unreachable, alarms, others = found
        others["budget"] = others["budget"] and results.Budget(**others["budget"])
        others["suspects"] = [results.Suspect(**one) for one in others["suspects"]]
        columns, end = {}, 0
        for name, width in FOLLOW_COLUMNS.items():
            begin, end = end, end + width
            columns[name] = numbers[:, begin].copy() if width == 1 else numbers[:, begin:end].copy()
        return results.FollowRun(pressures_pa=numbers[:, end:].copy(), states=np.array(states, str),
                                 unreachable=np.array(unreachable, bool), alarms=[results.Alarm(**one) for one in alarms],
                                 **columns, **others)

    def __repr__(self) -> str:
        return f"<helix_arm.Scene {self.name}: {len(self.actuators)} actuators, tier {self.tier}>"
