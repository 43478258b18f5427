#!/usr/bin/env python3
"""The whole loop: pressures, true arm, pictures, tags, and the measured shape beside the model."""
import math
import os
import signal
import sys

import numpy as np
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ArmShape, ModelError, PressureArray, TargetStatus, VisionStatus  # noqa: E402
from loop_rig import place  # noqa: E402
from processes import wait_for  # noqa: E402
from ros_case import CommanderCase, RosCase  # noqa: E402

MUSCLES = ("muscle_1", "muscle_2", "muscle_3")


def distance(one, other):
    """Of the tips [m]."""
    return np.linalg.norm(place(one.tip.position) - place(other.tip.position))


class Loop(CommanderCase):
    def setUp(self):
        super().setUp()
        self.truth, self.image, self.info, self.tf, self.model, self.seen, self.errors = boxes = [
            self.inbox(topic, kind) for topic, kind in (
                ("truth", ArmShape), ("image", Image), ("camera_info", CameraInfo), ("/tf", TFMessage), ("model", ArmShape),
                ("measured", ArmShape), ("model_error", ModelError))]
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

    def test_the_overlay_is_drawn_for_whoever_looks(self):
        overlay = self.inbox("overlay", Image)
        self.assert_wait(lambda: overlay)
        picture = overlay[-1]
        width, height = self.image[-1].width, self.image[-1].height
        self.assertEqual((picture.encoding, picture.width), ("bgr8", width))
        colours = np.frombuffer(picture.data, np.uint8).reshape(-1, width, 3)
        coloured = (colours != colours[..., :1]).any(axis=2)
        # Something of the picture has colour, and the text stands on dark ground below it.
        self.assertTrue(0.001 < coloured[:height].mean() < 0.25)
        self.assertTrue(0.01 < coloured[height:].mean() < 0.5)
        self.assertLess(np.median(colours[height:]), 50)

    def test_a_force_at_the_tip_moves_the_truth(self):
        """Where to is a law of simulation/; and back."""
        publisher = rospy.Publisher("simulated_rig/tip_force", WrenchStamped, queue_size=10)
        self.assert_wait(lambda: publisher.get_num_connections() > 0)

        def push(force, torque=0):
            publisher.publish(WrenchStamped(wrench=Wrench(force=Vector3(*force), torque=Vector3(torque, 0, 0))))

        def at_rest():
            first = len(self.truth)
            self.assert_wait(lambda: len(self.truth) > first + 50 and
                             all(distance(one, self.truth[-1]) < 1e-6 for one in self.truth[-50:]))
            return self.truth[-1]

        self.assertEqual(self.send_pressures([0, 0, 0]).outcome, TargetStatus.REACHED)
        free, force = at_rest(), np.array([0, 0.3, -0.2])
        push(force)
        self.assert_wait(lambda: distance(self.truth[-1], free) > 1e-3)
        pulled = at_rest()
        self.assertGreater(force @ (place(pulled.tip.position) - place(free.tip.position)), 0)
        push([0, 0, -0.2], torque=0.01)
        self.assertTrue(self.rig.prints("~tip_force: the torque is (0.01, 0, 0) N m"), self.rig.output())
        self.assertLess(distance(at_rest(), pulled), 1e-5, "it stays")
        push([0, 0, 0])
        self.assert_wait(lambda: distance(self.truth[-1], free) < 1e-5)

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


class RenderedArm(RosCase):
    """The arm of a rig beside another regulator, here the test's."""

    def setUp(self):
        self.truth, self.image, self.seen, self.vision = (self.inbox(topic, kind) for topic, kind in (
            ("truth", ArmShape), ("image", Image), ("measured", ArmShape), ("vision_status", VisionStatus)))
        self.readings = rospy.Publisher("pressure_measured", PressureArray, queue_size=10)
        self.rig = self.run_node("simulated_rig", "_scene:=demo", "_camera_rate:=8", "_regulator:=topic")
        self.assert_wait(lambda: self.readings.get_num_connections() >= 2)

    def why(self):
        return self.rig.output()

    def send(self, names, pressure):
        """@return its stamp."""
        reading = PressureArray(name=names, pressure=pressure)
        reading.header.stamp = rospy.Time.now()
        self.readings.publish(reading)
        return reading.header.stamp

    def assert_while_sending(self, names, pressure, condition):
        self.assert_wait(lambda: self.send(names, pressure) and wait_for(condition, 0.02))

    def assert_says(self, words):
        self.assertTrue(self.rig.prints(words), self.rig.output())

    def test_is_seen_at_the_readings_of_the_other_regulator(self):
        shuffled = ("muscle_3", "muscle_1", "muscle_2"), (0, 2.5e5, 1e5)
        self.assert_while_sending(MUSCLES, (2.5e5, 1e5, 0), lambda: self.truth)
        expected = self.truth[-1]
        self.assert_while_sending(*shuffled, lambda: self.image and len(self.seen) > 3)
        self.assertLess(distance(self.truth[-1], expected), 1e-9)
        seen = self.seen[-1]
        self.assertLess(distance(seen, expected), 0.005)
        self.assertTrue(self.truth.at(seen.header.stamp) and self.image.at(seen.header.stamp))
        # A broken reading moves nothing.
        broken = self.send(shuffled[0], (0, math.nan, 1e5))
        self.assert_says("pressure_measured: ")
        # Silence is told, and no picture of an arm whose pressure is unknown is taken.
        self.assert_says("no pressure_measured for 0.5 s")
        pictures = len(self.image)
        self.assertTrue(self.vision.next(lambda status: status.state == VisionStatus.STALE))
        self.assertEqual(len(self.image), pictures)
        self.assertLess(self.truth[-1].header.stamp, broken)
        self.assert_while_sending(*shuffled, lambda: len(self.image) > pictures)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "rig", "__main__", sys.argv)
