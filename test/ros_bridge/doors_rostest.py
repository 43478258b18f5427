#!/usr/bin/env python3
"""Services and nodes that no other test asks do their main thing once; and a long answer delays no target. Time is three times as
fast."""
import os
import sys
import threading

import numpy as np
import rostest
from sensor_msgs.msg import PointCloud2

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from calibration_rig import CalibrationRig  # noqa: E402
from helix_arm import Scene  # noqa: E402
from helix_arm.msg import TargetStatus  # noqa: E402
from helix_arm.srv import Calibrate, ClearSamples, FitContraction, Forward, Inverse, Payload, RecordSample  # noqa: E402

DEMO = Scene.load("demo")
PRESSURES = np.array([[1e5, 0, 2e5], [3e5, 1e5, 0]])


class Doors(CalibrationRig):
    RIG = {"arm": {"K_gamma_scale": 0.6, "K_kappa_scale": 1.2, "length_scale": 1.01}}

    def ask(self, name, service, **fields):
        answer = self.call(name, service, **fields)
        self.assertTrue(answer.success, answer.message)
        return answer

    def test_the_model_answers_and_delays_no_target(self):
        tips, forward = DEMO.tips(PRESSURES), self.ask("pressure_command/forward", Forward, pressure=PRESSURES.ravel().tolist())
        np.testing.assert_allclose(np.reshape(forward.position, (2, 3)), tips, atol=1e-12)
        inverse = self.ask("pressure_command/inverse", Inverse, position=tips.ravel().tolist())
        np.testing.assert_allclose(DEMO.tips(np.reshape(inverse.pressure, (2, 3))), tips, atol=2e-6)
        payload = self.ask("pressure_command/payload", Payload, position=tips[0].tolist(), direction=[0, 0, -1])
        np.testing.assert_allclose(payload.force, np.ravel(DEMO.payload(tips[0], [0, 0, -1]).forces_n), rtol=2e-3)
        # Out of reach, each takes long.
        far = np.add([5, 1, 2], [[i, 0, 0] for i in range(1000)]).ravel().tolist()
        batch = threading.Thread(target=lambda: self.ask("pressure_command/inverse", Inverse, position=far))
        self.connect()
        batch.start()
        answered = 0
        while batch.is_alive() and answered < 20:
            self.assertEqual(self.send_pressures([1e4, 0, 0]).outcome, TargetStatus.REACHED, self.status[-1:])
            answered += 1
        self.assertGreater(answered, 1, "the batch was over at once")
        batch.join()

    def test_samples_are_recorded_saved_and_calibrated_by_hand(self):
        self.connect()
        for pressure in ([0, 0, 0], [2e5, 0, 0], [0, 2e5, 0], [0, 0, 2e5]):
            self.assertEqual(self.send_pressures(pressure).outcome, TargetStatus.REACHED)
            self.assertTrue(self.measured.next(lambda one, p=pressure: np.abs(np.subtract(one.pressure, p)).max() < 6e3))
            self.assert_wait(lambda: self.call("record_sample", RecordSample).success)
        self.assertFalse(self.call("record_sample", RecordSample).success, "the same pictures")
        self.assertIn("4 samples in", self.save("samples.csv"))
        by_hand = self.ask("calibrate", Calibrate, fit=["stiffness", "length_scale"])
        self.assertEqual(self.ask("clear_samples", ClearSamples).cleared, 4)
        of_file = self.ask("calibrate", Calibrate, fit=["stiffness", "length_scale"], data=[self.path("samples.csv")])
        np.testing.assert_allclose(of_file.values, by_hand.values, rtol=1e-6)
        self.save("calibrated.yaml")
        Scene.load(self.path("calibrated.yaml"))
        with open(self.path("lengths.csv"), "w") as file:
            file.write("pressure_kpa,length_m\n" + "".join("%g,%.7f\n" % (42 * k, 0.43 - 0.09 * np.sin(0.14 * k)) for k in range(11)))
        fitted = self.ask("fit_contraction", FitContraction, data=self.path("lengths.csv"), out=self.path("curve.yaml"))
        self.assertLess(fitted.rms, 1e-4)
        self.assertNotEqual(Scene.load(fitted.out).tips([0, 0, 0])[0], DEMO.tips([0, 0, 0])[0])

    def test_a_cloud_holds_the_tips_of_a_workspace(self):
        clouds = self.inbox("workspace", PointCloud2)
        self.run_node("workspace_cloud", "_scene:=loaded", "_count:=500", "_seed:=5", "_frame_prefix:=left_")
        self.assert_wait(lambda: clouds and clouds[-1].width == 500)
        self.assertEqual(clouds[-1].header.frame_id, "left_arm_base")
        expected = Scene.load("loaded").workspace(500, seed=5, sensitivity=True)
        np.testing.assert_allclose(np.frombuffer(clouds[-1].data, "<f4").reshape(500, 6)[:, :4], np.column_stack(
            (expected.tips, expected.moved_per_kpa_m)), atol=1e-7)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "doors", Doors, sys.argv)
