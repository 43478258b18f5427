"""The interface of an experiment: inputs, recordings, and the rig between them."""
from __future__ import annotations

import csv
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Dict, List, Optional, Protocol

import numpy as np
import yaml

from helix_arm import _core
from helix_arm.scene import Scene

STEP_S = 0.01  # of the simulated rig
PICTURE_S = 1 / 30  # of its camera
SWEEP = 100  # steps between two looks at what may stop it
FASTEST_S = 0.1  # for a whole range of pressure, where the scene limits no rate


@dataclass(frozen=True)
class Inputs:
    """A command: straight lines between points.

    time_s: (k,) ascending from 0. pressure_pa: (k, n) gauge [Pa], in the scene's order of actuators. name: of the trial.
    """

    time_s: np.ndarray
    pressure_pa: np.ndarray
    name: str = ""

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """(m, n) [Pa] at times (m,); before the first point and after the last one, the pressures there."""
        return np.stack([np.interp(time_s, self.time_s, one) for one in self.pressure_pa.T], axis=1)


@dataclass(frozen=True)
class Recording:
    """Measurements while inputs were commanded, a row for each reading.

    time_s: (m,) since the inputs began. target_pa, measured_pa: (m, n) gauge [Pa]. tip_m: (m, 3) seen from the base, NaN in rows
    without a picture in which the tip is seen. ended: "", or why the rig stopped before the end of the inputs.
    """

    time_s: np.ndarray
    target_pa: np.ndarray
    measured_pa: np.ndarray
    tip_m: np.ndarray
    ended: str = ""

    @staticmethod
    def of(rows: np.ndarray, ended: str = "") -> "Recording":
        """rows: (m, 1 + 2 n + 3) as a RowSink gets them."""
        n = (rows.shape[1] - 4) // 2
        return Recording(rows[:, 0], rows[:, 1:1 + n], rows[:, 1 + n:1 + 2 * n], rows[:, 1 + 2 * n:], ended)

    def seen(self) -> np.ndarray:
        """(m,) whether the tip is seen in a row."""
        return np.isfinite(self.tip_m).all(axis=1)


# Gets rows (k, 1 + 2 n + 3) as they are measured: time [s], targets (n) and readings (n) [Pa], tip (3) [m] or NaN.
RowSink = Callable[[np.ndarray], None]


class Rig(Protocol):
    """An arm that can be driven and measured.

    origin: which rig it is, in one line: two that differ in what they measure differ in it. limits_pa: (n, 2) gauge [Pa].
    slew_pa_s: highest rate of the targets [Pa/s]. rate_hz: pictures per second in which the tip is seen. hangs: whether
    hang() works.
    """

    origin: str
    limits_pa: np.ndarray
    slew_pa_s: float
    rate_hz: float
    hangs: bool

    def record(self, inputs: Inputs, stop: Callable[[], str], sink: RowSink) -> Recording:
        """Commands the inputs and measures, until their end, until stop() gives a reason, or until the rig cannot go on: loss of
        sight, contact, leak, fault. In the last two cases it vents and says why in `ended`; what was measured is returned.

        stop: asked at least once per second. sink: gets all rows, within a second.
        """

    def hang(self, force_n: np.ndarray) -> None:
        """Sets a force (3,) at the tip, base frame [N], that stays until the next one. Raises RuntimeError where hangs is false."""


def slew_of(scene: Scene) -> float:
    """Rate that the safety core allows all targets, and at most a range in FASTEST_S [Pa/s]."""
    return min(*scene._slew_pa_s, float(np.ptp(scene.limits_pa, axis=1).max()) / FASTEST_S)


def with_load(scene: Scene, mass_kg: float = 0.0, force_n: np.ndarray = np.zeros(3)) -> Scene:
    """The scene that is told of a mass and a force (3,), base frame [N], at the tip besides its own load.

    Raises DocumentError without K_eps_n.
    """
    with open(scene.path, encoding="utf-8") as file:
        load = yaml.safe_load(file).get("load") or {}
    told, tip = {"load.mass_kg": str(load.get("mass_kg", 0)), **dict(scene._overrides)}, load.get("tip") or {}
    mass = yaml.safe_load(told.get("load.tip.mass_kg", "null")) or tip.get("mass_kg") or 0.0
    force = yaml.safe_load(told.get("load.tip.force_n", "null")) or tip.get("force_n") or [0.0, 0.0, 0.0]
    told["load.tip.mass_kg"] = str(mass + mass_kg)
    told["load.tip.force_n"] = str([float(one) for one in np.array(force) + scene._rotation_WB @ force_n])
    return Scene.load(scene.path, told)


