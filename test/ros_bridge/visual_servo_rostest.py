#!/usr/bin/env python3
"""The loop over vision as a node: its states, its commanders, targets in other frames, and what it says of touches."""
import math
import os
import signal
import sys

import numpy as np
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, PoseStamped, WrenchStamped
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ArmShape, ExternalLoad, LoopStatus, SafetyState, TargetStatus  # noqa: E402
from loop_rig import MIDDLE, Inbox, LoopRig, call, close_loop, place, target_at, wait_for  # noqa: E402

ARMING = 12.0  # of pictures, and more than the loop asks for [s]
DEADLINE = 60.0  # of a contact [s]


class VisualServo(LoopRig):
    def test_closes_and_brings_the_measured_tip_to_its_target(self):
        target = target_at(MIDDLE)
        self.assert_comes_to(LoopStatus.CLOSED, target)
        self.assert_tip_comes_to(MIDDLE, 0.005, target)
        answer = self.status.answer_to(self.tip_target, target)
        self.assertEqual(answer.outcome, TargetStatus.REACHED, answer)
        self.assertLess(answer.position_error, 1e-5)
        status = self.loop[-1]
        self.assertEqual(status.commander, rospy.get_name())
        self.assertEqual(status.inverse, "reached")
        self.assertLess(math.dist(place(status.wanted.position), MIDDLE), 1e-12)
        self.assertLess(math.dist(place(status.predicted.position), place(self.measured[-1].tip.position)), 0.01)
        self.assertGreater(status.accepted, 2)
        self.assertTrue(0 < status.predicted_sd < 0.01, status)
        self.assertTrue(math.isnan(status.path_time))

    def test_whoever_falls_silent_lets_go_of_the_arm(self):
        self.assert_comes_to(LoopStatus.CLOSED, target_at(MIDDLE))
        self.assert_comes_to(LoopStatus.IDLE)
        self.assertEqual(self.loop[-1].message, "the loop has no target")
        self.assertFalse(self.loop[-1].has_wanted)
        sent = len(self.sent)
        self.assert_wait(lambda: self.safety[-1].cause == "stale_target")
        self.assertEqual(len(self.sent), sent, "it goes on commanding")

    def test_the_tags_of_each_fit_reach_it(self):
        """Else it would take those that face the camera for those in sight."""
        diagnostics = Inbox("/diagnostics", DiagnosticArray)

        def counts():
            loop = [one for array in diagnostics for one in array.status if one.name == "visual_servo: loop"]
            values = {pair.key: pair.value for pair in loop[-1].values} if loop else {}
            return float(values.get("accepted", 0)), float(values.get("without_tags", 0))

        self.assert_wait(lambda: counts()[0] > 0)
        accepted, without = counts()
        self.assert_wait(lambda: counts()[0] >= accepted + 20, 60)
        self.assertLess(counts()[1], without + 10)

    def test_targets_may_be_seen_from_any_frame_that_tf_relates_to_the_base(self):
        frames = Inbox("/tf_static", TFMessage)
        self.assert_wait(lambda: any(one.child_frame_id == "arm_base" for message in frames for one in message.transforms))
        X_WB = next(one for message in frames for one in message.transforms if one.child_frame_id == "arm_base").transform
        q, v = X_WB.rotation, np.array([X_WB.rotation.x, X_WB.rotation.y, X_WB.rotation.z])
        pose = PoseStamped()
        pose.header.frame_id = "world"
        pose.pose.position = Point(*place(X_WB.translation) + MIDDLE + 2 * np.cross(v, q.w * MIDDLE + np.cross(v, MIDDLE)))

        def is_wanted():
            pose.header.stamp = rospy.Time.now()
            self.tip_target_pose.publish(pose)
            return wait_for(lambda: self.loop[-1].has_wanted, 0.1)

        self.assert_wait(is_wanted)
        self.assertLess(math.dist(place(self.loop[-1].wanted.position), MIDDLE), 1e-6)
        # With an orientation it is a pose, and the closest shape keeps some of both.
        pose.pose.orientation.w = 1
        self.assertEqual(self.status.answer_to(self.tip_target_pose, pose).outcome, TargetStatus.UNREACHABLE)

    def test_stays_open_where_it_is_told_to_and_forgets_what_it_learnt_when_reset(self):
        target = target_at(MIDDLE)
        self.assert_comes_to(LoopStatus.CLOSED, target)
        self.assertTrue(close_loop(False))
        self.assert_comes_to(LoopStatus.OPEN, target)
        self.assertEqual(self.loop[-1].message, "kept open by ~close_loop")
        self.assertTrue(close_loop(True))
        self.assert_comes_to(LoopStatus.CLOSED, target)
        self.assert_tip_comes_to(MIDDLE, 0.003, target)
        before = len(self.loop)
        self.assertTrue(call("visual_servo/reset"))
        # Three pictures must close it again.
        self.assert_wait(lambda: any(status.state != LoopStatus.CLOSED for status in self.loop[before:]), 20, target)
        self.assert_comes_to(LoopStatus.CLOSED, target)
        self.assert_tip_comes_to(MIDDLE, 0.003, target)

    def test_without_pictures_or_with_those_of_another_clock_it_coasts_and_is_open_at_last_without_a_jump(self):
        target = target_at(MIDDLE)
        self.assert_comes_to(LoopStatus.CLOSED, target)
        self.assert_tip_comes_to(MIDDLE, 0.002, target)
        first = len(self.sent)
        self.vision.signal(signal.SIGKILL)
        self.assert_comes_to(LoopStatus.COASTING, target)
        # As from a computer with another clock: nothing is used, and the message names the clocks.
        measured = rospy.Publisher("measured", ArmShape, queue_size=10)
        seen = self.measured[-1]
        for ahead, fault in ((1.0, "(future)"), (-1.2, "(too_old)")):
            def is_told():
                seen.header.stamp = rospy.Time.now() + rospy.Duration(ahead)
                measured.publish(seen)
                told = self.loop[-1]
                return told.state in (LoopStatus.COASTING, LoopStatus.OPEN) and fault in told.message and \
                    "synchronise the clocks" in told.message

            self.assert_wait(is_told, 40, target)
        self.assert_comes_to(LoopStatus.OPEN, target)
        self.assertLess(math.dist(place(self.loop[-1].predicted.position), MIDDLE), 0.005, "it keeps what it learnt")
        self.start_vision()
        self.assert_comes_to(LoopStatus.CLOSED, target)
        self.assertLess(np.abs(np.diff([one.pressure for one in self.sent[first:]], axis=0)).max(), 2e4)
        self.assertEqual(self.safety[-1].state, SafetyState.ENABLED)


