#!/usr/bin/env python3
"""Something touches the arm: what the loop says of it, and what becomes of goals."""
import os
import sys

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import WrenchStamped

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ExternalLoad, FollowTipPathGoal, FollowTipPathResult, LoopStatus  # noqa: E402
from loop_rig import BESIDE, MIDDLE, Inbox, LoopRig, call, goal_along, target_at  # noqa: E402
from test_size import full_size_only  # noqa: E402

ARMING = 12.0  # of pictures, and more than the loop asks for [s]
DEADLINE = 60.0  # of a contact [s]


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

    def assert_begins(self, on_contact):
        """A slow goal, held without end, as the arm is simulated. It is refused until safety.commander_timeout_s after the last
        target, and sent again."""
        goal = goal_along([MIDDLE, BESIDE], 60.0, on_contact=on_contact, hold_s=0)
        self.send(goal)
        self.assert_wait(lambda: len(self.feedback) > 2 or (self.is_done() and self.send(goal)), DEADLINE)

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

    @full_size_only
    def test_a_goal_that_is_to_stop_ends_with_contact(self):
        self.assert_begins(FollowTipPathGoal.STOP)
        self.push(0.8)
        self.assert_ends(FollowTipPathResult.CONTACT, "on_contact is STOP")
        self.assertEqual(self.client.get_state(), GoalStatus.ABORTED)
        # The command is held, although contacts without a goal are only reported.
        self.assert_goes_on(20)
        self.assertEqual(self.loop[-1].state, LoopStatus.YIELDING, self.loop[-1])
        self.push(0)
        self.assert_wait(lambda: self.load[-1].state == ExternalLoad.NONE, DEADLINE)
        # What is held without end is ended by a vent.
        self.assertTrue(call("pressure_command/vent"))
        self.assert_comes_to(LoopStatus.IDLE)

    @full_size_only
    def test_z_a_dead_camera_is_told_during_contact_and_ends_the_goal(self):
        """The last test: it ends vision."""
        self.assert_begins(FollowTipPathGoal.YIELD)
        self.push(0.8)
        self.assert_comes_to(LoopStatus.YIELDING, None, DEADLINE)
        self.vision.__exit__()
        self.assert_ends(FollowTipPathResult.VISION_LOST, "camera")
        self.assert_comes_to(LoopStatus.OPEN, None, DEADLINE)
        self.assertIn("check that camera", self.loop[-1].message)
        self.assert_wait(lambda: self.load[-1].state == ExternalLoad.UNSEEN, DEADLINE)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "contact", Contact, sys.argv)
