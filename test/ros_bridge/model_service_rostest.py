#!/usr/bin/env python3
"""~forward and ~inverse of pressure_command: the model of its scene, within bounds, while targets are served."""
import os
import sys
import threading

import numpy as np
import rospy
import rostest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm import Scene  # noqa: E402
from helix_arm.msg import TargetStatus  # noqa: E402
from helix_arm.srv import Forward, Inverse  # noqa: E402
from ros_case import CommanderCase  # noqa: E402

DEMO = Scene.load("demo")


def call(service, **request):
    """Of flat arrays."""
    name = "pressure_command/" + service.__name__.lower()
    rospy.wait_for_service(name, 60)
    return rospy.ServiceProxy(name, service)(**{key: value if isinstance(value, str) else list(np.ravel(value))
                                                for key, value in request.items()})


def random_pressures(rows, seed):
    lower, upper = DEMO.limits_pa.T
    return lower + np.random.RandomState(seed).rand(rows, 3) * (upper - lower)


class ModelService(CommanderCase):
    def test_forward_is_the_model_of_the_scene(self):
        pressures = random_pressures(200, 1)
        found, expected = call(Forward, pressure=pressures), DEMO.forward(pressures)
        self.assertTrue(found.success, found.message)
        self.assertEqual((found.rows, found.sections, len(found.converged)), (200, 1, 200))
        self.assertTrue(all(found.converged))
        for numbers, of_model in ((found.position, expected.tips), (found.orientation, expected.quaternions_xyzw),
                                  (found.twist, expected.twists)):
            np.testing.assert_allclose(np.reshape(numbers, of_model.shape), of_model, atol=1e-13)

    def test_a_large_batch_delays_no_target(self):
        """A call that takes seconds, all of whose tips are out of reach, and targets meanwhile."""
        self.connect()
        far = [[5 + i, 1, 2] for i in range(1000)]
        batch = threading.Thread(target=lambda: self.assertTrue(call(Inverse, position=far).success))
        batch.start()
        answered = 0
        while batch.is_alive() and answered < 50:
            self.assertEqual(self.send_pressures([1e4, 0, 0]).outcome, TargetStatus.REACHED, self.status[-1:])
            answered += 1
        self.assertGreater(answered, 1, "the batch was over at once")
        batch.join()


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "model_service", ModelService, sys.argv)
