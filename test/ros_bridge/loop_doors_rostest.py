#!/usr/bin/env python3
"""What goes in and out of the loop's node beside targets: contacts, the tags of each fit, and the node that sends a path file."""
import csv
import os
import sys

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ExternalLoad, LoopStatus  # noqa: E402
from loop_rig import MIDDLE, LoopRig, target_at  # noqa: E402


class LoopDoors(LoopRig):
    def loop_values(self, name):
        for array in reversed(self.diagnostics):
            for status in array.status:
                if status.name == "visual_servo: loop":
                    return float(next(pair.value for pair in status.values if pair.key == name))
        return -1

    def test_a_force_is_told_with_its_size_and_that_it_is_gone(self):
        load, target = self.inbox("external_load", ExternalLoad), target_at(MIDDLE)
        self.diagnostics, force = self.inbox("/diagnostics", DiagnosticArray), WrenchStamped()
        publisher = rospy.Publisher("simulated_rig/tip_force", WrenchStamped, queue_size=10)
        self.assert_wait(lambda: publisher.get_num_connections() > 0)
        self.assert_comes_to(LoopStatus.CLOSED, target)
        begin = rospy.Time.now()
        self.assert_wait(lambda: (rospy.Time.now() - begin).to_sec() > 12, 60, target)  # of pictures
        self.assertEqual(load[-1].state, ExternalLoad.NONE, load[-1])
        self.assertGreater(self.loop_values("accepted"), 40)
        self.assertLess(self.loop_values("without_tags"), 0.5 * self.loop_values("accepted"), "the loop does not know the tags of fits")
        for newton, state in ((0.8, ExternalLoad.CONTACT), (0.0, ExternalLoad.NONE)):  # across the hanging arm
            force.wrench.force.y = newton
            publisher.publish(force)
            self.assert_wait(lambda s=state, n=newton: load[-1].state == s and (not n or abs(load[-1].force.y - n) < 0.3), 60, target)

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
    rostest.rosrun("helix_arm", "loop_doors", LoopDoors, sys.argv)
