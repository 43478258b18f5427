#!/usr/bin/env python3
"""The whole loop: pressures, true arm, pictures, tags, and the measured shape beside the model."""
import os
import signal
import sys

import numpy as np
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import CameraInfo, Image
from visualization_msgs.msg import Marker, MarkerArray

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ArmShape, TargetStatus, VisionStatus  # noqa: E402
from loop_rig import place  # noqa: E402
from processes import wait_for  # noqa: E402
from ros_case import CommanderCase  # noqa: E402


def distance(one, other):
    """Of the tips [m]."""
    return np.linalg.norm(place(one.tip.position) - place(other.tip.position))


class Loop(CommanderCase):
    def setUp(self):
        super().setUp()
        self.truth, self.image, self.info, self.model, self.seen = boxes = [
            self.inbox(topic, kind) for topic, kind in (
                ("truth", ArmShape), ("image", Image), ("camera_info", CameraInfo), ("model", ArmShape), ("measured", ArmShape))]
        self.vision, self.markers = self.inbox("vision_status", VisionStatus), self.inbox("measured_markers", MarkerArray)
        self.start()
        self.connect()
        self.assert_wait(lambda: all(boxes))
        self.assertTrue(self.seen.next())

    def why(self):
        return self.rig.output()

    def start(self):
        self.rig = self.run_node("simulated_rig", "_scene:=demo", "_camera_rate:=8")

    def test_measured_is_the_true_shape_at_the_time_of_the_picture(self):
        for pressure in ([2.5e5, 1e5, 0], [0, 1e5, 3e5]):
            self.assertEqual(self.send_pressures(pressure).outcome, TargetStatus.REACHED)
            for _ in range(12):
                seen, truth = self.seen.next_beside(self.truth)
                self.assertTrue(self.info.at(seen.header.stamp))
                self.assertEqual(truth.tier, "truth")
                self.assertLess(distance(seen, truth), 0.005)

    def test_a_picture_that_comes_again_while_the_arm_moves_is_not_measured(self):
        """A camera that hangs, with new stamps."""
        status, seen = self.inbox("hung/vision_status", VisionStatus), self.inbox("hung/measured", ArmShape)
        pictures, picture = rospy.Publisher("hung/image", Image, queue_size=2), self.image[-1]
        self.run_node("vision", "__ns:=hung", "_scene:=demo", "_source:=image", "/hung/model:=/model")

        def shows(condition):
            picture.header.stamp = rospy.Time.now()
            pictures.publish(picture)
            return wait_for(condition, 0.1)

        self.assert_wait(lambda: shows(lambda: len(seen) > 3))  # an arm at rest looks the same
        self.assertEqual(self.send_pressures([0, 1e5, 3e5]).outcome, TargetStatus.REACHED)
        self.assert_wait(lambda: shows(lambda: status and "it hangs" in status[-1].message))
        measured = len(seen)
        for _ in range(10):
            shows(lambda: False)
        self.assertEqual(len(seen), measured)

    def test_a_rig_that_ends_is_reported_and_measured_again_after_its_restart(self):
        self.rig.signal(signal.SIGINT)
        self.assertEqual(self.rig.code(), 0, self.rig.output())
        self.assertTrue(self.vision.next(lambda status: status.state == VisionStatus.STALE))
        self.assert_wait(lambda: self.markers and self.markers[-1].markers[0].action == Marker.DELETE)

        def assert_comes_to(name, level):
            self.assertTrue(self.diagnostics.next(
                lambda array: any((one.name, one.level) == (name, level) for one in array.status)))

        assert_comes_to("vision: camera", DiagnosticStatus.ERROR)
        assert_comes_to("pressure_command: loop", DiagnosticStatus.ERROR)
        models = len(self.model)
        assert_comes_to("pressure_command: loop", DiagnosticStatus.ERROR)
        self.assertEqual(len(self.model), models, "a model without measurements")
        self.start()
        self.assertTrue(self.seen.next())
        assert_comes_to("vision: camera", DiagnosticStatus.OK)
        self.assertTrue(self.model.next())


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "rig", "__main__", sys.argv)
