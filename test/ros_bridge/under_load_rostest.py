#!/usr/bin/env python3
"""The model of an arm under load: its tier, where no shape holds the load, scenes without load."""
import itertools
import os
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

LOADED = SOURCE + "/config/scenes/loaded.yaml"


def reload(scene):
    rospy.wait_for_service("pressure_command/reload", 60)
    return rospy.ServiceProxy("pressure_command/reload", Reload)(scene).success


class UnderLoad(CommanderCase):
    def setUp(self):
        super().setUp()
        self.model = self.inbox("model", ArmShape)
        self.assertTrue(reload("loaded"))
        self.connect()

    def assert_diagnosed(self, **values):
        self.assert_wait(lambda: values.items() <= self.diagnosed("model").items())

    def test_where_no_shape_holds_the_load_there_is_no_model_and_the_diagnostics_say_so(self):
        """An arm on its head, with more on it than it can bear at every pressure."""
        path = self.scene_with(LOADED, {"tier": "loaded", "order": 2, "arm.base.rpy_deg": [0, -90, 0], "load.mass_kg": 20})
        scene = Scene.load(path)
        corners = np.array(list(itertools.product((1e4, 4e5), repeat=3)))
        holds = scene.forward(corners).converged
        self.assertTrue(holds.any() and not holds.all())
        self.assertTrue(reload(path))
        self.assertEqual(self.send_pressures(corners[~holds][-1]).outcome, TargetStatus.REACHED)
        self.assert_diagnosed(solve_status="not_converged")
        self.assertGreater(int(self.diagnosed("model")["unsolved"]), 0)
        first = len(self.model)
        self.assertEqual(self.send_pressures(corners[holds][-1]).outcome, TargetStatus.REACHED)
        self.assert_diagnosed(solve_status="converged")
        self.assertTrue(self.model.next())
        # Every model is one of pressures at which there is a shape.
        self.assertTrue(self.model.next_beside(self.measured))
        measured = {one.header.stamp: one.pressure for one in list(self.measured)}
        for model in self.model[first:]:
            pressure = measured.get(model.header.stamp)  # a busy machine may have dropped it
            self.assertTrue(pressure is None or scene.forward(np.clip(pressure, *scene.limits_pa.T)).converged)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "under_load", UnderLoad, sys.argv)
