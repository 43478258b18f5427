"""Fits, calibrations and simulated runs through the package: against the truth of simulated data."""
import csv
import pathlib
import subprocess
import sys
import tempfile
import unittest

import helix_arm
import numpy as np

COMMAND = None  # helix_arm
CAPTURES = 6


def columns_of(path):
    """A data set as a dict of columns."""
    with open(path, encoding="utf-8") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    return {name: np.array([float(row[i]) for row in rows[1:]]) for i, name in enumerate(rows[0])}


class SimulatedRigTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.rig = pathlib.Path(cls.folder.name) / "rig"
        subprocess.run([COMMAND, "simulate", helix_arm.Scene.load("demo").path, "--out", str(cls.rig),
                        "--count", str(CAPTURES)], check=True, capture_output=True)
        cls.scene = helix_arm.Scene.load("demo")
        cls.truth = columns_of(cls.rig / "truth.csv")
        cls.tips = np.column_stack([cls.truth[f"tip_{axis}_m"] for axis in "xyz"])
        cls.pressures = np.minimum(1e3 * np.column_stack([cls.truth[f"pressure_{i}_kpa"] for i in [1, 2, 3]]),
                                   cls.scene.limits_pa[:, 1])

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_fit_finds_the_true_tips(self):
        found = self.scene.fit(self.rig / "tag_corners.csv")
        self.assertEqual(found.twists.shape, (CAPTURES, 1, 6))
        self.assertEqual(set(found.status), {"converged"})
        self.assertLess(np.linalg.norm(found.tips - self.tips, axis=1).max(), 6e-3)
        model = np.linalg.norm(self.scene.tips(self.pressures) - self.tips, axis=1)
        self.assertGreater(model.max(), 6e-3, "the model alone is as good")

    def test_evaluate_compares_the_model_with_what_was_measured(self):
        path = self.rig / "tag_corners.csv"
        fit, found = self.scene.fit(path), self.scene.evaluate(path)
        apart = np.linalg.norm(self.scene.tips(fit.pressures_pa) - fit.tips, axis=1)
        np.testing.assert_allclose(found.errors, apart, atol=1e-6)
        self.assertEqual((found.kind, found.unit, found.worst), ("tags", "m", found.errors.max()))
        tips = self.scene.tips(self.pressures) + [0, 3e-3, 4e-3]
        series = {"time_s": 1e4 * np.arange(len(tips)), **{f"pressure_{i + 1}_kpa": self.pressures[:, i] / 1e3 for i in range(3)},
                  **{f"{axis}_m": tips[:, k] for k, axis in enumerate("xyz")}}
        self.assertAlmostEqual(self.scene.evaluate(series).rms, 5e-3, places=6)
        with self.assertRaisesRegex(ValueError, "free lengths"):
            helix_arm.Scene.load("planar_76").evaluate({"pressure_kpa": np.zeros(2), "length_m": np.ones(2)})

    def test_localize_measures_pictures(self):
        from PIL import Image
        pictures = np.stack([np.asarray(Image.open(path).convert("L")) for path in sorted(self.rig.glob("*.jpg"))])
        one = self.scene.localize(pictures[0], self.pressures[0])
        self.assertEqual(one.state, "measured")
        self.assertLess(np.linalg.norm(one.tip - self.tips[0]), 6e-3)
        self.assertEqual(one.corners_px.shape, (len(one.tags), 4, 2))
        # The corners are where the picture has them: gray levels there lie between black and white.
        self.assertLess(one.corners_px[..., 0].max(), 1280)
        np.testing.assert_allclose(self.scene.localize(pictures[0]).tip, one.tip, atol=1e-4)  # started at rest
        series = self.scene.localize(pictures[:2], self.pressures[:2])
        np.testing.assert_allclose(series[0].twists, one.twists, atol=1e-12)
        blank = self.scene.localize(np.zeros((720, 1280), np.uint8), self.pressures[0])
        self.assertEqual(blank.state, "no_tags")
        self.assertTrue(np.isnan(blank.tip).all())

    def test_calibration_makes_the_model_better(self):
        found = self.scene.calibrate(self.rig / "tag_corners.csv", fit=["stiffness", "length_scale"])
        self.assertTrue(found.success, found.message)
        self.assertLess(found.tip_error_after_m, 0.5 * found.tip_error_before_m)
        self.assertRegex(repr(found), r"^<helix_arm.Calibration: success\n    K_gamma = .* \+- .*\n(?s:.*)    length_scale = 1.0")
        well, badly = found.combinations
        self.assertEqual(set(well.exponents), {"K_gamma", "K_kappa"})
        self.assertAlmostEqual(sum(well.exponents[name] * badly.exponents[name] for name in well.exponents), 0)
        self.assertLess(well.relative_error, badly.relative_error)
        self.assertTrue(well.identifiable)
        self.assertAlmostEqual(found["length_scale"].value, 1.01, delta=5 * found["length_scale"].standard_error + 1e-3)
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "calibrated.yaml"
            path.write_text(found.scene_text, encoding="utf-8")
            calibrated = helix_arm.Scene.load(path)
        before = np.linalg.norm(self.scene.tips(self.pressures) - self.tips, axis=1).mean()
        after = np.linalg.norm(calibrated.tips(self.pressures) - self.tips, axis=1).mean()
        self.assertLess(after, 0.5 * before)


