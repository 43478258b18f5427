#!/usr/bin/env python3
"""No door lets a command through at which the arm would touch a zone: targets by topic, handle and teleop, goals of the loop, series,
calibration runs and walks, and experiments, while vision, rig and all nodes run."""
import os
import sys

import actionlib
import numpy as np
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Point, Pose, Quaternion
from helix_arm import Scene
from sensor_msgs.msg import Joy
from std_srvs.srv import Trigger
from visualization_msgs.msg import InteractiveMarkerFeedback, InteractiveMarkerInit

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from calibration_rig import CalibrationRig  # noqa: E402
from helix_arm.msg import (ArmShape, FollowTipPathAction, FollowTipPathResult, RunExperimentAction, RunExperimentGoal,  # noqa: E402
                           SafetyState, ShapeTarget, TipTarget)
from loop_rig import goal_along  # noqa: E402
from zones import LEAST, TOUCHES, clearance, with_post  # noqa: E402


WALKED, THIN = [0, 0, 1.24e5], 0.002  # pressures of the walk's seventh step [Pa]; radius of a post there, clear of the arm at rest [m]


class Doors(CalibrationRig):
    def setUp(self):
        walks = "walk" in self.id()
        self.KNOWN = with_post(WALKED, THIN) if walks else with_post(TOUCHES)
        super().setUp()

    def assert_blocked(self, answer):
        self.assertEqual((answer.fault, answer.zone), ("blocked", "post"), answer)

    def enable(self):
        self.assert_wait(lambda: self.safety[-1].state == SafetyState.ENABLED or self.call("/pressure_command/enable", Trigger).success)

    def drag(self):
        handle = self.inbox("tip_handle/update_full", InteractiveMarkerInit)
        feedback = rospy.Publisher("tip_handle/feedback", InteractiveMarkerFeedback, queue_size=10)
        self.assert_wait(lambda: handle and feedback.get_num_connections() > 0)
        first = len(self.status)
        message = InteractiveMarkerFeedback(client_id="test", marker_name=handle[-1].markers[0].name, pose=self.pose,
                                            event_type=InteractiveMarkerFeedback.POSE_UPDATE)
        message.header.frame_id = "arm_base"
        feedback.publish(message)
        self.assert_wait(lambda: any(one.commander == "interactive_marker" for one in self.status[first:]))
        return next(one for one in self.status[first:] if one.commander == "interactive_marker")

    def steer(self, to):
        """By teleop, from where the tip is."""
        joy, model = rospy.Publisher("joy", Joy, queue_size=10), self.inbox("model", ArmShape)
        teleop = self.run_node("teleop", "_scene:=demo", "_axes:=0 1 2", "_speed_mm_s:=100", "_patience_s:=5")
        self.assert_wait(lambda: model and joy.get_num_connections() > 0)
        first = len(self.status)

        def blocked():
            tip = model[-1].tip.position
            way = to - [tip.x, tip.y, tip.z]
            joy.publish(Joy(axes=list(way / np.abs(way).max()), buttons=5 * [1]))
            return next((one for one in self.status[first:] if one.commander == "/teleop" and one.fault == "blocked"), None)
        self.assert_wait(blocked)
        teleop.__exit__()
        return blocked()

    def test_no_door_lets_through_what_would_touch(self):
        shape = Scene.load("demo").forward(TOUCHES)
        self.pose = Pose(Point(*shape.tips), Quaternion(*shape.quaternions_xyzw))
        self.assert_blocked(self.send_pressures(TOUCHES))
        for topic, target in (("tip_target", TipTarget(pose=self.pose)),
                              ("tip_target", TipTarget(mode=TipTarget.POSE, pose=self.pose)),
                              ("shape_target", ShapeTarget(twist=shape.twists.ravel().tolist()))):
            publisher = rospy.Publisher(topic, type(target), queue_size=10)
            self.assert_wait(lambda: publisher.get_num_connections() > 0)
            self.assert_blocked(self.status.answer_to(publisher, target))
        self.free_the_arm()
        self.assert_blocked(self.drag())
        self.free_the_arm()
        self.assert_blocked(self.steer(shape.tips))

        self.free_the_arm()
        with open(self.path("series.csv"), "w") as file:
            file.write("pressure_1_kpa,pressure_2_kpa,pressure_3_kpa\n0,50,0\n%g,%g,%g\n" % tuple(one / 1e3 for one in TOUCHES))
        series = self.run_node("pressure_series", "_scene:=demo", "_data:=" + self.path("series.csv"), "_ramp_s:=2", "_hold_s:=30")
        self.assertEqual(series.code(), 1, series.output())
        self.assertIn("post", series.output())

        self.free_the_arm()
        self.send(fit=["K_kappa"], plan=TOUCHES + [0, 3e5, 0, 0, 0, 3e5])
        self.assert_ends(GoalStatus.ABORTED, "post")

        self.free_the_arm()
        self.run_node("visual_servo", self.scene)
        loop = actionlib.SimpleActionClient("visual_servo/follow_tip_path", FollowTipPathAction)
        self.assert_wait(lambda: loop.action_client.wait_for_server(rospy.Duration(1)))

        def is_checked():
            """Sends a goal, whose path is looked at once the arm is enabled."""
            self.enable()
            loop.send_goal(goal_along([shape.tips, shape.tips + [0, 0.001, 0]], 1.0))
            self.assert_wait(lambda: loop.gh.get_comm_state() == actionlib.CommState.DONE)
            return loop.get_result().error_code != FollowTipPathResult.NOT_ENABLED

        self.assert_wait(is_checked)
        self.assertEqual(loop.get_result().error_code, FollowTipPathResult.INVALID_GOAL)
        self.assertIn("post", loop.get_result().error_string)

        experiment = self.run_node("experiment", "_scene:=demo", f"_out_folder:={self.path('')}", f"_scene_folder:={self.path('')}")
        client = actionlib.SimpleActionClient("experiment/run_experiment", RunExperimentAction)
        self.assert_wait(lambda: client.action_client.wait_for_server(rospy.Duration(1)))

        def sees_the_arm():
            """Sends a goal, which a node that has just started ends if no vision_status has reached it yet."""
            self.enable()
            client.send_goal(RunExperimentGoal(name="step", repeats=2, hold_s=0.5, actuators=["muscle_1"]))
            self.assert_wait(lambda: client.gh.get_comm_state() == actionlib.CommState.DONE)
            return "was not seen" not in client.get_result().message

        self.assert_wait(sees_the_arm)
        self.assertFalse(client.get_result().success, experiment.output())
        self.assertIn("post", client.get_result().message)

        nearest = min(clearance(command.pressure, TOUCHES) for command in self.command[::20])
        self.assertGreaterEqual(nearest, LEAST - 2e-4)

    def test_a_walk_ends_before_the_step_that_would_touch(self):
        self.send(walk=True, captures_per_pressure=1)
        self.assert_ends(GoalStatus.ABORTED, "post", deadline=100)
        self.assertEqual(self.progress[-1].step, 6)
        nearest = min(clearance(command.pressure, WALKED, THIN) for command in self.command[::20])
        self.assertGreaterEqual(nearest, LEAST - 2e-4)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "keep_out_doors", Doors, sys.argv)
