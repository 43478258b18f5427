"""A scene file and what its model computes."""
from __future__ import annotations

import copy
import json
import os
import pathlib
from typing import Any, Dict, List, Mapping, Optional, Sequence, Union

import numpy as np

from helix_arm import _core, results

Numbers = Union[np.ndarray, Sequence[Any]]
PathLike = Union[str, "os.PathLike[str]"]
Data = Union[PathLike, Mapping[str, Numbers]]


def shipped_scenes() -> List[str]:
    """Names of the shipped scenes, for Scene.load()."""
    return _core.shipped_scenes()


def _path_of(path_or_name: PathLike) -> str:
    text = os.fspath(path_or_name) if isinstance(path_or_name, os.PathLike) else path_or_name
    if not isinstance(text, str):
        raise TypeError(f"path_or_name is {type(path_or_name).__name__}; expected str or os.PathLike of str")
    path = _core.scene_path(text)
    # Another process, or this one later, may be in another folder. "" stays what no file is called.
    return str(pathlib.Path(path).absolute()) if path else path


def _data_of(data: Any) -> Any:
    if isinstance(data, os.PathLike):
        return os.fspath(data)
    return dict(data) if isinstance(data, Mapping) else data


def _list_of(given: Any, name: str, expected: str) -> List[Any]:
    try:
        if not isinstance(given, (str, bytes)):
            return list(given)
    except TypeError:
        pass
    raise TypeError(f"{name} is of type {type(given).__name__}; expected {expected}")


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

    def forward(self, pressures_pa: Numbers, threads: int = 1) -> _core.Forward:
        """Shapes at gauge pressures.

        pressures_pa: (n,) or (N, n) float64 within the limits [Pa]; of tendons, angles [rad].
        threads: of a batch; 0 for all cores. The result does not depend on it.
        Returns a Forward: tips [m], quaternions_xyzw, twists [m, rad], converged.
        Raises TypeError or ValueError naming argument and rule.
        """
        return self._forward(pressures_pa, threads)

    def tips(self, pressures_pa: Numbers, out: Optional[np.ndarray] = None, threads: int = 1) -> np.ndarray:
        """Tip positions alone, the fastest way from pressures to tips.

        pressures_pa, threads: as of forward().
        out: float64 array of the result's shape that is written instead of a new one; it must not overlap the pressures.
        Returns (3,) or (N, 3), base frame [m]; NaN where no shape balances the load.
        """
        return self._tips(pressures_pa, out, threads)

    def curve(self, pressures_pa: Numbers, points: int = 50, threads: int = 1) -> results.Curve:
        """Points of the base curve at gauge pressures, evenly along it, with base and tip.

        pressures_pa: (n,) or (N, n) [Pa]. points: per row, >= 2. threads: of a batch; 0 for all cores.
        """
        return results.Curve(**self._curve(pressures_pa, points, threads))

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
        return results.Inverse(**self._inverse(tip, pose, twists, start, prefer, cocontraction, position_tolerance_m, threads))

    def jacobian(self, pressures_pa: Numbers, threads: int = 1, *,
                 by: Union[str, Sequence[str]] = ("pressures", "lengths", "stiffness", "load")) -> results.Jacobian:
        """Derivatives of tip and twists with respect to pressures, free lengths, stiffness and a load at the tip.

        pressures_pa: (n,) or (N, n) [Pa]. threads: of a batch; 0 for all cores. by: with respect to what, one or several of
        these words; the fields of the others are None. Stiffness and load take most of the time. Analytic; under load, by the
        implicit function theorem at the tier's own equilibrium.
        """
        words = [by] if isinstance(by, str) else _list_of(by, "by", "a list of words, such as [\"pressures\"]")
        return results.Jacobian(**self._jacobian(pressures_pa, words, threads))

    def workspace(self, points: int = 100_000, *, seed: int = 1, sensitivity: bool = False, extremes: bool = False,
                  threads: int = 0) -> results.Workspace:
        """Reachable tips, at pressures drawn uniformly within the limits.

        seed: the same seed gives the same points, on any number of threads. sensitivity: adds the tip displacements for errors
        of 1 kPa, 1 mm and 1 %. extremes: adds the farthest tips, by a search. threads: 0 for all cores.
        """
        return results.Workspace(**self._workspace(points, seed, sensitivity, extremes, threads))

    def fit(self, captures: Data) -> results.Fit:
        """Measured tags to one shape per capture.

        captures: data set of tag poses or tag corners: a path, or a dict of columns by the names that a file has, such as
        capture, pressure_1_kpa, tag, x_m, y_m, z_m, qx, qy, qz, qw, in those units.
        """
        return results.Fit(**self._fit(_data_of(captures)))

    def localize(self, image: np.ndarray, pressures_pa: Optional[Numbers] = None) -> Union[results.Sight, List[results.Sight]]:
        """The arm's shape in a gray picture of the scene's camera, or in each picture of a series.

        image: (height, width) or (N, height, width) uint8. A series counts as successive pictures of one camera: tags are
        tracked. pressures_pa: (n,) or (N, n) [Pa], where the search begins; default: the lower limits.
        """
        sights = [results.Sight(**sight) for sight in self._localize(image, pressures_pa)]
        return sights[0] if image.ndim == 2 else sights

    def calibrate(self, data: Union[Data, Sequence[Data]], fit: Sequence[str] = ("stiffness",), *, contraction: str = "",
                  curvature_noise_rad: float = 0.0, corner_noise_px: float = 0.0, position_noise_m: float = 0.0,
                  rotation_noise_rad: float = 0.0, errors: bool = True) -> results.Calibration:
        """Stiffness, lengths, base and placements of tags from measurements, with their standard errors.

        data: one or several data sets: curvatures, tag poses, tag corners or free lengths; each a path, or a dict of columns as
        of fit(). fit: words of docs/calibration.md, such as stiffness, length_scale, base, tags, contraction.
        contraction: name of the curve to fit, if the scene has several. Noises: expected standard deviations; 0: the scene's.
        errors: False fits the values alone, in the least time: standard errors, verdicts and what follows from them are None or
        empty in the result, and no parameter is held at the scene's value.
        """
        sets = [data] if isinstance(data, (str, os.PathLike, Mapping)) else _list_of(
            data, "data", "the path of a data set, a dict of its columns, or a list of those")
        words = [fit] if isinstance(fit, str) else _list_of(fit, "fit", "a list of words, such as [\"stiffness\"]")
        found = self._calibrate([_data_of(one) for one in sets], words, contraction, curvature_noise_rad, corner_noise_px,
                                position_noise_m, rotation_noise_rad, errors)
        found["parameters"] = [results.Parameter(**one) for one in found["parameters"]]
        found["combinations"] = [results.Combination(**one) for one in found["combinations"]]
        found["contractions"] = [results.Contraction(**one) for one in found["contractions"]]
        return results.Calibration(**found)

    def follow(self, tips: Optional[Numbers] = None, *, path: Optional[Numbers] = None, seconds: float, open: bool = False,
               sight: str = "corners", force: Optional[Numbers] = None, blind: Optional[Numbers] = None,
               latency_s: float = 0.06, seed: int = 1, rig: Optional["Scene"] = None) -> results.FollowRun:
        """The simulated arm follows tips or a path, with the loop closed over vision. In one thread, with a simulated time.

        tips: (3,) or (N, 3) [m], which share the seconds evenly. path: (N, 4) times [s] and positions x, y, z [m].
        open: the model alone commands. sight: "corners" (with noise, fast) or "rendered" (pictures). force: (4,) a time [s]
        and the force on the true tip from then on [N], base frame. blind: (2,) times between which pictures are lost [s].
        rig: scene of the true arm, if it is another one.
        """
        found = self._follow(tips, path, seconds, open, sight, force, blind, latency_s, seed, rig)
        found["alarms"] = [results.Alarm(**one) for one in found["alarms"]]
        return results.FollowRun(**found)

    def __repr__(self) -> str:
        return f"<helix_arm.Scene {self.name}: {len(self.actuators)} actuators, tier {self.tier}>"
