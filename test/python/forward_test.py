"""Pressures to shapes: against the model written in NumPy, the layouts of arrays, and threads. Inverse, curve, Jacobian,
motion and workspace: each against the forward model."""
import os
import pathlib
import pickle
import shutil
import tempfile
import unittest

import helix_arm
import numpy as np
import numpy_model


def pressures_of(scene, rows, seed=1):
    lower, upper = scene.limits_pa.T
    return np.random.default_rng(seed).uniform(lower, upper, (rows, len(lower)))


class ForwardTest(unittest.TestCase):
    def setUp(self):
        self.scene = helix_arm.Scene.load("helical_50")

    def test_is_the_model_of_the_paper(self):
        p = pressures_of(self.scene, 200)
        arm = numpy_model.helical()
        result = self.scene.forward(p)
        np.testing.assert_allclose(result.twists[:, 0], arm.twists(p), atol=1e-11)
        np.testing.assert_allclose(result.tips, arm.tips(p), atol=1e-11)
        np.testing.assert_allclose(self.scene.tips(p), arm.tips(p), atol=1e-11)
        self.assertTrue(result.converged.all())

    def test_a_pickled_scene_is_found_from_any_folder(self):
        before = os.getcwd()
        self.addCleanup(os.chdir, before)
        with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
            os.chdir(one)
            shutil.copy(self.scene.path, "mine.yaml")
            shutil.copy(helix_arm.Scene.load("spatial_50").path, pathlib.Path(other) / "mine.yaml")
            for given in ["./mine.yaml", "mine.yaml", pathlib.Path("mine.yaml")]:
                os.chdir(one)
                scene = helix_arm.Scene.load(given)
                self.assertTrue(os.path.isabs(scene.path))
                os.chdir(other)
                self.assertEqual(pickle.loads(pickle.dumps(scene)).name, self.scene.name)
            os.chdir(before)

    def test_rows_and_single_calls_agree(self):
        for name in helix_arm.shipped_scenes():
            scene = helix_arm.Scene.load(name)
            p = pressures_of(scene, 5)
            batch, tips = scene.forward(p), scene.tips(p)
            for i, row in enumerate(p):
                one = scene.forward(row)
                np.testing.assert_array_equal(batch.tips[i], one.tips)
                np.testing.assert_array_equal(batch.twists[i], one.twists)
                np.testing.assert_allclose(tips[i], one.tips, atol=1e-14)
                np.testing.assert_allclose(scene.tips(row), one.tips, atol=1e-14)

    def test_any_memory_layout_is_read_where_it_is(self):
        p = pressures_of(self.scene, 3000)
        expected = self.scene.tips(p)
        wide = np.full((6000, 7), np.nan)
        wide[::2, 1:7:2] = p
        read_only = p.copy()
        read_only.setflags(write=False)
        buffer = np.empty(p.nbytes + 1, np.uint8)
        unaligned = buffer[1:].view(np.float64).reshape(p.shape)
        unaligned[:] = p
        for layout in [np.asfortranarray(p), wide[::2, 1:7:2], p[::-1][::-1], read_only, unaligned, p.tolist()]:
            np.testing.assert_array_equal(self.scene.tips(layout), expected)
            np.testing.assert_array_equal(self.scene.forward(layout).tips, self.scene.forward(p).tips)
        np.testing.assert_array_equal(self.scene.tips(p[::-1]), self.scene.tips(p[::-1].copy()))

    def test_rows_without_equilibrium_hold_nan(self):
        scene = helix_arm.Scene.load("loaded", {"arm.base.rpy_deg": [0, 0, 0], "load.mass_kg": 200, "tier": "loaded", "order": 5})
        result = scene.forward(np.full((2, 3), 2e5))
        self.assertFalse(result.converged.any(), "the load is not too large")
        for numbers in [result.tips, result.twists, result.quaternions_xyzw, scene.tips(np.full((2, 3), 2e5))]:
            self.assertTrue(np.isnan(numbers).all())


def difference(function, x, step):
    """Derivative of an array by each entry of x, of sixth order: (..., n)."""
    columns = []
    for i in range(len(x)):
        unit = np.zeros(len(x))
        unit[i] = step
        columns.append(sum(weight / step * (function(x + k * unit) - function(x - k * unit))
                           for k, weight in [(1, 0.75), (2, -0.15), (3, 1 / 60)]))
    return np.stack(columns, axis=-1)