class SimulatedRig:
    """The simulated rig of a scene: regulators with lag and noise, the true arm with its motion, and a camera that sees tags.

    rig: scene of the true arm, if it is another one. plant: command of a program that is the true arm (docs/closed_loop.md).
    seed: of the readings' and the camera's noise, together with the name of the inputs. Each record() is of an arm that has rested
    for long. true_tip_m: (m, 3) of the last recording.
    Raises ValueError where nothing sees the arm of a scene; record() raises RuntimeError naming a plant that fails.
    """

    def __init__(self, scene: Scene, rig: Optional[Scene] = None, plant: str = "", seed: int = 1) -> None:
        for one in (scene, rig or scene):
            if not one._has_vision:
                raise ValueError(f"scene {one.name} has neither camera and tags nor bodies, so that its simulated rig is not seen; add them")
        self._parts, self._seed = (scene, rig or scene, plant), seed
        true = rig or scene
        self.origin = f"simulated rig {true.name} {true._sha256[:12]}{', plant ' + plant if plant else ''}, seed {seed}"
        self.limits_pa, self.rate_hz = scene.limits_pa, 1 / PICTURE_S
        self.slew_pa_s = slew_of(scene)
        self._force = np.zeros(3)
        try:
            _core.ExperimentRig(*self._parts[:2], "", seed).hang(np.array([1e-3, 0, 0]))
            self.hangs = True
        except ValueError:  # no K_eps_n
            self.hangs = False

    def hang(self, force_n: np.ndarray) -> None:
        self._force = np.asarray(force_n, float)

    def record(self, inputs: Inputs, stop: Callable[[], str], sink: RowSink) -> Recording:
        rig = _core.ExperimentRig(*self._parts, (self._seed + zlib.crc32(inputs.name.encode())) % 2**32)
        rig.hang(self._force)
        times = STEP_S * np.arange(1, round(inputs.time_s[-1] / STEP_S) + 1)
        looks = np.diff(np.floor(np.append(0, times) / PICTURE_S + 1e-9)) > 0  # a picture in the step in which its time comes
        # A force bends an arm unevenly; vision, which fits mean twists, takes that from a model that knows the force.
        scene = with_load(self._parts[0], force_n=self._force) if self._force.any() else self._parts[0]
        targets, parts, true, ended = inputs.at(times), [np.zeros((0, 4 + 2 * inputs.pressure_pa.shape[1]))], [np.zeros((0, 3))], ""
        for begin in range(0, len(times), SWEEP):
            if ended := stop():
                break
            piece = slice(begin, begin + SWEEP)
            seen = rig.advance(scene, targets[piece], STEP_S, looks[piece])
            parts.append(np.column_stack([times[piece], targets[piece], seen[:, :-3]]))
            true.append(seen[:, -3:])
            sink(parts[-1])
        self.true_tip_m = np.concatenate(true)
        return Recording.of(np.concatenate(parts), ended)


def columns(actuators: int) -> List[str]:
    """Names of the columns of a series, as helix_arm calibrate takes it."""
    return ["trial", "time_s", *(f"{what}_{i + 1}_kpa" for what in ("commanded", "pressure") for i in range(actuators)),
            "x_m", "y_m", "z_m", "seen"]


def lines_of(trial: str, rows: np.ndarray) -> str:
    """Lines of CSV of rows as a RowSink gets them."""
    lines = []
    for row in rows:
        seen = bool(np.isfinite(row[-3:]).all())
        cells = [f"{row[0]:.4f}", *(f"{1e-3 * p:.4f}" for p in row[1:-3]), *(f"{x:.8f}" if seen else "0" for x in row[-3:])]
        lines.append(",".join([trial, *cells, str(int(seen))]) + "\n")
    return "".join(lines)


def read_series(path: Path, actuators: int) -> Dict[str, Recording]:
    """The trials of a series by their names, in the file's order: that of a rig, or another one with measured pressures and tips.

    Targets that the file lacks are NaN; a pressure that it lacks is 0, as in all data sets. Raises ValueError naming file, line
    and rule.
    """
    trials: Dict[str, List[List[float]]] = {}
    with open(path, encoding="utf-8", newline="") as file:
        table = csv.DictReader(line for line in file if not line.startswith("#"))
        for column in ("time_s", "x_m", "y_m", "z_m"):
            if column not in (table.fieldnames or []):
                expected = ", ".join(columns(actuators))
                raise ValueError(f"{path} has no column {column}; expected those of a series of the tip: {expected}")
        for row in table:
            try:
                trials.setdefault(row.get("trial") or "1", []).append(_numbers(row, actuators))
            except (TypeError, ValueError) as error:
                raise ValueError(f"{path}:{table.line_num} holds no number where one is expected ({error})") from None
    return {trial: Recording.of(np.array(rows)) for trial, rows in trials.items()}


def _numbers(row: Dict[str, str], actuators: int) -> List[float]:
    def kpa(what: str, i: int, missing: float) -> float:
        text = row.get(f"{what}_{i + 1}_kpa")
        return missing if text is None else 1e3 * float(text)

    tip = [float(row[axis]) for axis in ("x_m", "y_m", "z_m")]
    if row.get("seen") == "0":
        tip = [np.nan] * 3
    return [float(row["time_s"]), *(kpa("commanded", i, np.nan) for i in range(actuators)),
            *(kpa("pressure", i, 0.0) for i in range(actuators)), *tip]
