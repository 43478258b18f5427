#!/usr/bin/env python3
"""Zones that the arm keeps out of: the gate of its commands, an arm that is seen too close, and ways around."""
import os
import sys

import actionlib
import numpy as np
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Point
from helix_arm import Scene

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ArmShape, PlanTipPathAction, PlanTipPathGoal, TargetStatus  # noqa: E402
from ros_case import CommanderCase  # noqa: E402
from zones import DEMO, LEAST, TOUCHES, clearance, with_post  # noqa: E402

BETWEEN = [0, 1.5e5, 1.5e5]  # pressures on the straight way from START to GOAL [Pa]
START, GOAL = [0, 3e5, 0], [0, 0, 3e5]


class KeepOut(CommanderCase):
    def start(self, touches, **values):
        self.scene = Scene.load("demo")
        path = self.scene_with(DEMO, {**with_post(touches), "safety.slew_kpa_s": 100, **values})
        self.node = self.run_node("pressure_command", "_scene:=" + path)

    def why(self):
        return self.status[-2:], self.command[-1:], self.node.output()[-3000:]

    def move(self, pressure):
        """All the way."""
        answer = self.send_pressures(pressure)
        self.assertEqual(answer.outcome, TargetStatus.REACHED, answer)
        self.assert_wait(lambda: np.allclose(self.command[-1].pressure, pressure))
        return answer

    def test_an_arm_that_is_seen_too_close_stays_until_a_command_leads_away(self):
        self.start(TOUCHES)
        self.connect()
        publisher = rospy.Publisher("measured", ArmShape, queue_size=10)
        shape = ArmShape(tier="measured", sections=1, twist=self.scene.forward([2.2e5, 0, 0]).twists.ravel().tolist())
        self.assert_wait(lambda: publisher.get_num_connections() > 0)
        self.assertEqual(self.send_pressures([1.5e5, 0, 0]).outcome, TargetStatus.REACHED)  # and again, while it is held
        self.assert_wait(lambda: publisher.publish(shape) or "the arm is seen" in self.node.output())
        self.assertIn("mm from post", self.node.output())
        first = len(self.command)
        self.assert_wait(lambda: publisher.publish(shape) or len(self.command) > first + 200)
        self.assertLess(self.command[-1].pressure[0], 1.49e5, "it has stopped on its way")
        self.assertEqual(self.command[-1].pressure, self.command[first + 50].pressure)
        self.assert_wait(lambda: self.status[-1].fault == "blocked")
        self.assert_wait(lambda: publisher.publish(shape) or
                         self.send_pressures([0, 1e5, 0], deadline=1).outcome == TargetStatus.REACHED)

    def test_a_way_around_is_planned_and_every_row_of_it_is_let_through(self):
        self.start(BETWEEN)
        self.connect()
        client = actionlib.SimpleActionClient("pressure_command/plan_tip_path", PlanTipPathAction)
        self.assertTrue(client.wait_for_server(rospy.Duration(30)))
        self.move(START)
        self.assertEqual(self.send_pressures(GOAL).fault, "blocked")
        self.move(START)
        client.send_goal(PlanTipPathGoal(pressure=GOAL))
        self.assertTrue(client.wait_for_result(rospy.Duration(60)))
        result = client.get_result()
        self.assertEqual((client.get_state(), result.found), (GoalStatus.SUCCEEDED, True), result.message)
        self.assertTrue(result.zone == "post" and result.clearance >= LEAST - 1e-4)
        rows = np.reshape(result.pressure, (result.rows, 3))
        np.testing.assert_allclose((rows[0], rows[-1]), (START, GOAL), atol=1)
        self.assertGreaterEqual(min(clearance(row, BETWEEN) for row in rows), LEAST - 2e-4)
        tip = result.path.points[-1].transforms[0].translation
        np.testing.assert_allclose((tip.x, tip.y, tip.z), self.scene.tips(GOAL), atol=1e-6)
        for row in rows:
            self.move(row)
        client.send_goal(PlanTipPathGoal(tip=Point(*self.scene.tips(BETWEEN))))
        self.assertTrue(client.wait_for_result(rospy.Duration(60)))
        self.assertEqual((client.get_state(), client.get_result().found), (GoalStatus.ABORTED, False))
        self.assertIn("post", client.get_result().message)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "keep_out", KeepOut, sys.argv)
