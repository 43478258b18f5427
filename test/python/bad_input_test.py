"""Whatever is passed in, an exception names argument and rule; the interpreter stays."""
import pathlib
import unittest
import warnings

import helix_arm
import numpy as np

GOOD = np.array([1e5, 2e5, 0.0])


def with_entry(value):
    rows = np.tile(GOOD, (5, 1))
    rows[3, 1] = value
    return rows


class RuleTest(unittest.TestCase):
    def setUp(self):
        self.scene = helix_arm.Scene.load("demo")

    def refuses(self, kind, words, call, *arguments, **named):
        with self.assertRaises(kind) as caught:
            call(*arguments, **named)
        for word in words:
            self.assertIn(word, str(caught.exception))

    def test_shape_and_type_of_pressures(self):
        for call in [self.scene.forward, self.scene.tips, self.scene.curve, self.scene.jacobian]:
            for bad in [np.zeros(2), np.zeros((2, 2, 3)), np.zeros(0), 7]:
                self.refuses(ValueError, ["pressures_pa has shape", "expected (3,) or (N, 3)"], call, bad)
            for bad in [np.zeros(3, complex), np.array([None, 1, 2]), None, "1,2,3", [[1, 2, 3], [1, 2]]]:
                self.refuses(TypeError, ["pressures_pa is ", "expected a numpy array of float64"], call, bad)

    def test_limits_and_finiteness_of_pressures(self):
        for call in [self.scene.forward, self.scene.tips, self.scene.curve, self.scene.jacobian]:
            for value in [np.nan, np.inf, -np.inf, -1e-9, 413685.7, 1e300]:
                self.refuses(ValueError, ["pressures_pa asks muscle_2 for", "in row 3", "its limits are 0 to 413685.6 Pa"],
                             call, with_entry(value))

    def test_numbers(self):
        self.refuses(ValueError, ["threads is -1", "0 for all cores"], self.scene.tips, GOOD, threads=-1)
        self.refuses(ValueError, ["points is 1", "expected 2 to"], self.scene.curve, GOOD, points=1)
        self.refuses(TypeError, ["points is of type float; expected an int"], self.scene.curve, GOOD, points=2.5)
        self.refuses(ValueError, ["points is beyond 64 bits"], self.scene.workspace, 10**30)
        self.refuses(TypeError, ["sensitivity is of type int; expected True or False"], self.scene.workspace, 5, sensitivity=1)
        np.testing.assert_array_equal(self.scene.tips(GOOD, threads=np.int32(2)), self.scene.tips(GOOD))

    def test_out_that_overlaps(self):
        memory = np.tile(GOOD, (5, 1))
        for rows, out in [(memory, memory), (memory[:-1], memory[1:]), (memory[::-1][1:], memory[:-1])]:
            self.refuses(ValueError, ["out overlaps pressures_pa"], self.scene.tips, rows, out=out)
        np.testing.assert_array_equal(memory, np.tile(GOOD, (5, 1)))
        self.scene.tips(memory[:2], out=memory[2:4])
        np.testing.assert_allclose(memory[3], self.scene.tips(GOOD), atol=1e-15)

    def test_kilopascals(self):
        with self.assertWarnsRegex(UserWarning, "^all pressures of pressures_pa are at most 200 Pa, which looks like kPa") as caught:
            self.scene.forward([200.0, 0.0, 50.0])
        self.assertEqual(caught.filename, __file__)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for good in [GOOD, np.zeros(3), np.array([[0, 0, 0], [1, 2, 3], GOOD])]:
                self.scene.tips(good)
            self.refuses(UserWarning, ["looks like kPa"], self.scene.tips, np.ones((3, 3)))
            # Of a batch, rows from its beginning to its end are judged: 64 of them.
            many = 100_000
            self.refuses(UserWarning, ["looks like kPa"], self.scene.tips, np.ones((many, 3)))
            self.scene.tips(np.outer(np.linspace(0, 1, many), GOOD))
            for layout in [np.zeros((many, 3)), np.zeros((many, 3), order="F")]:
                self.scene.tips(layout)

    def test_tips_in_millimetres_are_warned_of(self):
        with self.assertWarnsRegex(UserWarning, "tip is 3.* expected metres, and these seem to be millimetres"):
            self.scene.inverse(np.array([300.0, 20.0, 30.0]))
        with self.assertWarnsRegex(UserWarning, "tips is 3.* millimetres"):
            self.scene.follow([[300.0, 20.0, 30.0]], seconds=1)
        self.refuses(ValueError, ["seconds is missing, which tips need"], self.scene.follow, [[0.36, 0.02, 0.03]])

    def test_scenes(self):
        load = helix_arm.Scene.load
        self.refuses(ValueError, ["path_or_name: the scene none is neither", "or annotated, "], load, "none")
        self.refuses(helix_arm.DocumentError, ["arm.stiffness.K_gamma"], load, "demo", {"arm.stiffness.K_gamma": -1})
        self.refuses(TypeError, ["overrides['load']"], load, "demo", {"load": object()})
        load(pathlib.Path(load("demo").path))


if __name__ == "__main__":
    unittest.main()
