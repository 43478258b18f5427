#!/usr/bin/env python3
"""From targets to commands, measurements, the model's shape and what rviz gets of it; targets that no one should obey; and two
commanders."""
import math
import os
import sys

import numpy as np
import rospy
import rostest
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import InteractiveMarkerFeedback, InteractiveMarkerInit, MarkerArray

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm import Scene  # noqa: E402
from helix_arm.msg import ArmShape, ShapeTarget, TargetStatus, TipTarget  # noqa: E402
from helix_arm.srv import Reload  # noqa: E402
from loop_rig import place  # noqa: E402
from processes import SOURCE  # noqa: E402
from ros_case import CommanderCase  # noqa: E402

FRAMES = 9  # as in flow.test
SCENES = SOURCE + "/config/scenes/"


def numbers(tip, quaternion):
    """Of a place and a unit quaternion, of which one sign is taken."""
    if not isinstance(quaternion, np.ndarray):  # of a message
        tip, quaternion = place(tip), np.array([getattr(quaternion, axis) for axis in "xyzw"])
    return np.append(tip, quaternion if quaternion[3] >= 0 else -quaternion)


def pose_of(tip, quaternion=(0, 0, 0, 1)):
    return Pose(Point(*tip), Quaternion(*quaternion))


class Flow(CommanderCase):
    SCENE = "spatial_50"

    def setUp(self):
        super().setUp()
        self.scene = Scene.load(self.SCENE)
        self.model = self.inbox(self.NS + "model", ArmShape)
        self.tip_target, self.shape_target = (rospy.Publisher(self.NS + topic, kind, queue_size=10) for topic, kind in (
            ("tip_target", TipTarget), ("shape_target", ShapeTarget)))
        self.assert_wait(lambda: self.tip_target.get_num_connections() > 0 and self.shape_target.get_num_connections() > 0)
        self.connect()

    def assert_model_of_measured(self, model, measured, tier):
        """It is the shape at the pressures of its measurement, inside the limits. These pressures."""
        pressure = np.clip(measured.pressure, *self.scene.limits_pa.T)
        expected = self.scene.forward(pressure)
        self.assertEqual((model.tier, model.sections), (tier, 1))
        np.testing.assert_allclose(model.twist, expected.twists[0], atol=1e-13)
        np.testing.assert_allclose(numbers(model.tip.position, model.tip.orientation),
                                   numbers(expected.tips, expected.quaternions_xyzw), atol=1e-13)
        return pressure

    def reach(self, publisher, target):
        """The pressures that a target comes to, which must be reached."""
        self.held = None
        answer = self.status.answer_to(publisher, target)
        self.assertEqual(answer.outcome, TargetStatus.REACHED, answer)
        return np.array(self.command_after(answer))


class SpatialFlow(Flow):
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
        self.assert_wait(lambda: np.allclose(joints[-1].effort[:3], command, atol=1))
        state = joints[-1]
        self.assertEqual(state.name[:3], ["muscle_1", "muscle_2", "muscle_3"])
        self.assertEqual([name.split("_", 1)[1] for name in state.name[3:]], ["bend_y", "bend_z", "twist"])
        at = self.scene.forward(np.clip(state.position[:3], *self.scene.limits_pa.T))
        np.testing.assert_allclose(state.position[3:], at.twists[0][[4, 5, 3]], atol=1e-12)
        self.assert_wait(lambda: any(tip.header.stamp == state.header.stamp for tip in tips))
        tip = next(tip for tip in tips if tip.header.stamp == state.header.stamp)
        np.testing.assert_allclose(place(tip.pose.position), at.tips, atol=1e-12)
        self.assertEqual(tip.header.frame_id, "arm_base")

    def test_the_model_is_the_shape_of_the_measured_pressures(self):
        self.send_pressures([3e5, 1e4, 1.2e5])
        for _ in range(20):
            model, measured = self.model.next_beside(self.measured)
            self.assertEqual(model.header.frame_id, "arm_base")
            self.assert_model_of_measured(model, measured, "linear")

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

    def test_frames_lie_on_the_model_of_the_same_stamp_and_the_markers_are_drawn(self):
        tf, markers = self.inbox("/tf", TFMessage), self.inbox("markers", MarkerArray)
        self.assertEqual(self.send_pressures([3e5, 0, 1e5]).outcome, TargetStatus.REACHED)
        self.assert_wait(lambda: markers)
        for _ in range(10):
            # The other arm's have a prefix.
            model, measured = self.model.next_beside(self.measured)

            def transforms_of_model():
                return next((one.transforms for one in list(tf) if one.transforms[0].header.frame_id == "arm_base"
                             and one.transforms[0].header.stamp == model.header.stamp), None)

            self.assert_wait(transforms_of_model)
            transforms = transforms_of_model()
            curve = self.scene.curve(self.assert_model_of_measured(model, measured, "linear"), FRAMES)
            found = {one.child_frame_id: numbers(one.transform.translation, one.transform.rotation) for one in transforms}
            expected = {"model_%d" % k: numbers(curve.positions[k], curve.quaternions_xyzw[k]) for k in range(FRAMES)}
            expected["model_tip"] = numbers(model.tip.position, model.tip.orientation)
            self.assertEqual({one.header.frame_id for one in transforms}, {"arm_base"})
            self.assertEqual(set(found), set(expected))
            for name, values in expected.items():
                np.testing.assert_allclose(found[name], values, atol=1e-12, err_msg=name)

    def test_the_base_has_the_pose_of_the_scene_also_of_a_reloaded_one(self):
        static = self.inbox("/tf_static", TFMessage)
        reload = rospy.ServiceProxy("pressure_command/reload", Reload)
        moved = self.scene_with(SCENES + "spatial_50.yaml", {"arm.base": {"position_m": [0.1, -0.2, 0.6], "rpy_deg": [0, 90, 0]}})
        self.addCleanup(lambda: self.assertTrue(reload("spatial_50").success))
        for scene, expected in (("spatial_50", 6 * [0] + [1]), (moved, [0.1, -0.2, 0.6, 0, math.sqrt(0.5), 0, math.sqrt(0.5)])):
            self.assertTrue(reload(scene).success)

            def base():
                transforms = [one for message in static for one in message.transforms if one.child_frame_id == "arm_base"]
                return transforms[-1] if transforms else None

            self.assert_wait(lambda: base() and np.allclose(
                numbers(base().transform.translation, base().transform.rotation), expected, atol=1e-12))
            self.assertEqual(base().header.frame_id, "world")

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


class PlanarFlow(Flow):
    NS, SCENE = "/flat/", "planar_76"

    def test_the_shape_is_the_planar_models_and_a_tip_in_the_plane_is_reached(self):
        self.send_pressures([2e5, 1e4])
        for _ in range(20):
            model, measured = self.model.next_beside(self.measured)
            self.assertEqual((model.header.frame_id, model.tip.position.z), ("flat_arm_base", 0))
            self.assert_model_of_measured(model, measured, "planar")
        tip = self.scene.tips([5e4, 2e5])
        np.testing.assert_allclose(self.scene.tips(self.reach(self.tip_target, TipTarget(pose=pose_of(tip)))), tip, atol=1e-6)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "flow", "__main__", sys.argv)
