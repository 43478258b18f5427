"""The record of a run along a path: a row for each picture that the loop used, as a table and as a report to draw."""
from __future__ import annotations

import bisect
import math
from typing import Any, Dict, Iterable, List, NamedTuple, Optional

import numpy as np

from helix_arm import _core

MOST_VALUES = 4096  # of a quantity, which are kept
REACH = 0.25  # longest gap that is bridged [s]
AHEAD = 0.05  # the newest value holds for so long [s]
LONGEST_HOLD = 1.0  # of a command that is not repeated [s]
MOST_ROWS = 200_000  # as many as a data set may have
MOST_WAITING = 256  # rows for what has not come yet
MOST_DRAWN = 5000  # rows in a figure
TIPS = ("wanted", "model", "predicted", "measured")


class TimeSeries:
    """A quantity over time, of the last moments. A value that is older than the newest, or of another size, starts it anew."""

    def __init__(self) -> None:
        self._times: List[float] = []
        self._values: List[np.ndarray] = []

    def add(self, moment: float, value: np.ndarray) -> None:
        if self._times and (moment < self._times[-1] or len(value) != len(self._values[-1])):
            self._times, self._values = [], []
        if self._times and moment == self._times[-1]:
            del self._times[-1], self._values[-1]
        self._times.append(moment)
        self._values.append(value)
        del self._times[:-MOST_VALUES], self._values[:-MOST_VALUES]

    def between(self, moment: float) -> Optional[np.ndarray]:
        """Linear between the values before and after this time; nothing where they are farther apart than REACH."""
        after = bisect.bisect_left(self._times, moment)
        if after == len(self._times):
            return self._values[-1] if self._times and moment - self._times[-1] <= AHEAD else None
        if self._times[after] == moment:
            return self._values[after]
        if after == 0 or self._times[after] - self._times[after - 1] > REACH:
            return None
        part = (moment - self._times[after - 1]) / (self._times[after] - self._times[after - 1])
        return (1 - part) * self._values[after - 1] + part * self._values[after]

    def in_force(self, moment: float) -> Optional[np.ndarray]:
        """The last value at or before this time; nothing where it is older than LONGEST_HOLD."""
        after = bisect.bisect_right(self._times, moment)
        return None if after == 0 or moment - self._times[after - 1] > LONGEST_HOLD else self._values[after - 1]

    def covers(self, moment: float) -> bool:
        """Whether later values cannot change those at this time."""
        return bool(self._times) and self._times[-1] >= moment


class Row(NamedTuple):
    """The record of a run at one picture. Tips are positions in one frame [m]."""

    stamp: float  # of the picture [s]
    path_time: float  # since the start of the path; negative on the way to its first point [s]
    wanted: np.ndarray  # at the time of the picture
    measured: np.ndarray
    predicted: Optional[np.ndarray]  # by the corrected model
    sd: float  # of `predicted` along the error [m]
    state: str  # of the loop
    model: Optional[np.ndarray] = None  # by the scene alone
    command: Optional[np.ndarray] = None  # (n) in force then, gauge [Pa]
    pressure: Optional[np.ndarray] = None  # (n) measured, gauge [Pa]

    def error(self, tip: str = "measured") -> Optional[float]:
        """Distance of that tip from the wanted one [m]; nothing if it is unknown."""
        position = getattr(self, tip)
        return None if position is None else float(np.linalg.norm(position - self.wanted))


class TipRecord:
    """Joins the pictures of a run with what other topics say of their times: model, command and pressure get what comes."""

    def __init__(self) -> None:
        self.model, self.command, self.pressure = TimeSeries(), TimeSeries(), TimeSeries()
        self.left_out = 0  # pictures beyond MOST_ROWS
        self._waiting: List[Row] = []
        self._rows: List[Row] = []

    def add(self, row: Row) -> None:
        """Adds a picture; its model and pressures are filled in once they have come."""
        if len(self._rows) + len(self._waiting) >= MOST_ROWS:
            self.left_out += 1
            return
        self._waiting.append(row)
        if len(self._waiting) > MOST_WAITING:
            self._take()
        self.update()

    def update(self) -> None:
        """Fills in what has come."""
        every = (self.model, self.command, self.pressure)
        while self._waiting and all(series.covers(self._waiting[0].stamp) for series in every):
            self._take()

    def is_complete(self) -> bool:
        return not self._waiting

    def finish(self) -> List[Row]:
        """All rows, by the order of their pictures; the rest is filled in as far as it has come."""
        while self._waiting:
            self._take()
        return self._rows

    def _take(self) -> None:
        row = self._waiting.pop(0)
        self._rows.append(row._replace(model=self.model.between(row.stamp), command=self.command.in_force(row.stamp),
                                       pressure=self.pressure.between(row.stamp)))


def rms_of(rows: Iterable[Row], tip: str, end: float) -> Optional[float]:
    """Root of the mean square of a tip's errors from the start of the path to its end [m]; nothing without a row."""
    errors = [row.error(tip) for row in rows if 0 <= row.path_time <= end and getattr(row, tip) is not None]
    return math.sqrt(np.mean(np.square(errors))) if errors else None


def csv_of(rows: Iterable[Row], actuators: int) -> str:
    """A header and a line per row. What is unknown is left empty.

    actuators: number of pressures.
    """
    def cells(values: Optional[np.ndarray], count: int) -> List[str]:
        known = values is not None and len(values) == count
        return [_core._format(value) for value in values] if known else [""] * count

    names = ["time_s", "stamp_s", *(f"{tip}_{axis}_m" for tip in TIPS for axis in "xyz"), "error_m", "predicted_sd_m",
             *(f"{quantity}_{i + 1}_pa" for quantity in ("command", "pressure") for i in range(actuators)), "state"]
    lines = [names]
    for row in rows:
        numbers = [np.array([row.path_time, row.stamp]), *(getattr(row, tip) for tip in TIPS), np.array([row.error(), row.sd])]
        line = [cell for values, count in zip(numbers, (2, 3, 3, 3, 3, 2)) for cell in cells(values, count)]
        lines.append([*line, *cells(row.command, actuators), *cells(row.pressure, actuators), row.state])
    return "".join(",".join(line) + "\n" for line in lines)


def report_of(rows: List[Row], name: str, actuators: List[str], end: float) -> Dict[str, Any]:
    """The path, without the way to it, as plot_report draws it.

    name: of the path. end: time of its last point [s]. Raises RuntimeError if there is nothing to draw.
    """
    on_path = [row for row in rows if row.path_time >= 0]
    drawn = on_path[::len(on_path) // MOST_DRAWN + 1]
    if not drawn:
        raise RuntimeError("there is nothing to draw: the tip did not come to the first point of the path")
    runs = []
    for tip in TIPS[1:]:
        known = [row for row in drawn if getattr(row, tip) is not None]
        rms = rms_of(rows, tip, end)
        if known:
            runs.append({"name": tip if rms is None else f"{tip}: RMS {1e3 * rms:.2f} mm", "kind": tip,
                         "time_s": [row.path_time for row in known], "tip_m": [getattr(row, tip).tolist() for row in known],
                         "error_m": [row.error(tip) for row in known]})
    known = [row for row in drawn if row.command is not None and row.pressure is not None]
    pressures = {"time_s": [row.path_time for row in known], "names": actuators,
                 "command_pa": [row.command.tolist() for row in known], "measured_pa": [row.pressure.tolist() for row in known]}
    return {"scene": name, "follow": {"wanted_m": [row.wanted.tolist() for row in drawn], "along_path": True, "runs": runs,
                                      "pressures": pressures if known else None}}