class CalibrationTest(unittest.TestCase):
    """Curvatures of an arm whose K_kappa is not that of its scene."""

    def setUp(self):
        self.scene = helix_arm.Scene.load("spatial_50")
        self.truth = helix_arm.Scene.load("spatial_50", {"arm.stiffness.K_kappa_m2": 2.1e-4})
        self.p = np.zeros((5, 3))
        self.p[:, 0] = np.linspace(0, 4e5, 5)
        curvature = np.linalg.norm(self.truth.forward(self.p).twists[:, 0, 4:], axis=1)
        self.data = {"pressure_1_kpa": self.p[:, 0] / 1e3, "curvature_rad": curvature}

    def test_values_alone(self):
        full, found = [self.scene.calibrate(self.data, fit="K_kappa", errors=errors) for errors in [True, False]]
        self.assertTrue(found.success, found.message)
        self.assertAlmostEqual(found["K_kappa"].value / full["K_kappa"].value, 1, delta=1e-6)
        self.assertAlmostEqual(found["K_kappa"].value / 2.1e-4, 1, delta=2e-3)
        self.assertTrue(full["K_kappa"].identifiable)
        self.assertIsNone(found["K_kappa"].standard_error)
        self.assertIsNone(found["K_kappa"].identifiable)
        for name in ["correlation", "held_out_error", "next_pressures_pa"]:
            self.assertIsNone(getattr(found, name), name)
            self.assertIsNotNone(getattr(full, name), name)
        self.assertEqual(found.combinations, [])
        self.assertIn("K_kappa = 0.0002", found.message)
        self.assertNotIn("+-", found.message)
        self.assertIn("+-", full.message)
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "calibrated.yaml"
            path.write_text(found.scene_text, encoding="utf-8")
            np.testing.assert_allclose(helix_arm.Scene.load(path).tips(self.p), self.truth.tips(self.p), atol=1e-4)


class FollowTest(unittest.TestCase):
    def test_the_loop_is_better_than_the_model_alone(self):
        scene = helix_arm.Scene.load("demo")
        tip = scene.tips(np.array([2e5, 5e4, 0.0]))
        closed = scene.follow(tip, seconds=6)
        alone = scene.follow(tip, seconds=6, open=True)
        self.assertEqual((closed.vented, closed.reason, alone.reason), ("", "", ""))
        self.assertEqual((closed.budget.state, closed.suspects), ("inside", []))
        self.assertTrue(np.all(np.linalg.eigvalsh(closed.budget.covariances_m2["predicted"]) > 0))
        blind = scene.follow(tip, seconds=1, blind=(0, 1))
        self.assertIn("never seen", blind.reason)
        moved = scene.follow(tip, seconds=2, rig=helix_arm.Scene.load("demo", {
            "simulation.mounts.camera_translation_m": 0.02, "simulation.mounts.seed": 3}))
        self.assertEqual(moved.suspects[0].cause, "camera_moved")
        self.assertIsNone(blind.budget)
        self.assertLess(closed.steady_rms_m[0], 2e-3)
        self.assertGreater(alone.steady_rms_m[0], 3e-3)
        steady = closed.times_s > 5
        error = np.linalg.norm(closed.true_tips - closed.wanted_tips, axis=1)[steady]
        self.assertAlmostEqual(np.sqrt(np.mean(error**2)), closed.steady_rms_m[0], delta=2e-4)
        again = scene.follow(tip, seconds=1, blind=(0, 1))
        np.testing.assert_array_equal(again.true_tips, blind.true_tips)

    def test_a_plant_stands_in_for_the_true_arm(self):
        plant = pathlib.Path(__file__).parents[2] / "examples/plant.py"
        run = helix_arm.Scene.load("demo").follow([0.38, 0.03, 0.02], seconds=3, plant=str(plant))
        self.assertLess(run.steady_rms_m[0], 5e-3)
        self.assertIsNone(run.last_turn_rms_m)
        with self.assertRaisesRegex(RuntimeError, 'plant "exit 3" ended with exit code 3'):
            helix_arm.Scene.load("demo").follow([0.38, 0.03, 0.02], seconds=3, plant="exit 3")

    def test_interrupt_ends_a_run(self):
        code = ("import os, signal, threading, helix_arm, numpy\n"
                "threading.Timer(1.0, lambda: os.kill(os.getpid(), signal.SIGINT)).start()\n"
                "try:\n    helix_arm.Scene.load('demo').follow(numpy.array([0.35, 0.05, 0.05]), seconds=3600)\n"
                "except KeyboardInterrupt:\n    print('interrupted')\n")
        result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
        self.assertEqual(result.stdout, "interrupted\n", result.stderr)


if __name__ == "__main__":
    COMMAND = sys.argv[sys.argv.index("--command") + 1]
    unittest.main(argv=sys.argv[:1])
