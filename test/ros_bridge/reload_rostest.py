#!/usr/bin/env python3
"""Scenes that take another's place while the nodes run."""
import os
import shutil
import sys

import numpy as np
import rospy
import rostest
import yaml

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm import Scene  # noqa: E402
from helix_arm.msg import ArmShape, TagDetections, TargetStatus, TipTarget  # noqa: E402
from helix_arm.srv import Reload  # noqa: E402
from loop_rig import place, target_at  # noqa: E402
from processes import SOURCE  # noqa: E402
from ros_case import CommanderCase  # noqa: E402

DEMO = SOURCE + "/config/scenes/demo.yaml"
BRISK = SOURCE + "/test/ros_bridge/scenes/brisk.yaml"
NODES = ("pressure_command", "vision", "monitor")


def reload(name, scene):
    rospy.wait_for_service(name + "/reload", 60)
    return rospy.ServiceProxy(name + "/reload", Reload)(scene)


class Reloading(CommanderCase):
    def setUp(self):
        super().setUp()
        self.model = self.inbox("model", ArmShape)
        self.connect()

    def tearDown(self):
        """The nodes of all tests go on with the demo's scene."""
        self.assertEqual(self.send_pressures([0, 0, 0]).outcome, TargetStatus.REACHED)
        for name in NODES:
            self.assert_taken(name, "demo")

    def assert_taken(self, name, scene):
        response = reload(name, scene)
        self.assertTrue(response.success, response.message)

    def assert_refused(self, name, scene, words=""):
        response = reload(name, scene)
        self.assertFalse(response.success, (name, scene))
        self.assertTrue(response.message and words in response.message, response.message)
        self.assertNotIn("root:", response.message)

    def assert_models(self, scene):
        """The model is the scene's at what was measured at the same time."""
        def is_of_scene():
            model, measured = self.model.next_beside(self.measured)
            pressure = np.clip(measured.pressure, *scene.limits_pa.T)
            return np.allclose(model.twist, scene.forward(pressure).twists.ravel(), 0, 1e-9)

        self.assert_wait(is_of_scene)

    def test_another_stiffness_is_another_model_at_the_same_command(self):
        self.assertEqual(self.send_pressures([3e5, 0, 0]).outcome, TargetStatus.REACHED)
        path, demo = self.scene_with(DEMO, {"arm.stiffness.K_kappa_m2": 2e-4}), Scene.load("demo")
        stiffer = Scene.load(path)
        self.assert_models(demo)
        self.assert_taken("pressure_command", path)
        self.assert_models(stiffer)
        self.assertTrue(self.command.next(lambda command: list(command.pressure) == [3e5, 0, 0]))
        # Without a path, the file that the node has now: it may have changed.
        shutil.copy(DEMO, path)
        self.assert_taken("pressure_command", "")
        self.assert_models(demo)

    def test_a_tip_target_goes_where_the_new_response_is_effective(self):
        """The effective pressure of muscles with play that come down is above their pressure."""
        path = self.scene_with(DEMO, {"contractions.fig3_muscle.response": {"play_kpa": [20], "play_weight": [0.6]}})
        self.assert_taken("pressure_command", path)
        self.assertEqual(self.send_pressures([3e5, 0, 0]).outcome, TargetStatus.REACHED)
        self.assertTrue(self.measured.next(lambda measured: measured.pressure[0] > 2.9e5))
        self.held = None
        wanted, publisher = Scene.load(path).tips([2e5, 2e4, 2e4]), rospy.Publisher("tip_target", TipTarget, queue_size=10)
        self.assert_wait(lambda: publisher.get_num_connections() > 0)
        self.assert_wait(lambda: self.status.answer_to(publisher, target_at(wanted)).outcome == TargetStatus.REACHED and
                         np.linalg.norm(place(self.model[-1].tip.position) - wanted) < 1e-3)
        self.assertLess(self.command[-1].pressure[0], 2e5 - 0.5 * 0.6 * 2e4, "less than its effective pressure")

    def test_a_faulty_file_changes_nothing(self):
        faulty, broken = self.scene_with(DEMO, {"nonsense": 1}), self.path("broken.yaml")
        with open(broken, "w") as file:
            file.write("arm: [")
        for name in NODES:
            self.assert_refused(name, faulty, "nonsense")
            for path in (broken, "/no/such.yaml", "no_such_scene", "../demo.yaml"):
                self.assert_refused(name, path)
        self.assert_models(Scene.load("demo"))

    def test_another_rig_is_refused(self):
        for name in NODES:
            for scene in ("planar_76", shutil.copy(BRISK, self.path("brisk.yaml"))):
                self.assert_refused(name, scene, "not of the running rig" if name == "pressure_command" else "")

    def test_vision_looks_for_the_new_scenes_tags_from_the_next_picture_on(self):
        """Seen from 5 cm farther away, the same picture is of an arm that is 5 cm farther away."""
        seen, pictures = self.inbox("measured", ArmShape), self.inbox("tag_detections", TagDetections)
        self.run_node("simulated_rig", "_scene:=demo", "_regulator:=topic", "_camera_rate:=8")
        self.assert_wait(lambda: len(seen) > 3)
        before = place(seen[-1].tip.position)

        def is_moved(shape):
            return np.linalg.norm(place(shape.tip.position) - before) > 0.01

        with open(DEMO) as file:
            position = np.array(yaml.safe_load(file)["camera"]["position_m"])
        arm = np.array([0, 0, position[2]])
        self.assert_taken("vision", self.scene_with(DEMO, {
            "camera.position_m": (position + 0.05 * (position - arm) / np.linalg.norm(position - arm)).tolist(),
            "vision.base_prior": {"translation_m": 0.0001, "rotation_deg": 0.01}}))
        shown = len(pictures)
        self.assert_wait(lambda: len(pictures) > shown + 2)
        taken = pictures[shown + 2].header.stamp
        self.assert_wait(lambda: len(pictures) > shown + 8)
        self.assertTrue(all(is_moved(shape) for shape in seen if shape.header.stamp >= taken))
        self.assert_taken("vision", "demo")
        self.assertTrue(seen.next(lambda shape: not is_moved(shape)))


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "reload", Reloading, sys.argv)
