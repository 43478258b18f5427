#!/usr/bin/env python3
"""Two rigs with two loops on one master, launched by two_arms.launch: each follows its own targets."""
import os
import sys
import time

import numpy as np
import rospy
import rostest
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ArmShape, LoopStatus, SafetyState, TipTarget  # noqa: E402
from loop_rig import MIDDLE, place, target_at  # noqa: E402
from ros_case import RosCase  # noqa: E402

DEADLINE = 120  # two cameras are rendered in real time [s]


class Arm:
    def __init__(self, test, ns):
        self.target, self.goal = rospy.Publisher(ns + "/tip_target", TipTarget, queue_size=10), MIDDLE
        self.loop, self.measured, self.safety = (test.inbox("%s/%s" % (ns, topic), kind) for topic, kind in (
            ("loop_status", LoopStatus), ("measured", ArmShape), ("safety_state", SafetyState)))

    def is_there(self):
        return self.target.get_num_connections() > 0 and self.loop and self.measured and self.safety

    def aim(self):
        target = target_at(self.goal)
        target.header.stamp = rospy.Time.now()
        self.target.publish(target)

    def distance(self, values):
        return np.linalg.norm(place(self.measured[-1].tip.position) - values)


class TwoArms(RosCase):
    def setUp(self):
        self.arms = self.left, self.right = Arm(self, "left"), Arm(self, "right")
        self.tf = [self.inbox(topic, TFMessage) for topic in ("/tf", "/tf_static")]
        self.assert_wait(lambda: all(arm.is_there() for arm in self.arms), DEADLINE)

    def why(self):
        return [(arm.loop[-1:], arm.safety[-1:]) for arm in self.arms]

    def assert_comes(self, condition):
        """The condition comes to hold while both targets are repeated."""
        def holds():
            for arm in self.arms:
                arm.aim()
            time.sleep(0.05)
            return condition()

        self.assert_wait(holds, DEADLINE)

    def test_each_follows_its_own_targets_and_vents_alone(self):
        self.left.goal, self.right.goal = MIDDLE + [0, 0.02, 0], MIDDLE - [0, 0.02, 0]
        self.assert_comes(lambda: all(arm.loop[-1].state == LoopStatus.CLOSED and arm.distance(arm.goal) < 0.005 for arm in self.arms))
        parents = {}
        for transform in (one for inbox in self.tf for message in list(inbox) for one in message.transforms):
            parents.setdefault(transform.child_frame_id, set()).add(transform.header.frame_id)
        self.assertEqual(parents["left_arm_base"], {"left_world"})
        for child, of_child in parents.items():
            self.assertTrue(len(of_child) == 1 and child.startswith(("left_", "right_")), child)
        rospy.ServiceProxy("left/pressure_command/vent", Trigger)()
        self.assert_comes(lambda: self.left.safety[-1].state == SafetyState.VENTED)
        self.assertEqual(self.right.safety[-1].state, SafetyState.ENABLED)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "two_arms", TwoArms, sys.argv)
