#!/usr/bin/env python3
"""A whole calibration of a rig that is not what its scene says, and the nodes that go on with it. Time is three times as fast."""
import csv
import os
import sys

import numpy as np
import rospy
import rostest
import yaml
from actionlib_msgs.msg import GoalStatus

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from calibration_rig import CalibrationRig  # noqa: E402
from helix_arm.msg import ModelError, TargetStatus  # noqa: E402
from helix_arm.srv import Calibrate, FitContraction, Reload  # noqa: E402
from processes import SOURCE  # noqa: E402
from test_size import full_size_only  # noqa: E402


def read(path):
    with open(path) as file:
        return yaml.safe_load(file)


class Runs(CalibrationRig):
    def run_plan(self, steps, **goal):
        """Runs through the plan, told step by step. The result, and the scene that it leaves."""
        first, out = len(self.targets), self.path("calibrated.yaml")
        self.send(out=out, **goal)
        result = self.assert_ends(GoalStatus.SUCCEEDED, deadline=100)
        self.assertTrue(result.success)
        self.assertEqual(result.out, out)
        self.assert_rest(first)
        last = self.progress[-1]
        self.assertEqual((last.step, last.steps, last.samples), (steps, steps, steps))
        # The client misses what comes before its send_goal() returns, at most the first step.
        told = [one.step for one in self.progress]
        self.assertLessEqual(told[0], 2)
        self.assertEqual(told, sorted(told))
        self.assertEqual(set(told), set(range(told[0], steps + 1)))
        self.assertEqual(last.state, "fitting")
        return result, read(out)

    def assert_files_tell_the_same(self, result, fit, names, tolerance):
        response = self.call("calibrate", Calibrate, fit=fit, data=[self.path(name) for name in names])
        self.assertTrue(response.success, response.message)
        self.assertEqual(response.names, result.names)
        refused = self.call("calibrate", Calibrate, fit=fit, data=[self.path(name) for name in names], apply_suspect=6)
        self.assertIn("suspect 6 is not among the", refused.message)
        self.assertLess(np.linalg.norm(np.subtract(response.values, result.values)), tolerance * np.linalg.norm(result.values))


class WholeCalibration(Runs):
    # Its arm is one that the fit can describe; its camera and tags are displaced.
    RIG = {"arm": {"K_gamma_scale": 0.6, "K_kappa_scale": 1.2, "length_scale": 1.01},
           "mounts": {"camera_translation_m": 0.004, "camera_rotation_deg": 0.5, "tag_translation_m": 0.001,
                      "tag_rotation_deg": 1, "seed": 11}}

    def seen_tip_error(self):
        self.free_the_arm()
        moved = rospy.Time.now()
        # The calibration holds the arm for safety.commander_timeout_s after its last target.
        self.assert_wait(lambda: self.send_pressures([3.5e5, 0, 1e5]).outcome == TargetStatus.REACHED)
        error = self.errors.next(lambda error: (error.header.stamp - moved).to_sec() > 3)
        self.assertTrue(error)
        return error.tip_error

    def test_runs_through_its_plan_and_leaves_a_scene_that_predicts_better(self):
        self.errors = self.inbox("model_error", ModelError)
        fit = ["stiffness", "length_scale", "placement"]
        result, calibrated = self.run_plan(12, fit=fit)
        # How much better it predicts is measured in accuracy/.
        self.assertTrue(result.message.startswith("tip error "), result.message)
        self.assertGreater(result.tip_error_before, 0.005)
        self.assertLess(result.tip_error_after, 0.5 * result.tip_error_before)
        self.assertEqual(calibrated["calibration"]["data"][0]["captures"], 12)
        self.assertEqual(len(result.names), len(result.values))
        k = result.names.index("length_scale")
        self.assertTrue(result.identifiable[k])
        self.assertLess(abs(result.values[k] - 1.01), 3 * result.standard_errors[k])
        self.save("saved.yaml")
        self.assertEqual(read(self.path("saved.yaml"))["arm"], calibrated["arm"])
        # The samples remain: saved, and calibrated from the file, they tell the same.
        self.save("samples.csv")
        self.assert_files_tell_the_same(result, fit, ["samples.csv"], 1e-6)
        # The nodes go on with the new file, and their model is where the camera sees the arm.
        before = self.seen_tip_error()
        for name in ("pressure_command", "vision", "calibration"):
            answer = self.call("/%s/reload" % name, Reload, scene=self.path("saved.yaml"))
            self.assertTrue(answer.success, answer.message)
        self.assertLessEqual(self.seen_tip_error(), before / 2)

    def test_fits_free_lengths_and_puts_the_curve_into_the_scene(self):
        quintic = read(SOURCE + "/config/scenes/demo.yaml")["contractions"]["fig3_muscle"]["quintic"]
        data, reference = self.path("longer.csv"), quintic["reference_pressure_kpa"]
        with open(data, "w") as file:
            rows = csv.writer(file)
            rows.writerow(["pressure_kpa", "length_m"])
            for part in np.linspace(0, 1, 41):
                rows.writerow([part * reference, 1.02 * np.polyval(quintic["coefficients_m"][::-1], part)])
        response = self.call("fit_contraction", FitContraction, data=data, out=self.path("longer.yaml"))
        self.assertTrue(response.success, response.message)
        self.assertLess(response.rms, 1e-8)
        fitted = read(response.out)["contractions"]["fig3_muscle"]["quintic"]
        length = np.polyval(fitted["coefficients_m"][::-1], 100 / fitted["reference_pressure_kpa"])
        self.assertEqual(len(response.coefficients), 6)
        self.assertAlmostEqual(length, 1.02 * np.polyval(quintic["coefficients_m"][::-1], 100 / reference), delta=1e-7)


@full_size_only
class Walk(Runs):
    RIG = {"mounts": {"camera_translation_m": 0.02, "seed": 11}}

    def test_names_the_camera_that_was_knocked_and_leaves_a_scene_with_its_place(self):
        result, corrected = self.run_plan(11, captures_per_pressure=1, walk=True)
        self.assertIn("camera_moved", result.message)
        moved = np.subtract(corrected["camera"]["position_m"], read(SOURCE + "/config/scenes/demo.yaml")["camera"]["position_m"])
        self.assertGreater(np.linalg.norm(moved), 0.005)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "calibration", "__main__", sys.argv)
