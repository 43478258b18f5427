#!/usr/bin/env python3
"""From targets to commands; targets that no one should obey; and two commanders."""
import math
import os
import sys

import numpy as np
import rospy
import rostest
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from sensor_msgs.msg import JointState
from visualization_msgs.msg import InteractiveMarkerFeedback, InteractiveMarkerInit

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm import Scene  # noqa: E402
from helix_arm.msg import ShapeTarget, TargetStatus, TipTarget  # noqa: E402
from loop_rig import place  # noqa: E402
from ros_case import CommanderCase  # noqa: E402


def pose_of(tip, quaternion=(0, 0, 0, 1)):
    return Pose(Point(*tip), Quaternion(*quaternion))


class Flow(CommanderCase):
    def setUp(self):
        super().setUp()
        self.scene = Scene.load("spatial_50")
        self.tip_target, self.shape_target = (rospy.Publisher(topic, kind, queue_size=10) for topic, kind in (
            ("tip_target", TipTarget), ("shape_target", ShapeTarget)))
        self.assert_wait(lambda: self.tip_target.get_num_connections() > 0 and self.shape_target.get_num_connections() > 0)
        self.connect()

    def reach(self, publisher, target):
        """The pressures that a target comes to, which must be reached."""
        self.held = None
        answer = self.status.answer_to(publisher, target)
        self.assertEqual(answer.outcome, TargetStatus.REACHED, answer)
        return np.array(self.command_after(answer))

    def test_a_pressure_target_becomes_the_command_at_once(self):
        wanted = [1e5, 2e5, 5e4]
        answer = self.send_pressures(wanted)
        self.assertEqual((answer.outcome, answer.topic, answer.commander),
                         (TargetStatus.REACHED, "pressure_target", rospy.get_name()))
        self.assertEqual(self.command_after(answer), wanted)
        self.assertEqual(self.command[-1].name, ["muscle_1", "muscle_2", "muscle_3"])
        partial = self.send_pressures([3e4], ["muscle_3"])
        self.assertEqual(self.command_after(partial), [1e5, 2e5, 3e4], "names left out keep their command")

    def test_standard_types_alone_watch_and_command_the_arm(self):
        joints, tips = self.inbox("joint_states", JointState), self.inbox("tip_model", PoseStamped)
        target = rospy.Publisher("tip_target_pose", PoseStamped, queue_size=10)
        self.assert_wait(lambda: target.get_num_connections() > 0 and joints and tips)
        wanted = self.scene.tips([1e5, 2e5, 5e4])
        pose = PoseStamped(pose=pose_of(wanted, (0, 0, 0, 0)))  # of any orientation
        pose.header.frame_id = "arm_base"
        answer = self.status.answer_to(target, pose)
        self.assertEqual((answer.outcome, answer.topic), (TargetStatus.REACHED, "tip_target_pose"))
        command = self.command_after(answer)
        self.assert_wait(lambda: self.status.answer_to(target, pose) and np.allclose(joints[-1].effort[:3], command, atol=1))
        state = joints[-1]
        self.assertEqual(state.name[:3], ["muscle_1", "muscle_2", "muscle_3"])
        self.assertEqual([name.split("_", 1)[1] for name in state.name[3:]], ["bend_y", "bend_z", "twist"])
        at = self.scene.forward(np.clip(state.position[:3], *self.scene.limits_pa.T))
        np.testing.assert_allclose(state.position[3:], at.twists[0][[4, 5, 3]], atol=1e-12)
        self.assert_wait(lambda: any(tip.header.stamp == state.header.stamp for tip in tips))
        tip = next(tip for tip in tips if tip.header.stamp == state.header.stamp)
        np.testing.assert_allclose(place(tip.pose.position), at.tips, atol=1e-12)
        self.assertEqual(tip.header.frame_id, "arm_base")

    def test_tips_and_shapes_are_reached(self):
        tip = self.scene.tips([2e5, 5e4, 1e5])
        target = TipTarget(pose=pose_of(tip))
        target.header.frame_id = "arm_base"
        np.testing.assert_allclose(self.scene.tips(self.reach(self.tip_target, target)), tip, atol=1e-6)
        wanted = self.scene.forward([1e5, 2.2e5, 4e4])
        target = TipTarget(mode=TipTarget.POSE, pose=pose_of(wanted.tips, wanted.quaternions_xyzw))
        found = self.scene.forward(self.reach(self.tip_target, target))
        np.testing.assert_allclose(found.tips, wanted.tips, atol=1e-5)
        self.assertGreater(abs(found.quaternions_xyzw @ wanted.quaternions_xyzw), 1 - 1e-9)
        twists = self.scene.forward([5e4, 1.5e5, 2.5e5]).twists
        found = self.scene.forward(self.reach(self.shape_target, ShapeTarget(twist=twists.ravel()))).twists
        np.testing.assert_allclose(found, twists, atol=1e-5)

    def test_a_target_out_of_reach_moves_the_arm_to_the_closest_and_says_so(self):
        answer = self.status.answer_to(self.tip_target, TipTarget(pose=pose_of([0.3, 2, 0])))
        self.assertEqual(answer.outcome, TargetStatus.UNREACHABLE)
        self.assertTrue(answer.message and answer.at_lower_limit + answer.at_upper_limit)
        self.assertGreater(answer.position_error, 1.5)
        command = self.command_after(answer)  # within the limits, else tips() refuses it
        self.assertGreater(self.scene.tips(command)[1], 0.05, "it bends towards it")
        self.assert_wait(lambda: int(self.diagnosed("targets").get("unreachable", 0)) >= 1)

    def test_targets_that_no_one_should_obey_are_dropped(self):
        """Each fault is a law of control/ or of the conversions; here one of each topic is dropped, answered and counted, and the
        arm stays."""
        held, far = [1.1e5, 1.2e5, 1.3e5], TipTarget()
        far.header.frame_id = 2000000 * "x"
        self.assertEqual(self.send_pressures(held).outcome, TargetStatus.REACHED)
        keep = self.held
        for fault, word, send in (
                ("not_finite", "muscle_2", lambda: self.send_pressures([0, math.nan, 0])),
                ("unknown_name", "????...'", lambda: self.send_pressures([1], [2000000 * "\n"])),
                ("wrong_size", "0 numbers", lambda: self.status.answer_to(self.shape_target, ShapeTarget())),
                ("wrong_frame", "xxxx...'", lambda: self.status.answer_to(self.tip_target, far)),
                ("stale", " s ago, more than ", lambda: self.status.answer_to(self.tip_target, TipTarget(), age=10)),
                ("unknown_mode", "mode 2", lambda: self.status.answer_to(self.tip_target, TipTarget(mode=2)))):
            with self.subTest(fault):
                answer = send()
                self.held = keep
                self.assertEqual((answer.outcome, answer.fault), (TargetStatus.DROPPED, fault))
                self.assertIn(word, answer.message)
                self.assertLess(len(answer.message), 200)
                self.assertEqual(self.command_after(answer), held)
                self.assert_wait(lambda: self.diagnosed("targets").get("dropped_" + fault) == "1")
        self.assertTrue(self.diagnosed("targets")["last_fault"])
        self.assertEqual(self.command_after(self.send_pressures([2e5, 1e5, 0])), [2e5, 1e5, 0])

    def test_of_two_commanders_the_first_holds_the_lease_until_it_is_silent(self):
        """This test and the interactive marker, which is dragged to where the arm's tip is at some pressures."""
        handle = self.inbox("tip_handle/update_full", InteractiveMarkerInit)
        feedback = rospy.Publisher("tip_handle/feedback", InteractiveMarkerFeedback, queue_size=10)
        self.assert_wait(lambda: handle and feedback.get_num_connections() > 0)

        def drag():
            first = len(self.status)
            message = InteractiveMarkerFeedback(client_id="test", marker_name=handle[-1].markers[0].name, pose=pose_of(
                self.scene.tips([2e5, 1e5, 5e4])), event_type=InteractiveMarkerFeedback.POSE_UPDATE)
            message.header.frame_id = "arm_base"
            feedback.publish(message)
            self.assert_wait(lambda: any(one.commander == "interactive_marker" for one in self.status[first:]))
            return next(one for one in self.status[first:] if one.commander == "interactive_marker")

        def is_refused():
            """A busy machine may hold up this test for so long that it loses the lease."""
            if self.send_pressures(3 * [1e5]).outcome != TargetStatus.REACHED:
                return False
            answer = drag()
            return answer.fault == "other_commander" and rospy.get_name() in answer.message and \
                self.command_after(answer) == 3 * [1e5]

        self.assert_wait(is_refused)
        self.assert_wait(lambda: int(self.diagnosed("targets").get("dropped_other_commander", 0)) >= 1)
        self.assert_wait(lambda: self.diagnosed("targets").get("lease_holder") == rospy.get_name())
        self.held = None
        self.assert_wait(lambda: drag().outcome == TargetStatus.REACHED)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "flow", "__main__", sys.argv)
