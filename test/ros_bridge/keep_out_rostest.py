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
from visualization_msgs.msg import MarkerArray

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ArmShape, PlanTipPathAction, PlanTipPathGoal, TargetStatus  # noqa: E402
from processes import SOURCE  # noqa: E402
from ros_case import CommanderCase  # noqa: E402
from zones import TOUCHES, clearance, zones  # noqa: E402

LEAST = 0.01  # of the default clearance_m


class KeepOut(CommanderCase):
    def setUp(self):
        super().setUp()
        self.scene = Scene.load("demo")
        path = self.scene_with(SOURCE + "/config/scenes/demo.yaml", {"keep_out": zones(), "safety.slew_kpa_s": 100})
        self.node = self.run_node("pressure_command", "_scene:=" + path)
        self.connect()

    def why(self):
        return self.status[-2:], self.command[-1:], self.node.output()[-3000:]

    def see(self, pressures, until):
        """Shows the arm at the shape of these pressures, as vision would."""
        publisher = rospy.Publisher("measured", ArmShape, queue_size=10)
        shape = ArmShape(tier="measured", sections=1, twist=self.scene.forward(pressures).twists[0].tolist())
        self.assert_wait(lambda: publisher.get_num_connections() > 0)
        self.assert_wait(lambda: publisher.publish(shape) or until())

    def test_what_would_touch_is_refused_by_name_and_the_command_stays(self):
        self.assertEqual(self.send_pressures([0, 1e5, 0]).outcome, TargetStatus.REACHED)
        held = self.held
        answer = self.send_pressures(TOUCHES)
        self.assertEqual((answer.outcome, answer.fault, answer.zone), (TargetStatus.DROPPED, "blocked", "post"), answer)
        self.assertTrue("post" in answer.message and answer.clearance < LEAST and answer.has_clear_tip, answer)
        self.assertEqual(self.command_after(answer)[1], 1e5)
        self.held = held
        clear = self.send_pressures([0, 1.2e5, 0])
        self.assertEqual((clear.outcome, clear.zone), (TargetStatus.REACHED, "post"))
        self.assertAlmostEqual(clear.clearance, clearance(self.scene, [0, 1.2e5, 0]), 3)

    def test_an_arm_that_is_seen_too_close_stays_until_a_command_leads_away(self):
        self.assertEqual(self.send_pressures([0, 2e5, 0]).outcome, TargetStatus.REACHED)
        self.held = None
        self.see(TOUCHES, lambda: "the arm is seen" in self.node.output())
        first = len(self.command)
        self.see(TOUCHES, lambda: len(self.command) > first + 30)
        self.assertLess(self.command[-1].pressure[1], 1.99e5, "it has stopped on its way")
        self.assertEqual(self.command[-1].pressure, self.command[first + 10].pressure)
        self.assertIn("post", self.node.output())
        # Towards the post, by the model; away from it.
        stays = self.command[-1].pressure[1]
        self.see(TOUCHES, lambda: self.send_pressures([5e4, stays, 0], deadline=0.3).fault == "blocked")
        self.see(TOUCHES, lambda: self.send_pressures([0, stays + 1e4, 0], deadline=0.3).outcome == TargetStatus.REACHED)

    def test_a_way_around_is_planned_and_every_row_of_it_is_let_through(self):
        client = actionlib.SimpleActionClient("pressure_command/plan_tip_path", PlanTipPathAction)
        self.assertTrue(client.wait_for_server(rospy.Duration(30)))
        start, goal = [0, 3e5, 0], [4e5, 0, 1e5]
        self.assertLess(min(clearance(self.scene, (1 - t) * np.array(start) + t * np.array(goal)) for t in np.linspace(0, 1, 50)),
                        LEAST, "the straight way is blocked")
        feedback = []
        client.send_goal(PlanTipPathGoal(start=start, pressure=goal), feedback_cb=feedback.append)
        self.assertTrue(client.wait_for_result(rospy.Duration(60)))
        result = client.get_result()
        self.assertEqual((client.get_state(), result.found), (GoalStatus.SUCCEEDED, True), result.message)
        self.assertTrue(feedback and result.zone == "post" and result.clearance >= LEAST)
        rows = np.reshape(result.pressure, (result.rows, 3))
        np.testing.assert_allclose((rows[0], rows[-1]), (start, goal), atol=1)
        self.assertGreaterEqual(min(clearance(self.scene, row) for row in rows), LEAST - 2e-4)
        np.testing.assert_allclose([result.path.points[-1].transforms[0].translation.x], [self.scene.tips(goal)[0]], atol=1e-6)
        for row in rows:
            self.assertEqual(self.send_pressures(row).outcome, TargetStatus.REACHED, self.why())
        client.send_goal(PlanTipPathGoal(tip=Point(*self.scene.tips(TOUCHES))))
        self.assertTrue(client.wait_for_result(rospy.Duration(60)))
        self.assertEqual((client.get_state(), client.get_result().found), (GoalStatus.ABORTED, False))
        self.assertIn("post", client.get_result().message)

    def test_zones_are_drawn(self):
        markers = self.inbox("markers", MarkerArray)
        self.assert_wait(lambda: any(one.ns == "zones" for array in markers for one in array.markers))


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "keep_out", KeepOut, sys.argv)
