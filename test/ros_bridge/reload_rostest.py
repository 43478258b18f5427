#!/usr/bin/env python3
"""Scenes that take another's place while the nodes run."""
import os
import shutil
import sys

import numpy as np
import rospy
import rostest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm import Scene  # noqa: E402
from helix_arm.msg import ArmShape, TargetStatus  # noqa: E402
from helix_arm.srv import Reload  # noqa: E402
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


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "reload", Reloading, sys.argv)