class InverseTest(unittest.TestCase):
    def setUp(self):
        self.scene = helix_arm.Scene.load("spatial_50")

    def test_reaches_tips_of_the_forward_model(self):
        tips = self.scene.tips(pressures_of(self.scene, 40))
        found = self.scene.inverse(tips, threads=2)
        self.assertTrue(found.reached.all())
        self.assertEqual(set(found.status), {"reached"})
        np.testing.assert_allclose(self.scene.tips(found.pressures_pa), tips, atol=2e-6)
        one = self.scene.inverse(tip=tips[3])
        np.testing.assert_array_equal(one.pressures_pa, found.pressures_pa[3])
        self.assertIs(one.reached, True)
        self.assertEqual(one.status, "reached")

    def test_poses_and_twists_are_targets_too(self):
        p = pressures_of(self.scene, 5)
        shapes = self.scene.forward(p)
        by_twists = self.scene.inverse(twists=shapes.twists)
        np.testing.assert_allclose(by_twists.pressures_pa, p, rtol=1e-4, atol=10)
        pose = np.hstack([shapes.tips, shapes.quaternions_xyzw])
        np.testing.assert_allclose(self.scene.inverse(pose=pose).pressures_pa, p, rtol=1e-3, atol=100)


class JacobianTest(unittest.TestCase):
    # The accuracy of differences of sixth order, relative to the largest entry.
    def check(self, found, expected, tolerance=1e-8):
        self.assertEqual(found.shape, expected.shape)
        np.testing.assert_allclose(found, expected, atol=tolerance * np.abs(expected).max())

    def test_by_pressures_is_the_derivative_of_the_forward_model(self):
        for name, tier in [("helical_50", {}), ("planar_76", {}), ("loaded", {"tier": "loaded", "order": 5})]:
            scene = helix_arm.Scene.load(name, tier)
            for p in 2e4 + 0.85 * pressures_of(scene, 2):
                found = scene.jacobian(p)
                self.assertTrue(found.converged)
                self.check(found.tip_by_pressures[:3], difference(lambda q: scene.forward(q).tips, p, 3e3))
                self.check(found.twists_by_pressures, difference(lambda q: scene.forward(q).twists, p, 3e3))


class PayloadTest(unittest.TestCase):
    def setUp(self):
        self.scene = helix_arm.Scene.load("loaded")
        self.tips = self.scene.tips(pressures_of(self.scene, 6))

    def test_rows_are_those_of_single_calls_on_any_threads(self):
        all_ways = self.scene.payload(self.tips, [[0, 0, 2], [1, 0, 0]], threads=2)
        self.assertEqual(all_ways.forces_n.shape, (6, 2))
        self.assertEqual(all_ways.limits.shape, (6, 2, 3))
        self.assertTrue(all_ways.reached.all())
        one = self.scene.payload(self.tips[3], [0, 0, 1])
        self.assertAlmostEqual(one.forces_n[0], all_ways.forces_n[3, 0], places=9)
        self.assertEqual(one.ends[0], all_ways.ends[3, 0])
        self.assertEqual(self.scene.payload(self.tips[0]).forces_n.shape, (26,))

    def test_unloaded_shapes_are_attained_by_their_pressures(self):
        free = helix_arm.Scene.load("loaded", {"load.gravity_m_s2": [0, 0, 0]})
        p = pressures_of(free, 20)
        shapes = free.forward(p).twists
        found = free.attain(shapes)
        self.assertTrue(found.attainable.all())
        np.testing.assert_allclose(found.pressures_pa, p, atol=500)
        pushed = free.attain(shapes, [1, 1000, 0, 0], threads=0)
        self.assertFalse(pushed.attainable.any())
        self.assertTrue((pushed.active_limits == 1).any())
        self.assertEqual(free.attain(shapes[0]).pressures_pa.shape, (3,))


