"""The arm of a running pressure_command as a rig of experiments: drives it as any commander, and records it."""
from __future__ import annotations

import math
import threading
import time
from typing import Callable, List, Optional

import numpy as np
import rospy
from std_srvs.srv import Trigger

from helix_arm.arguments import require
from helix_arm.experiments.rig import FASTEST_S, Inputs, Recording, RowSink
from helix_arm.file_access import quoted
from helix_arm.msg import ArmShape, ExternalLoad, PressureArray, SafetyState, TargetStatus, VisionStatus
from helix_arm.node import LONGEST_MESSAGE, end, listen, log
from helix_arm.rest_request import CommandTrace, request_rest
from helix_arm.scene import Scene

SILENCE = 1.0  # longest one of the readings [s]
UNSEEN = 2.0  # longest time without a picture in which the tip is seen [s]
PATIENCE = 3.0  # longest wait until the arm follows [s]
LATE = 0.5  # a picture that comes later than this after its stamp is lost [s]
LONGEST_GAP = 60.0  # between two recordings, in which the pressures are held [s]
LOOK = 0.05  # between two looks at what may stop a recording [s]


class LiveRig:
    """A Rig whose commands go through pressure_command: its limits, its enabling and its stops hold. turn() has to be called
    often, by another thread than record(): where that thread ends, no target is sent, and the safety core vents.

    It enables nothing: what ends in a fault waits for the user.

    rate_hz: of the pictures.
    """

    hangs = False

    def __init__(self, scene: Scene, rate_hz: float) -> None:
        self.rate_hz, self.ignore_contacts = rate_hz, False
        self.adopt(scene)
        self._lock = threading.Lock()
        self._trace, self._zero = CommandTrace(), 0.0  # ROS time at which the inputs begin [s]
        self._inputs: Optional[Inputs] = None
        self._target: Optional[np.ndarray] = None  # (n) sent, or held between recordings [Pa]
        self._command: Optional[np.ndarray] = None  # (n) in force [Pa]
        self._gap_since = -math.inf
        self._rows: List[np.ndarray] = []
        self._refusal = self._unseen = self._touched = ""
        self._read = self._seen = -math.inf
        self._safety = SafetyState()
        self._publisher = rospy.Publisher("pressure_target", PressureArray, queue_size=10, tcp_nodelay=True)
        self._subscribers = [listen(*one) for one in (
            ("pressure_command", PressureArray, 100, self._on_command), ("pressure_measured", PressureArray, 100, self._on_reading),
            ("measured", ArmShape, 100, self._on_shape), ("vision_status", VisionStatus, 10, self._on_vision),
            ("external_load", ExternalLoad, 10, self._on_load), ("safety_state", SafetyState, 10, self._on_safety),
            ("target_status", TargetStatus, 100, self._on_status))]

    def adopt(self, scene: Scene) -> None:
        """Another scene of the same arm."""
        self._scene, self.origin, self.limits_pa = scene, f"arm of {scene.name}", scene.limits_pa
        self.slew_pa_s = min(*scene._slew_pa_s, float(np.ptp(scene.limits_pa, axis=1).max()) / FASTEST_S)

    def hang(self, force_n: np.ndarray) -> None:
        raise RuntimeError("this rig hangs no weight by itself")

    def turn(self) -> None:
        """Sends the target of this moment, while there is one."""
        with self._lock:
            if self._inputs is None and time.monotonic() - self._gap_since > LONGEST_GAP:
                self._target = None
            if self._target is None:
                return
            now = rospy.get_rostime()
            if self._inputs is not None and self._zero:
                self._target = self._inputs.at(np.array([now.to_sec() - self._zero]))[0]
            lower, upper = self.limits_pa.T
            target = PressureArray(name=self._scene.actuators, pressure=np.clip(self._target, lower, upper).tolist())
            target.header.stamp = now
            self._trace.sent(now)
            self._publisher.publish(target)

    def record(self, inputs: Inputs, stop: Callable[[], str], sink: RowSink) -> Recording:
        """As Rig.record. Raises ValueError where the arm cannot be driven or is not measured."""
        self._begin(inputs)
        parts, ended = [np.zeros((0, 4 + 2 * len(self.limits_pa)))], self._wait(stop)
        over = bool(ended)
        while not over:
            time.sleep(LOOK)
            with self._lock:
                now = rospy.get_time() - self._zero
                over = now > inputs.time_s[-1] + LATE
            ended = "" if over else stop() or self.fault()
            over = over or bool(ended)
            parts.append(self._take(math.inf if over else now - LATE))
            if len(parts[-1]):
                sink(parts[-1])
        with self._lock:
            self._inputs, self._gap_since = None, time.monotonic()
        if ended:
            self.vent(ended)
        return Recording.of(np.concatenate(parts), ended)

    def release(self) -> None:
        """Lets go of the arm, which is brought to rest where it still follows."""
        with self._lock:
            self._target = self._inputs = None
        while self._trace.awaits_answer():
            time.sleep(LOOK)
        if self._trace.commands() and not end.is_urgent():
            request_rest()

    def vent(self, why: str) -> None:
        """Sends nothing from now on, and vents."""
        with self._lock:
            self._target = self._inputs = None
        log.warning(f"the experiment stops and vents the arm: {why}")
        if not end.is_urgent():
            try:
                rospy.ServiceProxy("pressure_command/vent", Trigger)()
            except rospy.ServiceException as fault:
                log.warning(f"pressure_command/vent: {fault}; without targets the arm vents by itself")

    def fault(self) -> str:
        """Why the arm cannot be driven or measured any more; empty where it can."""
        now = time.monotonic()
        with self._lock:
            if end.made():
                return "the node is shutting down"
            if now - self._read > SILENCE:
                return f"no pressure_measured for {SILENCE:g} s; is the regulator's node running?"
            if self._safety.state != SafetyState.ENABLED:
                return quoted(self._safety.reason, LONGEST_MESSAGE) or "no safety_state has come; is pressure_command running?"
            if self._refusal:
                return self._refusal
            if now - self._seen > UNSEEN:
                return f"the arm was not seen for {UNSEEN:g} s: {self._unseen or 'no vision_status; is vision running?'}"
            return "" if self.ignore_contacts else self._touched

    def _begin(self, inputs: Inputs) -> None:
        require(self._publisher.get_num_connections() > 0, "pressure_target has no subscriber; is pressure_command running?")
        fault = self.fault()
        require(not fault, fault)
        with self._lock:
            require(self._command is not None, "no pressure_command has come; is its node running?")
            if self._target is None:
                self._target, self._trace = self._command, CommandTrace()
            self._inputs, self._zero, self._rows, self._refusal = inputs, 0.0, [], ""

    def _wait(self, stop: Callable[[], str]) -> str:
        """Until the arm follows; why it does not. The inputs begin then."""
        due, why = time.monotonic() + PATIENCE, ""
        while not why:
            with self._lock:
                if self._trace.commands():
                    self._zero = rospy.get_time()
                    return ""
            time.sleep(LOOK)
            why = stop() or self.fault() or ("pressure_command does not answer" if time.monotonic() > due else "")
        return why

    def _take(self, end_s: float) -> np.ndarray:
        """The rows before this time, which pictures no longer change; they are given once."""
        with self._lock:
            count = sum(row[0] <= end_s for row in self._rows)
            taken, self._rows = self._rows[:count], self._rows[count:]
        return np.array(taken).reshape(count, 4 + 2 * len(self.limits_pa))

    def _on_command(self, message: PressureArray) -> None:
        with self._lock:
            self._command = self._scene._reading(message.name, message.pressure)

    def _on_reading(self, message: PressureArray) -> None:
        with self._lock:
            reading = self._scene._reading(message.name, message.pressure)
            self._read, moment = time.monotonic(), message.header.stamp.to_sec() - self._zero
            if self._inputs is not None and self._zero and 0 <= moment <= self._inputs.time_s[-1]:
                target = self._inputs.at(np.array([moment]))[0]
                self._rows.append(np.concatenate([[moment], target, reading, 3 * [math.nan]]))

    def _on_shape(self, shape: ArmShape) -> None:
        tip = shape.tip.position
        with self._lock:
            self._seen, moment = time.monotonic(), shape.header.stamp.to_sec() - self._zero
            # In the row of the reading next to the picture.
            row = min(self._rows, key=lambda row: abs(row[0] - moment), default=None)
            if row is not None and abs(row[0] - moment) < LOOK:
                row[-3:] = tip.x, tip.y, tip.z

    def _on_vision(self, status: VisionStatus) -> None:
        with self._lock:
            self._unseen = quoted(status.message, LONGEST_MESSAGE)

    def _on_load(self, load: ExternalLoad) -> None:
        with self._lock:
            self._touched = quoted(load.message, LONGEST_MESSAGE) if load.state == ExternalLoad.CONTACT else ""

    def _on_safety(self, state: SafetyState) -> None:
        with self._lock:
            self._safety = state

    def _on_status(self, status: TargetStatus) -> None:
        if status.topic != "pressure_target":
            return
        with self._lock:
            self._trace.answered(status)
            mine, dropped = status.commander == rospy.get_name(), status.outcome == TargetStatus.DROPPED
            if mine and dropped and status.fault != "stale":
                self._refusal = quoted(status.message, LONGEST_MESSAGE)
