#!/usr/bin/env python3
"""The node teleop under messages of a device: what it asks of the arm, and that nothing stands without a pressed button."""
import csv
import os
import sys

import numpy as np
import rospy
import rostest
from geometry_msgs.msg import Twist, Vector3
from helix_arm import Scene
from sensor_msgs.msg import Joy

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ArmShape, SafetyState, TargetStatus, TipTarget  # noqa: E402
from ros_case import Inbox, RosCase, wait_for  # noqa: E402

BUTTON, SPEED, PATIENCE = 2, 0.05, "_patience_s:=3"  # [m/s]; longer than a busy machine keeps a message back


def place(message):
    point = getattr(message, "tip", getattr(message, "pose", None)).position
    return np.array([point.x, point.y, point.z])


class Teleop(RosCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.model, cls.safety = Inbox("model", ArmShape), Inbox("safety_state", SafetyState)  # latched: once for all

    def start(self, *arguments):
        self.targets, self.status = self.inbox("tip_target", TipTarget), self.inbox("target_status", TargetStatus)
        self.joy, self.twist, self.measured = (rospy.Publisher(name, kind, queue_size=10) for name, kind in (
            ("joy", Joy), ("spacenav/twist", Twist), ("measured", ArmShape)))
        self.node = self.run_node("teleop", "_scene:=demo", f"_button:={BUTTON}", f"_speed_mm_s:={1e3 * SPEED}", *arguments)
        self.assert_wait(lambda: self.joy.get_num_connections() > 0 and self.model and self.safety)

    def why(self):
        return self.node.output(), self.safety[-1:], self.targets[-1:]

    def move(self, *axes, pressed=True):
        self.joy.publish(Joy(axes=axes, buttons=3 * [0] if not pressed else 3 * [1]))

    def drive(self, condition, *axes, deadline=60):
        """Until the condition holds, with messages at 20 Hz."""
        self.assertTrue(wait_for(lambda: self.move(*axes) or wait_for(condition, 0.05), deadline), self.why())

    def assert_nothing_is_asked(self, send=lambda: None):
        wait_for(lambda: False, 0.1)  # what is under way comes
        first = len(self.targets)
        wait_for(lambda: send(), 0.7)
        self.assertEqual(len(self.targets), first)

    def test_the_button_and_the_axes_move_the_tip_and_without_it_nothing_stands(self):
        record = self.path("driven.csv")
        self.start("_device:=joy", "_axes:=1 -0 2", PATIENCE, f"_record:={record}")
        self.assert_nothing_is_asked(lambda: self.move(1, 1, 1, pressed=False))
        self.drive(lambda: self.targets and self.safety[-1].state == SafetyState.ENABLED, 0, 0, 0.05)
        self.assertLess(np.linalg.norm(place(self.targets[0]) - place(self.model[-1])), 1e-3, "it begins at the present tip")
        first = self.targets[-1]
        self.drive(lambda: np.linalg.norm(place(self.targets[-1]) - place(first)) > 0.01, 1, 0, 0)  # -y
        self.assertLess(place(self.targets[-1])[1] - place(first)[1], -0.005)
        # Far beyond the reach it stays with what the arm can do, and never moves faster.
        self.drive(lambda: len(self.targets) > 300, 1, 0, 0, deadline=60)
        scene, last = Scene.load("demo"), place(self.targets[-1])
        self.assertLess(scene.inverse(last).position_error_m, 1e-3)
        self.assertGreater(scene.inverse(last - [0, 0.005, 0]).position_error_m, 1e-3, "it is at the edge")
        steps = np.diff([place(one) for one in self.targets], axis=0)
        times = [one.header.stamp.to_sec() for one in self.targets]
        self.assertLess(np.linalg.norm(np.sum(np.abs(steps), axis=0)), 1.2 * SPEED * (times[-1] - times[0]))
        self.assertLess(np.linalg.norm(steps, axis=1).max(), 1.01 * SPEED * 0.1)
        shape = ArmShape()
        shape.header.stamp, shape.tip.position = rospy.Time.now(), Vector3(*last)
        self.measured.publish(shape)
        self.move(1, 0, 0, pressed=False)
        self.assert_nothing_is_asked(lambda: self.move(1, 0, 0, pressed=False))
        self.assert_wait(lambda: self.safety[-1].cause == "stale_target")
        self.node.__exit__()
        with open(record) as file:
            row, = csv.DictReader(line for line in file if not line.startswith("#"))
        np.testing.assert_allclose([float(row[f"wanted_{axis}_m"]) for axis in "xyz"], last, atol=1e-2)

    def test_a_device_that_falls_silent_has_released_the_button(self):
        self.start("_device:=spacenav", PATIENCE)
        self.assert_wait(lambda: self.safety[-1].state != SafetyState.FAULT)
        push = Twist(linear=Vector3(0, 0, float("nan")))
        self.drive(lambda: self.twist.publish(push) or len(self.targets) > 10)
        self.assertTrue(np.isfinite([place(one) for one in self.targets]).all())
        self.assert_wait(lambda: "release the button, and press it again" in self.node.output())
        self.assert_nothing_is_asked(self.move)
        self.move(pressed=False)
        asked = len(self.targets)
        self.drive(lambda: len(self.targets) > asked + 10)
        # Asked to end, it has the arm ramp down to rest: no fault.
        self.drive(lambda: self.status[-1].outcome == TargetStatus.REACHED and self.safety[-1].state == SafetyState.ENABLED)
        self.node.__exit__()
        self.assert_wait(lambda: self.safety[-1].state == SafetyState.DISABLED)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "teleop", Teleop, sys.argv)