class MotionTest(unittest.TestCase):
    def setUp(self):
        damping = {"stretch": 0.02, "shear": 0.02, "twist": 0.02, "bend": 0.02}
        self.scene = helix_arm.Scene.load("loaded", {"dynamics.damping_s": damping})
        self.times = np.linspace(0, 2, 21)
        self.pressures = pressures_of(self.scene, 4)[:, None] * np.minimum(self.times, 0.5)[None, :, None]

    def test_ends_at_rest_under_its_load(self):
        moved = self.scene.motion(self.pressures, self.times, order=2, threads=0)
        self.assertEqual(moved.tips.shape, (4, 21, 3))
        at_rest = self.scene.forward(self.pressures[:, -1])
        np.testing.assert_allclose(moved.tips[:, -1], at_rest.tips, atol=2e-4)
        np.testing.assert_allclose(moved.quaternions_xyzw[:, -1], at_rest.quaternions_xyzw, atol=2e-3)
        energy = moved.energy_j
        parts = energy["kinetic"] + energy["elastic"] + energy["potential"] + energy["dissipated"]
        np.testing.assert_allclose(parts, energy["work"], rtol=1e-6)

    def test_steps_are_the_motion_and_a_state_continues_it(self):
        pressures = self.pressures[2]
        whole = self.scene.motion(pressures, self.times)
        arm = self.scene.dynamics(pressures[0])
        for k in range(1, 11):
            np.testing.assert_array_equal(arm.step(pressures[k], self.times[k] - self.times[k - 1]), whole.tips[k])
        self.assertAlmostEqual(arm.time_s, 1)
        rest = self.scene.motion(pressures[10:], self.times[10:], start=arm.state)
        np.testing.assert_allclose(rest.tips, whole.tips[10:], atol=1e-6)
        arm.restart(pressures[0])
        np.testing.assert_array_equal(arm.tip, whole.tips[0])

    def test_small_motions_are_those_of_the_linearised_arm(self):
        pressures = np.array([120e3, 60e3, 20e3])
        linear = self.scene.dynamics().linearised(pressures)
        self.assertEqual((linear.A.shape, linear.B.shape, linear.C.shape), ((12, 12), (12, 3), (3, 12)))
        np.testing.assert_allclose(linear.state, self.scene.dynamics(pressures).state, atol=1e-9)
        push, times = np.array([150.0, -100, 50]), np.linspace(0, 0.5, 101)
        rows = np.vstack([pressures, np.tile(pressures + push, (100, 1))])
        moved = self.scene.motion(rows, times, step_s=5e-4).tips - linear.tip
        rates, vectors = np.linalg.eig(linear.A)
        final = -np.linalg.solve(linear.A, linear.B @ push)
        # The pressures rise over the first 5 ms, as a step in their middle does.
        modes = vectors * np.linalg.solve(vectors, -final)
        expected = [(linear.C @ (final + (modes @ np.exp(rates * (t - 0.0025))).real)) for t in times[2:]]
        np.testing.assert_allclose(moved[2:], expected, atol=0.02 * np.abs(moved).max())
        free = helix_arm.Scene.load("loaded", {"load.gravity_m_s2": [0, 0, 0]})
        linear = free.dynamics().linearised(pressures)
        by_pressure = -linear.C @ np.linalg.solve(linear.A, linear.B)
        np.testing.assert_allclose(by_pressure, free.jacobian(pressures, by="pressures").tip_by_pressures[:3], rtol=1e-4, atol=1e-12)

    def test_a_linear_quadratic_regulator_damps_the_arm(self):
        try:
            from scipy.linalg import solve_continuous_are
        except ImportError:
            self.skipTest("no scipy")
        scene = helix_arm.Scene.load("loaded", {"dynamics.damping_s": {"bend": 3e-4, "twist": 3e-4, "shear": 3e-4, "stretch": 3e-4}})
        pressures = np.array([150e3, 100e3, 100e3])
        linear = scene.dynamics().linearised(pressures)
        weight, price = linear.C.T @ linear.C, 1e-12 * np.eye(3)
        gain = np.linalg.solve(price, linear.B.T @ solve_continuous_are(linear.A, linear.B, weight, price))
        disturbed = linear.state.copy()
        disturbed[0, 4] += 0.1
        swings = []
        for feedback in (0, 1):
            arm, tips = scene.dynamics(pressures, start=disturbed), []
            while arm.time_s < 1:
                deviation = (arm.state - linear.state).ravel()
                tips.append(arm.step(np.clip(pressures - feedback * gain @ deviation, *scene.limits_pa.T), 0.005))
            swings.append(np.linalg.norm(np.array(tips[-40:]) - linear.tip, axis=1).max())
        self.assertGreater(swings[0], 2e-3)
        self.assertLess(swings[1], 0.1 * swings[0])


class WorkspaceTest(unittest.TestCase):
    def test_tips_are_those_of_the_pressures(self):
        scene = helix_arm.Scene.load("helical_50")
        found = scene.workspace(50_000, seed=3, threads=2)
        self.assertEqual(found.tips.shape, (50_000, 3))
        np.testing.assert_allclose(scene.tips(found.pressures_pa), found.tips, atol=1e-14)
        again = scene.workspace(20_000, seed=3, threads=1)
        np.testing.assert_array_equal(again.tips, found.tips[:20_000])
        self.assertGreater(np.abs(scene.workspace(10, seed=4).tips - found.tips[:10]).max(), 1e-3)

    def test_extremes_are_beyond_its_tips(self):
        scene = helix_arm.Scene.load("helical_50")
        found = scene.workspace(1000, sensitivity=True, extremes=True)
        self.assertEqual(found.moved_per_kpa_m.shape, (1000,))
        np.testing.assert_allclose(scene.tips(found.extreme_pressures_pa), found.extreme_tips, atol=1e-12)
        self.assertTrue((found.extreme_tips[[3, 4, 5], [0, 1, 2]] >= found.tips.max(axis=0)).all())


class CurveTest(unittest.TestCase):
    def test_ends_at_base_and_tip(self):
        for name in ["helical_50", "loaded"]:
            scene = helix_arm.Scene.load(name)
            p = pressures_of(scene, 3)
            curve, ends = scene.curve(p, points=11), scene.forward(p)
            np.testing.assert_allclose(curve.positions[:, 0], 0, atol=1e-15)
            np.testing.assert_allclose(curve.positions[:, -1], ends.tips, atol=1e-12)
            np.testing.assert_allclose(curve.quaternions_xyzw[:, -1], ends.quaternions_xyzw, atol=1e-12)

if __name__ == "__main__":
    unittest.main()
