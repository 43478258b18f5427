#!/usr/bin/env python3
"""Paths of the tip: goals of follow_tip_path and how they end, and the node that sends a path file."""
import csv
import math
import os
import sys
import time

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import FollowTipPathResult, LoopStatus, PressureArray, SafetyState, TargetStatus  # noqa: E402
from helix_arm.srv import Reload  # noqa: E402
from loop_rig import BESIDE, MIDDLE, LoopRig, call, goal_along, place, target_at, wait_for  # noqa: E402
from processes import SOURCE  # noqa: E402

NODES = ("visual_servo", "pressure_command", "vision")  # that hold one scene; who may refuse first


def reload(node, scene=""):
    return rospy.ServiceProxy(node + "/reload", Reload)(scene)


class FollowTipPath(LoopRig):
    def assert_refused(self, goal, code, *words):
        self.send(goal)
        self.assert_ends(code, *words)
        self.assertEqual(self.client.get_state(), GoalStatus.REJECTED)

    def assert_rests(self):
        self.assert_wait(lambda: self.safety[-1].state == SafetyState.DISABLED)

    def test_moves_the_tip_along_a_path(self):
        self.send(goal_along([MIDDLE, BESIDE, MIDDLE], 1.0))
        self.assert_ends(FollowTipPathResult.SUCCESSFUL)
        self.assertEqual(self.client.get_state(), GoalStatus.SUCCEEDED)
        result = self.client.get_result()
        self.assertGreater(result.pictures, 5)
        self.assertTrue(result.rms_m < 0.005 and result.rms_m <= result.max_m, result)
        self.assertGreater(len(self.feedback), 5)
        self.assertLess(self.feedback[0].time_from_start, self.feedback[-1].time_from_start)
        for feedback in self.feedback:
            self.assertAlmostEqual(feedback.error, math.dist(place(feedback.desired.position), place(feedback.measured.position)), 9)
            self.assertGreater(feedback.sd, 0)
            self.assertEqual(feedback.header.frame_id, "arm_base")

    def test_a_bad_goal_is_refused_with_the_fault(self):
        def spoilt(spoil):
            goal = goal_along([MIDDLE, BESIDE], 1.0)
            spoil(goal, goal.path.points)
            return goal

        for words, spoil in (
                ("point 2", lambda goal, points: setattr(points[1].transforms[0].translation, "x", math.nan)),
                ("'nowhere'", lambda goal, points: setattr(goal.path.header, "frame_id", "nowhere")),
                ("leaves the arm's reach", lambda goal, points: setattr(points[1].transforms[0].translation, "y", 0.3)),
                ("too fast", lambda goal, points: setattr(points[1], "time_from_start", rospy.Duration(0.01)))):
            with self.subTest(words):
                self.assert_refused(spoilt(spoil), FollowTipPathResult.INVALID_GOAL, words)
        self.assert_refused(spoilt(lambda goal, points: setattr(goal.path.header, "stamp", rospy.Time.now() - rospy.Duration(5))),
                            FollowTipPathResult.OLD_HEADER_TIMESTAMP)
        self.assertEqual(self.loop[-1].state, LoopStatus.IDLE, "nothing moves by them")

    def test_a_cancelled_goal_holds_the_arm_where_it_is_wanted(self):
        self.send(goal_along([MIDDLE, BESIDE], 20.0, hold_s=0))  # simulated: without end
        self.assert_under_way()
        self.client.cancel_goal()
        self.assert_wait(self.is_done)
        self.assertEqual(self.client.get_state(), GoalStatus.PREEMPTED)
        self.assert_wait(lambda: math.isnan(self.loop[-1].path_time))
        held = place(self.loop[-1].wanted.position)
        time.sleep(3)  # for longer than the watchdogs of the loop and of pressure_command
        self.assertEqual((self.loop[-1].state, self.loop[-1].commander), (LoopStatus.CLOSED, "follow_tip_path"))
        self.assertLess(math.dist(place(self.loop[-1].wanted.position), held), 1e-9)
        # A target ends it, and its own silence ends the command.
        self.assert_tip_comes_to(MIDDLE, 0.005, target_at(MIDDLE))
        self.assert_comes_to(LoopStatus.IDLE)

    def test_a_rest_ends_what_the_loop_holds(self):
        """Somebody else, here this test, asks for rest while the loop commands."""
        self.send(goal_along([MIDDLE, BESIDE], 1.0, hold_s=0))
        self.assert_ends(FollowTipPathResult.SUCCESSFUL)
        self.assertTrue(call("pressure_command/rest"))
        self.assert_rests()
        self.assert_comes_to(LoopStatus.IDLE)
        sent = len(self.sent)
        self.assert_goes_on(100)
        self.assertEqual(len(self.sent), sent, "it goes on commanding")
        self.assertEqual(self.safety[-1].state, SafetyState.DISABLED, self.safety[-1])

    def test_nodes_of_different_scenes_are_an_error_and_end_a_goal(self):
        diagnostics, demo = self.inbox("/diagnostics", DiagnosticArray), SOURCE + "/config/scenes/demo.yaml"
        waiting = goal_along([MIDDLE, BESIDE], 1.0)
        waiting.path.header.stamp = rospy.Time.now() + rospy.Duration(50)
        self.send(waiting)
        self.assert_wait(lambda: self.client.get_state() == GoalStatus.ACTIVE)
        self.assertTrue(reload("pressure_command", self.scene_with(demo, {"arm.stiffness.K_kappa_m2": 2e-4})).success)
        self.assert_ends(FollowTipPathResult.NOT_ENABLED, "another file")
        self.send(goal_along([MIDDLE, BESIDE], 30.0))
        self.assert_ends(FollowTipPathResult.NOT_ENABLED, "another file")
        for node in NODES:
            self.assertTrue(diagnostics.next(lambda array: any(  # pylint: disable-next=cell-var-from-loop
                one.name.startswith(node) and one.level == DiagnosticStatus.ERROR and "another file" in one.message
                for one in array.status)), node)
        self.assertTrue(reload("pressure_command", "demo").success)
        self.assertTrue(diagnostics.next(lambda array: any(one.name == "visual_servo: loop" and not one.level for one in array.status)))
        self.send(goal_along([MIDDLE, BESIDE], 1.0))
        self.assert_ends(FollowTipPathResult.SUCCESSFUL)

    def test_a_vent_aborts_the_goal_and_refuses_the_next(self):
        self.send(goal_along([MIDDLE, BESIDE], 20.0))
        self.assert_under_way()
        self.assertTrue(call("pressure_command/vent"))
        self.assert_ends(FollowTipPathResult.NOT_ENABLED, "vent")
        self.assert_comes_to(LoopStatus.IDLE)
        self.send(goal_along([MIDDLE, BESIDE], 1.0))
        self.assert_ends(FollowTipPathResult.NOT_ENABLED, "enable")

    def test_another_commander_keeps_the_arm(self):
        hold = PressureArray(pressure=[5e4] * 3)

        def kept(condition):
            hold.header.stamp = rospy.Time.now()
            self.pressure_target.publish(hold)
            return wait_for(condition, 0.1)

        self.assert_wait(lambda: kept(lambda: self.status and self.status[-1].topic == "pressure_target" and
                                      self.status[-1].outcome == TargetStatus.REACHED))
        self.send(goal_along([MIDDLE, BESIDE], 1.0))
        self.assert_wait(lambda: kept(self.is_done))
        self.assert_ends(FollowTipPathResult.NOT_ENABLED, rospy.get_name())

    def test_a_path_file_is_followed_and_leaves_a_record_and_its_figure(self):
        record, figure = self.path("run.csv"), self.path("run.png")
        with open(self.path("path.csv"), "w") as file:
            file.write("time_s,x_m,y_m,z_m\n" + "".join("%d,0.366,%g,0.0088\n" % (k, 0.0035 + 0.0075 * k) for k in range(3)))
        run = self.run_node("follow_path", "_path:=" + self.path("path.csv"), "_goal_tolerance_mm:=5", "_hold_s:=0.1",
                            "_record:=" + record, "_figure:=" + figure)
        self.assertEqual(run.code(120), 0, run.output())
        with open(record) as file:
            rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
        self.assertLess(abs(float(rows[-1]["wanted_y_m"]) - MIDDLE[1] - 0.015), 1e-3)
        self.assertTrue(os.path.exists(figure))


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "follow_path", FollowTipPath, sys.argv)
