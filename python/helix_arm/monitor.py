"""The node monitor: watches a running arm from outside, prints one line per second, and a verdict at the end."""
import collections
import functools
import math
import re
import statistics
import threading
import time
from typing import Any, Callable, List, Sequence

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from helix_arm.msg import ArmShape, ModelError, PressureArray, SafetyState, VisionStatus
from helix_arm.file_access import quoted
from helix_arm.node import DONE, FAILED, LONGEST_MESSAGE, Node, Parameters, end, listen, run
from helix_arm.reload import SCENES, ReloadServer

MOST_ERRORS = 100000  # an hour's at 30 Hz
MOST_PRESSURES = 100  # printed per line
SILENCE = 2.0  # a topic silent for this long at the end has stopped [s]
STATES = ("measured", "few_tags", "no_tags", "no_fit", "waiting", "stale", "camera_fault", "ended")  # of VisionStatus
HARMLESS = ("other_commander", "not_enabled", "rested", "stale")  # why a target may be dropped


class Stream:
    """Statistics of one topic."""

    def __init__(self, topic: str, min_rate: float) -> None:
        self.topic, self.min_rate = topic, min_rate  # slowest healthy one [Hz]
        self.count = self.printed = 0  # at the last line
        self.first = self.last = 0.0
        self.finite = True

    def arrived(self, *numbers: Sequence[float]) -> None:
        self.last = time.monotonic()
        self.first = self.first or self.last
        self.count += 1
        self.finite = self.finite and all(np.isfinite(row).all() for row in numbers)

    def rate(self) -> float:
        """Mean over the whole time [Hz]."""
        return (self.count - 1) / (self.last - self.first) if self.last > self.first else 0.0

    def fault(self) -> str:
        """Its faults at the end; empty if it has none."""
        silence = time.monotonic() - self.last
        if self.count == 0:
            return f"nothing came on {self.topic}"
        if silence > SILENCE:
            return f"{self.topic} fell silent {silence:.1f} s before the end"
        if self.rate() < self.min_rate:
            return f"{self.topic} came at {self.rate():.1f} Hz; expected at least {self.min_rate:g}"
        return "" if self.finite else f"{self.topic} held numbers that are not finite"


