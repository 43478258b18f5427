"""The node teleop: while its dead-man button is held, a joystick or a 3D mouse moves the tip target."""
from __future__ import annotations

import math
import re
import threading
import time
from typing import Dict, Optional, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import Point, Pose, Twist
from sensor_msgs.msg import Joy

from helix_arm.arguments import require
from helix_arm.file_access import quoted
from helix_arm.follow_path import RunRecorder
from helix_arm.msg import ArmShape, FollowTipPathFeedback, TargetStatus, TipTarget
from helix_arm.node import DONE, LONGEST_MESSAGE, FaultCount, Node, Parameters, end, listen, log, run
from helix_arm.reload import SCENES
from helix_arm.rest_request import CommandTrace, request_rest
from helix_arm.run_record import TimeSeries
from helix_arm.scene import Scene

LONGEST_STEP = 0.1  # after a pause, the target goes on without a jump [s]
FRESH_TIP = 0.5  # an older tip is not the present one [s]
OUT_OF_REACH = 1e-4  # of the closest tip [m]


class Drive:
    """The wanted tip, base frame: begins at the present one when the button is pressed, moves with the axes, and comes no farther
    out of reach. Without ROS; time is an argument [s].

    speed: at full deflection [m/s]. dead_zone: of an axis, in parts of its range. patience: longest silence of the device [s];
    after it the button must be released before it counts again.
    """

    def __init__(self, scene: Scene, speed: float, dead_zone: float, patience: float) -> None:
        self._scene, self._speed, self._dead_zone, self._patience = scene, speed, dead_zone, patience
        self._axes, self._pressed, self._armed = np.zeros(3), False, True
        self._heard = self._turned = -math.inf
        self.wanted: Optional[np.ndarray] = None  # None: the next target begins at the present tip

    def hear_button(self, now: float, pressed: bool) -> None:
        self._heard, self._armed = now, self._armed or not pressed
        self._pressed = pressed and self._armed

    def hear_axes(self, now: float, axes: np.ndarray) -> None:
        """axes: (3,) deflections, 1 at the end of their range; what is not finite counts as 0."""
        axes = np.clip(np.nan_to_num(axes, posinf=0.0, neginf=0.0), -1, 1)
        axes[np.abs(axes) < self._dead_zone] = 0
        self._heard, self._axes = now, axes / max(1.0, float(np.linalg.norm(axes)))

    def advance(self, now: float, tip: Optional[np.ndarray]) -> Optional[np.ndarray]:
        """The target (3,) [m]; None where the button is released, the device is silent, or no tip is known.

        tip: (3,) the present one [m], where it is known.
        """
        most, self._turned = self._speed * min(now - self._turned, LONGEST_STEP), now
        if self._pressed and now - self._heard > self._patience:
            log.warning(f"no message of the device for {self._patience:g} s (~patience_s): release the button, and press it again")
            self._pressed = self._armed = False
        if not self._pressed or self.wanted is None:
            self.wanted = tip if self._pressed else None
        elif self._axes.any():
            found = self._scene.inverse(self.wanted + most * self._axes)
            move = most * self._axes
            if found.position_error_m > OUT_OF_REACH:
                move = self._scene.tips(found.pressures_pa) - self.wanted
            self.wanted = self.wanted + move * min(1.0, most / max(float(np.linalg.norm(move)), most))
        return self.wanted