class Contact(LoopRig):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.load = Inbox("external_load", ExternalLoad)
        cls.force = rospy.Publisher("simulated_rig/tip_force", WrenchStamped, queue_size=10)

    def setUp(self):
        super().setUp()
        self.target = target_at(MIDDLE)
        self.assert_wait(lambda: self.force.get_num_connections() > 0)
        self.push(0)
        # The latched one, or the first: contacts of the test before end.
        self.assert_comes_to(LoopStatus.CLOSED, self.target)
        self.assert_told(ExternalLoad.NONE)
        begin = rospy.Time.now()
        self.assert_wait(lambda: (rospy.Time.now() - begin).to_sec() > ARMING, DEADLINE, self.target)
        self.assertEqual(self.load[-1].state, ExternalLoad.NONE, self.load[-1])

    def tearDown(self):
        self.push(0)

    def push(self, force):
        """Across the hanging arm [N]."""
        wrench = WrenchStamped()
        wrench.wrench.force.y = force
        self.force.publish(wrench)

    def assert_told(self, state):
        self.assert_wait(lambda: self.load and self.load[-1].state == state, DEADLINE, self.target)

    def test_a_force_is_told_with_its_size_and_that_it_is_gone(self):
        self.push(0.8)
        self.assert_told(ExternalLoad.CONTACT)
        load = self.load[-1]
        self.assertGreater(load.score, 7.8)
        self.assertEqual(load.limit, 32)
        self.assertEqual(load.header.frame_id, "arm_base")
        self.assertFalse(load.normalised)
        self.assertTrue(0 < (load.header.stamp - load.onset).to_sec() < 10, load)
        self.assertIn("clear it", load.message)

        def is_known():
            now = self.load[-1]
            return abs(now.force.y - 0.8) < 0.3 and abs(now.force.z) < 0.3 and now.determined and now.covariance[4] > 0

        self.assert_wait(is_known, DEADLINE, self.target)
        # The demo is simulated: contacts are reported, and the loop goes on.
        self.assertEqual(self.loop[-1].state, LoopStatus.CLOSED)
        self.push(0)
        self.assert_told(ExternalLoad.NONE)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "visual_servo", "__main__", sys.argv)
