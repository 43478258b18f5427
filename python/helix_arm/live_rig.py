"""The arm of a running pressure_command as a rig of experiments: drives it as any commander, and records it."""
from __future__ import annotations

import functools
import math
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np
import rospy
from std_srvs.srv import Trigger

from helix_arm.arguments import require
from helix_arm.experiments.rig import Inputs, Recording, RowSink, slew_of
from helix_arm.file_access import quoted
from helix_arm.msg import ArmShape, ExternalLoad, LoopStatus, PressureArray, SafetyState, TargetStatus, VisionStatus
from helix_arm.node import LONGEST_MESSAGE, end, listen, log
from helix_arm.rest_request import CommandTrace, request_rest
from helix_arm.scene import Scene

TOPICS = {"pressure_command": PressureArray, "pressure_measured": PressureArray, "measured": ArmShape, "vision_status": VisionStatus,
          "external_load": ExternalLoad, "loop_status": LoopStatus, "safety_state": SafetyState, "target_status": TargetStatus}
SILENCE = 1.0  # longest one of the readings [s]
UNSEEN = 2.0  # longest time without a picture in which the tip is seen [s]
PATIENCE = 3.0  # longest wait until the arm follows [s]
LATE = 0.5  # a picture that comes later than this after its stamp is lost [s]
LONGEST_GAP = 60.0  # between two recordings, in which the pressures are held [s]
LOOK = 0.05  # between two looks at what may stop a recording; and most between a picture and its reading [s]


