#!/usr/bin/env python3
"""Something touches the arm: what the loop says of it."""
import os
import sys

import rospy
import rostest
from geometry_msgs.msg import WrenchStamped

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ExternalLoad, LoopStatus  # noqa: E402
from loop_rig import MIDDLE, Inbox, LoopRig, target_at  # noqa: E402

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
    rostest.rosrun("helix_arm", "contact", Contact, sys.argv)
