"""An experiment: trials that a rig records, and figures of the recordings."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

from helix_arm.experiments.figures import Figure
from helix_arm.experiments.rig import Inputs, Recording, Rig
from helix_arm.scene import Scene

BASE = 0.1  # of the range: pressure of the actuators that are not driven, and where driven ones begin
RATE = 0.8  # of the slew rate, that inputs use
TAIL_S = 0.5  # vented, at the end of a trial
MOVES = 0.1  # of the largest range of pressure, that of an actuator that moves in a recording
MOVING, MOVING_S = 0.02, 0.25  # of its range within this time to both sides: it moves there [s]


@dataclass(frozen=True)
class Options:
    """Parts of a protocol that a call may change; None: as it is.

    actuators: indices. settle_s: in which the arm comes to rest, measured by `step` before others in `all`.
    """

    actuators: Sequence[int]
    repeats: Optional[int] = None
    hold_s: Optional[float] = None
    settle_s: float = 2.5


@dataclass(frozen=True)
class Trial:
    """Inputs that are recorded in one piece. force_n: (3,) at the tip, base frame [N], meanwhile."""

    name: str
    inputs: Inputs
    force_n: Optional[np.ndarray] = None


@dataclass(frozen=True)
class Curve:
    """A line of a plot, or points where style is "o"."""

    x: np.ndarray
    y: np.ndarray
    label: str = ""
    style: str = "-"


@dataclass(frozen=True)
class Plot:
    title: str
    x: str  # with the unit
    y: str
    curves: List[Curve]
    log: bool = False  # x


@dataclass
class Analysis:
    figures: List[Figure] = field(default_factory=list)
    plots: List[Plot] = field(default_factory=list)


Recordings = Dict[str, Recording]


@dataclass(frozen=True)
class Experiment:
    """plan: trials for a rig and its scene. analyse: of recordings by the names of their trials, names of the actuators, and the
    scene if there is one; those of other rigs, too. needs: what only some rigs can do ("hang"), or ""."""

    plan: Callable[[Rig, Scene, Options], List[Trial]]
    analyse: Callable[[Recordings, Sequence[str], Optional[Scene]], Analysis]
    needs: str = ""


class Course:
    """Builds inputs of straight lines that keep to a rig's limits and slew rate, from vented.

    Raises ValueError on a pressure beyond the limits.
    """

    def __init__(self, rig: Rig) -> None:
        self._limits, self.slew_pa_s = np.asarray(rig.limits_pa, float), RATE * rig.slew_pa_s
        self._times, self._points = [0.0], [np.clip(np.zeros(len(self._limits)), *self._limits.T)]
        self._vented = self._points[0]

    def share(self, shares: np.ndarray) -> np.ndarray:
        """(n) [Pa] at shares (n) of the ranges."""
        return self._limits[:, 0] + shares * (self._limits[:, 1] - self._limits[:, 0])

    def drive(self, actuator: int, share: float) -> np.ndarray:
        """(n) [Pa] with one actuator at a share of its range, and the others at BASE."""
        return self.share(np.where(np.arange(len(self._limits)) == actuator, share, BASE))

    def go(self, pressure_pa: np.ndarray, least_s: float = 0.0) -> "Course":
        """In a straight line, at the slew rate or in least_s, if that is longer."""
        if np.any(pressure_pa < self._limits[:, 0] - 1e-6) or np.any(pressure_pa > self._limits[:, 1] + 1e-6):
            raise ValueError(f"{pressure_pa} Pa is beyond the limits of the rig")
        time = max(float(np.abs(pressure_pa - self._points[-1]).max()) / self.slew_pa_s, least_s)
        return self._add(time, pressure_pa) if time > 0 else self

    def hold(self, time_s: float) -> "Course":
        return self._add(time_s, self._points[-1])

    def points(self, time_s: np.ndarray, pressure_pa: np.ndarray) -> "Course":
        """Points (k, n) at ascending times (k,) > 0 from here, which keep to the slew rate by themselves."""
        rates = np.abs(np.diff(pressure_pa, axis=0, prepend=self._points[-1][None])) / np.diff(time_s, prepend=0)[:, None]
        if rates.max() > self.slew_pa_s / RATE * (1 + 1e-9):
            raise ValueError(f"inputs at {rates.max():.3g} Pa/s, faster than the slew rate of {self.slew_pa_s / RATE:.3g} Pa/s")
        self._times += [self._times[-1] + float(time) for time in time_s]
        self._points += list(pressure_pa)
        return self

    def inputs(self) -> Inputs:
        """Vented at the end."""
        self.go(self._vented).hold(TAIL_S)
        return Inputs(np.array(self._times), np.array(self._points))

    def _add(self, time_s: float, pressure_pa: np.ndarray) -> "Course":
        self._times.append(self._times[-1] + time_s)
        self._points.append(np.clip(pressure_pa, *self._limits.T))
        return self


def pressures_of(recording: Recording) -> np.ndarray:
    """Targets (m, n) [Pa]; where these are not known, readings."""
    return recording.target_pa if np.isfinite(recording.target_pa).all() else recording.measured_pa


def parts_of(recording: Recording) -> List[Recording]:
    """The recording where one actuator moves at most; else its parts in which one moves while the others stand still, each from where
    another one has stopped to where another one begins."""
    every = pressures_of(recording)
    if every.shape[1] < 2 or len(every) < 3:
        return [recording]
    widths = np.ptp(every, axis=0)
    active = np.flatnonzero(widths > MOVES * widths.max())
    if len(active) < 2:
        return [recording]
    time = recording.time_s
    before, after = np.searchsorted(time, time - MOVING_S), np.searchsorted(time, time + MOVING_S) - 1
    moving = np.abs(every[after] - every[before])[:, active] > MOVING * widths[active]
    alone = np.where(moving.sum(axis=1) == 1, moving.argmax(axis=1), -1)
    moves = np.flatnonzero(moving.any(axis=1))
    bounds = [0, *(np.flatnonzero(np.diff(alone[moves])) + 1), len(moves)]
    out = []
    for first, last in zip(bounds, bounds[1:]):
        if first == last or alone[moves[first]] < 0:
            continue
        rows = np.arange(moves[first - 1] + 1 if first > 0 else 0, moves[last] if last < len(moves) else len(time))
        if len(rows) > 2:
            out.append(Recording(*(getattr(recording, name)[rows] for name in ("time_s", "target_pa", "measured_pa", "tip_m"))))
    return out


def driven(recording: Recording) -> Tuple[int, np.ndarray]:
    """The actuator whose pressure changes most, and its target (m,) [Pa]; where that is not known, its reading.

    Raises ValueError without any.
    """
    if recording.measured_pa.size == 0:
        raise ValueError("a recording has no pressures; expected the columns pressure_1_kpa ..")
    every = pressures_of(recording)
    actuator = int(np.argmax(np.subtract(*np.percentile(every, [97, 3], axis=0))))
    return actuator, every[:, actuator]