class LiveRig:
    """A Rig whose commands go through pressure_command: its limits, its enabling and its stops hold. turn() is called often, by
    another thread than record(): where the process ends, no target is sent, and the safety core vents.

    It enables nothing: what ends in a fault waits for the user. rate_hz: of the pictures.
    """

    hangs = False

    def __init__(self, scene: Scene, rate_hz: float) -> None:
        self.rate_hz, self.ignore_contacts = rate_hz, False
        self.adopt(scene)
        self._lock, self._trace = threading.RLock(), CommandTrace()
        self._last: Dict[str, Tuple[float, Any]] = {}  # messages by topic, with the time at which they came
        self._inputs: Optional[Inputs] = None
        self._zero = 0.0  # ROS time at which the inputs begin; 0 while the arm does not follow yet [s]
        self._target: Optional[np.ndarray] = None  # (n) sent, or held between recordings [Pa]
        self._gap_since, self._refusal = -math.inf, ""
        self._rows: List[np.ndarray] = []
        self._publisher = rospy.Publisher("pressure_target", PressureArray, queue_size=10, tcp_nodelay=True)
        self._subscribers = [listen(topic, kind, 100, functools.partial(self._hear, topic)) for topic, kind in TOPICS.items()]

    def adopt(self, scene: Scene) -> None:
        """Another scene of the same arm."""
        self._scene, self.origin, self.limits_pa = scene, f"arm of {scene.name}", scene.limits_pa
        self.slew_pa_s = slew_of(scene)

    def turn(self) -> None:
        """Sends the target of this moment, while there is one."""
        with self._lock:
            if self._inputs is None and time.monotonic() - self._gap_since > LONGEST_GAP:
                self._target = None
            if self._target is None:
                return
            if self._inputs is not None and self._zero:
                self._target = self._inputs.at(np.array([rospy.get_time() - self._zero]))[0]
            pressure = np.clip(self._target, *self.limits_pa.T).tolist()
            self._trace.send(self._publisher, PressureArray(name=self._scene.actuators, pressure=pressure))

    def record(self, inputs: Inputs, stop: Callable[[], str], sink: RowSink) -> Recording:
        """As Rig.record. Raises ValueError where the arm cannot be driven or is not measured."""
        require(self._publisher.get_num_connections() > 0, "pressure_target has no subscriber; is pressure_command running?")
        with self._lock:
            self._refusal = "" if self._target is None else self._refusal
            fault = self.fault()
            require(not fault, fault)
            if self._target is None:
                require("pressure_command" in self._last, "no pressure_command has come; is its node running?")
                command = self._last["pressure_command"][1]
                self._target, self._trace = self._scene._reading(command.name, command.pressure), CommandTrace()
            self._inputs, self._zero, self._rows = inputs, 0.0, []
        parts, begun, over, ended = [np.zeros((0, 4 + 2 * len(self.limits_pa)))], time.monotonic(), False, ""
        while not (over or ended):
            time.sleep(LOOK)
            with self._lock:
                if not self._zero and self._trace.commands():
                    self._zero = rospy.get_time()
                now = rospy.get_time() - self._zero if self._zero else 0.0
                over = now > inputs.time_s[-1] + LATE
            late = not self._zero and time.monotonic() - begun > PATIENCE
            ended = "" if over else stop() or self.fault() or ("pressure_command does not answer" if late else "")
            parts.append(self._take(math.inf if over or ended else now - LATE))
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
            self._target = None
        log.warning(f"the experiment stops and vents the arm: {why}")
        if end.is_urgent():
            return  # without a master, the call would block
        try:
            rospy.ServiceProxy("pressure_command/vent", Trigger)()
        except rospy.ServiceException as fault:
            log.warning(f"pressure_command/vent: {fault}; without targets the arm vents by itself")

    def fault(self) -> str:
        """Why the arm cannot be driven or measured any more; empty where it can."""
        def said(topic: str, field: str) -> str:
            return quoted(getattr(self._last[topic][1], field), LONGEST_MESSAGE) if topic in self._last else f"no {topic} has come"

        def is_silent(topic: str, longest: float) -> bool:
            return time.monotonic() - self._last.get(topic, (-math.inf,))[0] > longest

        with self._lock:
            if end.made():
                return "the node is shutting down"
            if is_silent("pressure_measured", SILENCE):
                return f"no pressure_measured for {SILENCE:g} s; is the regulator's node running?"
            if "safety_state" not in self._last or self._last["safety_state"][1].state != SafetyState.ENABLED:
                return said("safety_state", "reason")
            if self._refusal:
                return self._refusal
            if is_silent("measured", UNSEEN):
                return f"the arm was not seen for {UNSEEN:g} s: " + said("vision_status", "message")
            if self.ignore_contacts:
                return ""
            # Where the loop is up, it knows of a muscle that leaks or has lost its hose.
            suspect = said("loop_status", "message")
            touched = "external_load" in self._last and self._last["external_load"][1].state == ExternalLoad.CONTACT
            return said("external_load", "message") if touched else suspect if suspect.startswith("suspect ") else ""

    def _take(self, end_s: float) -> np.ndarray:
        """The rows before this time, which pictures no longer change; they are given once."""
        with self._lock:
            count = sum(row[0] <= end_s for row in self._rows)
            taken, self._rows = self._rows[:count], self._rows[count:]
        return np.array(taken).reshape(count, 4 + 2 * len(self.limits_pa))

    def _hear(self, topic: str, message: Any) -> None:
        with self._lock:
            self._last[topic] = time.monotonic(), message
            moment = message.header.stamp.to_sec() - self._zero
            if topic == "target_status" and message.topic == "pressure_target":
                self._trace.answered(message)
                mine = message.commander == rospy.get_name() and message.outcome == TargetStatus.DROPPED
                if mine and message.fault != "stale":
                    self._refusal = quoted(message.message, LONGEST_MESSAGE)
            elif topic == "pressure_measured" and self._inputs is not None and self._zero and 0 <= moment <= self._inputs.time_s[-1]:
                reading = self._scene._reading(message.name, message.pressure)
                self._rows.append(np.concatenate([[moment], self._inputs.at(np.array([moment]))[0], reading, 3 * [math.nan]]))
            elif topic == "measured":
                # In the row of the reading next to the picture.
                row = min(self._rows, key=lambda row: abs(row[0] - moment), default=None)
                if row is not None and abs(row[0] - moment) < LOOK:
                    row[-3:] = message.tip.position.x, message.tip.position.y, message.tip.position.z