class Monitor(Node):
    """Subscribes to pressure_command, pressure_measured, model, measured, model_error, vision_status, safety_state, and of
    /diagnostics to those of pressure_command in its namespace. Serves `~reload`, if ~scene is set: another file of the same rig.

    Ends with 0 if pressures and shapes arrived to the end at ~min_rate or more, with finite numbers, diagnostics without error
    and no dropped target (except those of a second commander, while the arm was not enabled, and late ones); otherwise with 1
    and the reason.
    """

    def __init__(self) -> None:
        reader = Parameters()
        self._seconds = reader.number("seconds", 0.0, 0.0, 86400.0)  # after the first model; 0: until asked to end
        self._min_travel = reader.number("min_travel_m", 0.0, 0.0, 10.0)  # of the tip
        self._startup = reader.number("startup_s", 30.0, 0.1, 3600.0)  # longest wait for a model, if ~seconds is set
        min_rate = reader.number("min_rate", 10.0, 0.1, 1000.0)  # of each topic
        min_measured_rate = reader.number("min_measured_rate", 2.0, 0.1, 1000.0)
        # If it has camera and tags, `measured` is required. Without a scene, `measured` is shown but not required.
        path = reader.file("scene", SCENES, ".yaml", required=False)
        scene_folder = reader.folder("scene_folder")
        reader.finish()
        self._reload = ReloadServer(path, scene_folder, lambda scene: None) if path else None
        self._lock = threading.Lock()
        self._start = self._last_line = time.monotonic()
        self._due = self._start + 1.0  # the next line
        self._command, self._measured, self._model = (
            Stream(topic, min_rate) for topic in ("pressure_command", "pressure_measured", "model"))
        self._shape = Stream("measured", min_measured_rate)
        self._pressure = ()  # last measured [Pa]
        self._tip = (0.0, 0.0, 0.0)  # of the last model, base frame [m]
        self._least, self._most = [math.inf] * 3, [-math.inf] * 3  # of all tips
        self._model_error = self._vision = self._safety = None  # the last ones
        self._tip_errors = collections.deque(maxlen=MOST_ERRORS)  # of the latest model_error [m]
        self._diagnosed = False
        self._dropped = self._refused = 0  # targets since the node started; of these, the harmless ones
        self._last_fault = self._error = ""  # message of the last status at level ERROR
        for topic, kind, callback in (
                ("pressure_command", PressureArray, lambda command: self._command.arrived(command.pressure)),
                ("pressure_measured", PressureArray, self._on_measured), ("model", ArmShape, self._on_model),
                ("measured", ArmShape, self._on_shape), ("model_error", ModelError, self._on_model_error),
                ("vision_status", VisionStatus, functools.partial(setattr, self, "_vision")),
                ("safety_state", SafetyState, functools.partial(setattr, self, "_safety")),
                ("/diagnostics", DiagnosticArray, self._on_diagnostics)):
            listen(topic, kind, 1000, functools.partial(self._locked, callback))

    def _locked(self, callback: Callable[[Any], None], message: Any) -> None:
        with self._lock:
            callback(message)

    def _on_measured(self, measured: PressureArray) -> None:
        self._measured.arrived(measured.pressure)
        self._pressure = measured.pressure

    def _on_model(self, model: ArmShape) -> None:
        position = model.tip.position
        self._tip = (position.x, position.y, position.z)
        if all(map(math.isfinite, self._tip)):
            self._least, self._most = list(map(min, self._least, self._tip)), list(map(max, self._most, self._tip))
        self._model.arrived(model.twist, model.piece_twist, self._tip)

    def _on_shape(self, shape: ArmShape) -> None:
        self._shape.arrived(shape.twist, shape.piece_twist, shape.twist_covariance)

    def _on_model_error(self, error: ModelError) -> None:
        self._model_error = error
        if math.isfinite(error.tip_error):
            self._tip_errors.append(error.tip_error)

    def _on_diagnostics(self, diagnostics: DiagnosticArray) -> None:
        node = rospy.resolve_name("pressure_command")[1:] + ": "
        for status in diagnostics.status:
            if not status.name.startswith(node):
                continue
            self._diagnosed = True
            if status.level >= DiagnosticStatus.ERROR:
                self._error = quoted(status.message, LONGEST_MESSAGE)
            if status.name == node + "targets":
                values = {pair.key: pair.value for pair in reversed(status.values)}
                counts = [int(re.match("[0-9]*", values.get(key, ""))[0] or 0)
                          for key in ("dropped", *("dropped_" + why for why in HARMLESS))]
                self._dropped, self._refused = counts[0], sum(counts[1:])
                self._last_fault = quoted(values.get("last_fault", ""), LONGEST_MESSAGE)

    def turn(self) -> None:
        now = time.monotonic()
        if now < self._due:
            return
        self._due = max(self._due + 1.0, now)
        with self._lock:
            if self._model.count == 0:
                print(f"waiting for {rospy.resolve_name(self._model.topic)}")
                self._last_line = now
                if self._seconds > 0 and now - self._start > self._startup:
                    end.make()
                return
            seconds = now - self._model.first
            print(self._line(seconds, now - self._last_line))
            self._last_line = now
            if 0 < self._seconds <= seconds:
                end.make()

    def _line(self, seconds: float, elapsed: float) -> str:
        words = [f"{seconds:7.1f} s  kPa", *(f"{pressure / 1e3:6.1f}"[:63] for pressure in self._pressure[:MOST_PRESSURES])]
        words += ["..."] if len(self._pressure) > MOST_PRESSURES else []
        words.append(" tip " + " ".join(f"{entry:6.3f}"[:20] for entry in self._tip) + " m ")
        for stream in (self._command, self._measured, self._model) + ((self._shape,) if self._vision else ()):
            words.append(f"{stream.topic} {(stream.count - stream.printed) / elapsed:.0f} Hz")
            stream.printed = stream.count
        return " ".join(words) + f"{self._vision_text()}  dropped {self._dropped}{self._safety_text()}"

    def _vision_text(self) -> str:
        if self._vision is None:
            return ""
        state = self._vision.state
        if state != VisionStatus.MEASURED:
            return f" ({STATES[state] if state < len(STATES) else 'in an unknown state'})"
        error = self._model_error
        off = f", model off by {1e3 * error.tip_error:.1f} mm, {error.tip_error_percent:.1f} %" if error else ""
        return f" ({self._vision.tags} tags{off})"

    def _safety_text(self) -> str:
        if self._safety is None:
            return ""
        cause = "" if self._safety.cause == "none" else f" ({quoted(self._safety.cause)})"
        return f"  {quoted(self._safety.state)}{cause}"

    def _travel(self) -> float:
        """Diagonal of the bounding box of the tip [m]."""
        return math.dist(self._least, self._most) if self._model.count and self._most[0] >= self._least[0] else 0.0

    def _faults(self) -> List[str]:
        expected = [self._command, self._measured, self._model]
        if self._reload and self._reload.scene._has_vision:
            expected.append(self._shape)
        out = [stream.fault() for stream in expected]
        if self._travel() < self._min_travel:
            out.append(f"the tip moved within {self._travel():.3f} m; expected at least {self._min_travel:g}")
        if not self._diagnosed:
            out.append("no diagnostics of pressure_command came")
        if self._error:
            out.append("diagnostics: " + self._error)
        if self._dropped > self._refused:
            out.append(f"{self._dropped - self._refused} targets were dropped, last fault: {self._last_fault}")
        return [fault for fault in out if fault]

    def finish(self) -> int:
        with self._lock:
            seconds = time.monotonic() - self._model.first if self._model.count else 0.0
            rates = "".join(f"{stream.topic} {stream.rate():.1f} Hz, " for stream in (self._command, self._measured, self._model))
            print(f"summary: {seconds:.1f} s, {rates}tip moved within {self._travel():.3f} m, dropped {self._dropped}")
            if self._shape.count > 0:
                errors = self._tip_errors
                off = (f", model off by {1e3 * statistics.median(errors):.1f} mm at the tip (median of {len(errors)})"
                       if errors else "")
                print(f"{self._shape.topic} {self._shape.rate():.1f} Hz{off}")
            faults = self._faults()
            for fault in faults:
                print(f"fault: {fault}")
            print(f"verdict: {'not healthy' if faults else 'the arm runs'}")
            return FAILED if faults else DONE


def main() -> None:
    run("monitor", Monitor)