class Teleop(Node):
    """Sends tip_target, as any commander, while the button is held. Else it sends nothing: after safety.target_timeout_s the arm
    vents. Where the node ends, it asks for rest."""

    period = 0.02

    def __init__(self) -> None:
        reader = Parameters()
        path, device = reader.file("scene", SCENES, ".yaml"), reader.text("device", "joy")  # scene: as pressure_command's
        axes, self._button = reader.text("axes", "1 0 4"), reader.count("button", 4, 0, 31)  # of joy
        speed = 1e-3 * reader.number("speed_mm_s", 20.0, 0.1, 500.0)
        dead_zone, patience = reader.number("dead_zone", 0.1, 0.0, 0.9), reader.number("patience_s", 0.5, 0.05, 5.0)
        record = reader.file_to_write("record", ".csv")
        reader.finish()
        require(device in ("joy", "spacenav"), f"~device is '{quoted(device)}'; expected joy or spacenav")
        require(bool(re.fullmatch(r"(-?\d{1,2} ){2}-?\d{1,2}", axes)),
                f"~axes is '{quoted(axes)}'; expected three numbers of axes, for x, y and z, with - to turn one round: 1 -0 4")
        self._signs = np.array([-1 if word[0] == "-" else 1 for word in axes.split()])
        self._axes = np.array([abs(int(word)) for word in axes.split()]) if device == "joy" else None
        self._drive, self._lock = Drive(Scene.load(path), speed, dead_zone, patience), threading.RLock()
        self._trace, self._refused, self._sent = CommandTrace(), FaultCount(), TimeSeries()
        # By topic, with the time at which it came: of the loop, else that of the model.
        self._tips: Dict[str, Tuple[float, Optional[np.ndarray]]] = {"estimate": (-math.inf, None), "model": (-math.inf, None)}
        self._recorder = RunRecorder(record, "", "teleop", math.inf, self._lock) if record else None
        self._publisher = rospy.Publisher("tip_target", TipTarget, queue_size=10, tcp_nodelay=True)
        self._subscribers = [listen("joy", Joy, 10, self._on_joy), listen("target_status", TargetStatus, 100, self._on_status)]
        if device == "spacenav":
            self._subscribers.append(listen("spacenav/twist", Twist, 10, self._on_twist))
        for topic in (*self._tips, "measured"):
            self._subscribers.append(listen(topic, ArmShape, 10, lambda shape, topic=topic: self._on_shape(topic, shape)))
        log.info(f"hold button {self._button} of {rospy.resolve_name('joy')} to move the tip, at most {1e3 * speed:g} mm/s")

    def may_end(self) -> bool:
        with self._lock:
            return not self._trace.commands() and not self._trace.awaits_answer()

    def finish(self) -> int:
        if self._recorder is not None:
            with self._lock:
                self._recorder.write("driven by hand")
        return DONE

    def turn(self) -> None:
        now = time.monotonic()
        with self._lock:
            rests = end.made() and self._trace.commands() and not self._trace.awaits_answer()
            tip = next((tip for came, tip in self._tips.values() if now - came < FRESH_TIP), None)
            wanted = None if end.made() else self._drive.advance(now, tip)
            if rests:
                self._trace = CommandTrace()
            if wanted is not None:
                target = TipTarget(mode=TipTarget.POSITION, pose=Pose(position=Point(*wanted)))
                self._trace.send(self._publisher, target)
                self._sent.add(target.header.stamp.to_sec(), wanted)
        if rests and not end.is_urgent():  # without a master, the call would block
            request_rest()

    def _on_joy(self, joy: Joy) -> None:
        highest = -1 if self._axes is None else self._axes.max()
        require(self._button < len(joy.buttons) and highest < len(joy.axes), f"it has {len(joy.buttons)} buttons and {len(joy.axes)} "
                f"axes; expected button {self._button} (~button) and, of a joystick, the axes of ~axes")
        with self._lock:
            self._drive.hear_button(time.monotonic(), bool(joy.buttons[self._button]))
            if self._axes is not None:
                self._drive.hear_axes(time.monotonic(), self._signs * np.array(joy.axes, float)[self._axes])

    def _on_twist(self, twist: Twist) -> None:
        with self._lock:
            self._drive.hear_axes(time.monotonic(), np.array([twist.linear.x, twist.linear.y, twist.linear.z]))

    def _on_status(self, status: TargetStatus) -> None:
        with self._lock:
            if status.topic == "tip_target":
                self._trace.answered(status)
            if status.commander == rospy.get_name() and status.outcome == TargetStatus.DROPPED:
                self._drive.wanted = None
                if self._refused.add():
                    log.warning(f"the arm does not follow: {quoted(status.message, LONGEST_MESSAGE)}")

    def _on_shape(self, topic: str, shape: ArmShape) -> None:
        tip, stamp = np.array([shape.tip.position.x, shape.tip.position.y, shape.tip.position.z]), shape.header.stamp.to_sec()
        require(bool(np.isfinite(tip).all()), "its tip is not finite")
        with self._lock:
            if topic in self._tips:
                self._tips[topic] = time.monotonic(), tip
                return
            wanted = self._sent.in_force(stamp)
            if wanted is not None and self._recorder is not None:
                row = FollowTipPathFeedback(header=shape.header, measured=shape.tip, state="driven")
                row.desired.position, row.time_from_start = Point(*wanted), rospy.Duration.from_sec(stamp)
                self._recorder.add(row)


def main() -> None:
    run("teleop", Teleop)
