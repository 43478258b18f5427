"""Whatever is passed in, an exception names argument and rule; the interpreter stays."""
import pathlib
import subprocess
import sys
import unittest
import warnings

import helix_arm
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from test_size import draws

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
            for bad in [np.zeros(2), np.zeros((4, 2)), np.zeros((2, 2, 3)), np.zeros(()), np.zeros((3, 0)), np.zeros(0)]:
                self.refuses(ValueError, ["pressures_pa has shape", "expected (3,) or (N, 3)"], call, bad)
            for bad in [np.zeros(3, complex), np.zeros(3, bool),
                        np.array(["1", "2", "3"]), np.array([None, 1, 2])]:
                self.refuses(TypeError, ["pressures_pa has dtype", "expected float64"], call, bad)
            for bad in [None, "1,2,3", 7, {1, 2, 3}, object()]:
                self.refuses(TypeError, ["pressures_pa is of type", "numpy array"], call, bad)
            for bad in [[1, "a", 2], [[1, 2, 3], [1, 2]], ["1", "2", "3"], [None] * 3]:
                self.refuses(TypeError, ["pressures_pa is a list"], call, bad)

    def test_limits_and_finiteness_of_pressures(self):
        for call in [self.scene.forward, self.scene.tips, self.scene.curve, self.scene.jacobian]:
            for value in [np.nan, np.inf, -np.inf, -1e-9, 413685.7, 1e300]:
                self.refuses(ValueError, ["pressures_pa asks muscle_2 for", "in row 3", "its limits are 0 to 413685.6 Pa"],
                             call, with_entry(value))

    def test_targets_and_starts_of_the_inverse(self):
        inverse = self.scene.inverse
        self.refuses(ValueError, ["0 targets", "exactly one of tip, pose and twists"], inverse)
        self.refuses(ValueError, ["2 targets"], inverse, np.zeros(3), twists=np.zeros((1, 6)))
        self.refuses(ValueError, ["tip has shape (4,)", "(3,) or (N, 3)"], inverse, np.zeros(4))
        self.refuses(ValueError, ["tip holds nan in row 1, column 2"], inverse, np.array([[0, 0, 0], [0, 0, np.nan]]))
        self.refuses(ValueError, ["beyond 1000000"], inverse, np.array([2e6, 0, 0]))
        self.refuses(ValueError, ["quaternion of norm 0"], inverse, pose=np.zeros(7))
        self.refuses(ValueError, ["twists has shape (6,)", "(1, 6) or (N, 1, 6)"], inverse, twists=np.zeros(6))
        self.refuses(ValueError, ["start asks muscle_1 for -1 Pa"], inverse, np.zeros(3), start=np.array([-1.0, 0, 0]))
        self.refuses(ValueError, ["start has 2 rows", "tip: 3"], inverse, np.zeros((3, 3)), start=np.zeros((2, 3)))
        self.refuses(ValueError, ["prefer is \"low\"", "min-pressure"], inverse, np.zeros(3), prefer="low")
        self.refuses(ValueError, ["cocontraction"], inverse, np.zeros(3), prefer="cocontract", cocontraction=2)

    def test_numbers(self):
        self.refuses(ValueError, ["threads is -1", "0 for all cores"], self.scene.tips, GOOD, threads=-1)
        self.refuses(ValueError, ["points is 1", "expected 2 to"], self.scene.curve, GOOD, points=1)
        self.refuses(ValueError, ["points is -5"], self.scene.workspace, -5)
        self.refuses(TypeError, ["points is of type float; expected an int"], self.scene.curve, GOOD, points=2.5)
        self.refuses(ValueError, ["points is 1000000000000; expected 2 to"], self.scene.curve, GOOD, points=10**12)
        self.refuses(ValueError, ["points is beyond 64 bits"], self.scene.workspace, 10**30)
        self.refuses(TypeError, ["points is of type bool"], self.scene.workspace, True)
        for call in [self.scene.forward, self.scene.tips, self.scene.curve, self.scene.jacobian]:
            self.refuses(TypeError, ["threads is of type float"], call, GOOD, threads=1.5)
            self.refuses(TypeError, ["unexpected keyword argument 'pressures'"], call, pressures=GOOD)
        self.refuses(ValueError, ["seed is -1; expected 0 to"], self.scene.workspace, 5, seed=-1)
        self.refuses(TypeError, ["seed is of type str"], self.scene.follow, np.zeros(3), seconds=1, seed="a")
        self.refuses(TypeError, ["seconds is of type str"], self.scene.follow, np.zeros(3), seconds="1")
        self.refuses(TypeError, ["rig is of type str; expected a Scene"], self.scene.follow, np.zeros(3), seconds=1, rig="demo")
        self.refuses(TypeError, ["prefer is of type int; expected a str"], self.scene.inverse, np.zeros(3), prefer=3)
        self.refuses(TypeError, ["cocontraction is of type NoneType"], self.scene.inverse, np.zeros(3), cocontraction=None)
        self.refuses(TypeError, ["sensitivity is of type int; expected True or False"], self.scene.workspace, 5, sensitivity=1)
        np.testing.assert_array_equal(self.scene.tips(GOOD, threads=np.int32(2)), self.scene.tips(GOOD))

    def test_words_of_derivatives(self):
        jacobian, rule = self.scene.jacobian, "expected one or several of pressures, lengths, stiffness, load"
        self.refuses(ValueError, ["by holds \"presures\"; " + rule], jacobian, GOOD, by="presures")
        self.refuses(ValueError, ["by holds \"tip\"; " + rule], jacobian, GOOD, by=["pressures", "tip"])
        self.refuses(ValueError, ["by holds \"\"; " + rule], jacobian, GOOD, by="")
        for empty in [[], (), {}, np.zeros(0)]:
            self.refuses(ValueError, ["by is empty; " + rule], jacobian, GOOD, by=empty)
        for bad in [None, 3, 2.5, object(), b"load"]:
            self.refuses(TypeError, [f"by is of type {type(bad).__name__}; expected a list of words"], jacobian, GOOD, by=bad)
        self.refuses(TypeError, ["by[1] is of type int; expected a str"], jacobian, GOOD, by=["load", 3])
        self.refuses(ValueError, ["by[0] is '\\udc80'"], jacobian, GOOD, by="\udc80")
        self.refuses(TypeError, ["positional arguments"], jacobian, GOOD, 1, "load")

    def test_out_that_overlaps(self):
        memory = np.tile(GOOD, (5, 1))
        for rows, out in [(memory, memory), (memory[:-1], memory[1:]), (memory[::-1][1:], memory[:-1])]:
            self.refuses(ValueError, ["out overlaps pressures_pa"], self.scene.tips, rows, out=out)
        np.testing.assert_array_equal(memory, np.tile(GOOD, (5, 1)))
        self.scene.tips(memory[:2], out=memory[2:4])
        np.testing.assert_allclose(memory[3], self.scene.tips(GOOD), atol=1e-15)

    def test_kilopascals(self):
        with self.assertWarnsRegex(UserWarning, "^pressures_pa looks like kPa, as no pressure reaches 1000 Pa") as caught:
            self.scene.forward([200.0, 0.0, 50.0])
        self.assertEqual(caught.filename, __file__)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for good in [GOOD, np.zeros(3), np.array([[0, 0, 0], [1, 2, 3], GOOD])]:
                self.scene.tips(good)
            self.refuses(UserWarning, ["looks like kPa"], self.scene.tips, np.ones((3, 3)))
            # Of a batch, rows from its beginning to its end are judged: 64 of them.
            many = 100_000
            self.refuses(UserWarning, ["looks like kPa", "in up to 64 rows, evenly spread"], self.scene.tips, np.ones((many, 3)))
            self.scene.tips(np.outer(np.linspace(0, 1, many), GOOD))
            for layout in [np.zeros((many, 3)), np.zeros((many, 3), order="F")]:
                self.scene.tips(layout)

    def test_kilopascals_are_warned_of_once_per_place(self):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("default")  # as of a script
            for value in np.linspace(1, 900, 100):
                self.scene.tips(np.full(3, value))
                self.scene.inverse(np.zeros(3), start=np.full((1, 3), value))
            self.scene.forward(np.full((100, 3), 5.0))
        self.assertEqual(len(caught), 3, [str(one.message) for one in caught])
        self.assertEqual({str(one.message).split()[0] for one in caught}, {"pressures_pa", "start"})

    def test_other_numbers_are_converted(self):
        for dtype in [np.float32, np.int64, np.uint32, ">f8"]:
            given = np.array([[100_000, 0, 50_000]], dtype)
            self.assertTrue(np.array_equal(self.scene.tips(given), self.scene.tips(given.astype(float))), dtype)
            self.assertTrue(np.array_equal(self.scene.tips(given[:, ::-1]), self.scene.tips(given[:, ::-1].astype(float))), dtype)

    def test_tips_in_millimetres_are_warned_of(self):
        with self.assertWarnsRegex(UserWarning, "tip is 3.* expected metres, and these seem to be millimetres"):
            self.scene.inverse(np.array([300.0, 20.0, 30.0]))
        with self.assertWarnsRegex(UserWarning, "tips is 3.* millimetres"):
            self.scene.follow([[300.0, 20.0, 30.0]], seconds=1)
        self.refuses(ValueError, ["seconds is missing, which tips need"], self.scene.follow, [[0.36, 0.02, 0.03]])

    def test_out(self):
        read_only = np.zeros(3)
        read_only.setflags(write=False)
        for bad in [np.zeros(4), np.zeros((1, 3)), np.zeros(3, np.float32), np.zeros(6)[::2], read_only, [0, 0, 0]]:
            self.refuses(ValueError, ["out is no array", "shape (3,)"], self.scene.tips, GOOD, out=bad)

    def test_scenes(self):
        load = helix_arm.Scene.load
        self.refuses(ValueError, ["path_or_name: the scene none is neither", "or annotated, "], load, "none")
        self.refuses(helix_arm.DocumentError, ["/no/such.yaml"], load, "/no/such.yaml")
        self.refuses(helix_arm.DocumentError, ["arm.stiffness.K_gamma"], load, "demo", {"arm.stiffness.K_gamma": -1})
        self.refuses(TypeError, ["overrides['load']"], load, "demo", {"load": object()})
        self.refuses(TypeError, ["overrides is list"], load, "demo", [])
        self.refuses(TypeError, ["path_or_name is bytes"], load, b"demo")
        self.refuses(TypeError, ["path_or_name is NoneType"], load, None)
        self.refuses(ValueError, ["path_or_name is '\\udc80'", "UTF-8"], load, "\udc80")
        self.refuses(ValueError, ["overrides['name'] is '\\udc80'"], load, "demo", {"name": "\udc80"})
        self.refuses(ValueError, ["a key of overrides is '\\udc80'"], load, "demo", {"\udc80": "x"})
        self.refuses(TypeError, ["path is of type int; expected a str"], helix_arm.Scene, 3)
        self.refuses(TypeError, ["overrides is of type int; expected a list of pairs"], helix_arm.Scene, "demo", 3)
        self.refuses(TypeError, ["an entry of overrides is of type str"], helix_arm.Scene, "demo", ["name"])
        load(pathlib.Path(load("demo").path))

    def test_measurements(self):
        scene = self.scene
        self.refuses(TypeError, ["captures is of type int"], scene.fit, 3)
        self.refuses(ValueError, ["captures has 0 columns"], scene.fit, {})
        self.refuses(ValueError, ["captures[\"y_m\"] has shape (2,)"], scene.fit, {"x_m": np.zeros(3), "y_m": np.zeros(2)})
        self.refuses(ValueError, ["captures[\"x_m\"] holds nan"], scene.fit, {"x_m": np.full(3, np.nan)})
        self.refuses(helix_arm.DocumentError, ["identify its kind of data"], scene.fit, {"a": np.zeros(3)})
        self.refuses(ValueError, ["data is empty"], scene.calibrate, [])
        self.refuses(ValueError, ["captures is '\\udc80'"], scene.fit, "\udc80")
        self.refuses(TypeError, ["a name of a column of captures is of type int"], scene.fit, {3: np.zeros(3)})
        self.refuses(ValueError, ["a name of a column of captures is '\\udc80'"], scene.fit, {"\udc80": np.zeros(3)})
        self.refuses(TypeError, ["image is no array of bytes"], scene.localize, np.zeros((720, 1280)), GOOD)
        self.refuses(ValueError, ["image has shape (7, 5)", "(720, 1280)"], scene.localize, np.zeros((7, 5), np.uint8), GOOD)
        self.refuses(ValueError, ["lacks one"], helix_arm.Scene.load("helical_50").localize, np.zeros((7, 5), np.uint8), GOOD)

    def test_calibrations(self):
        def calibrate(*data, **named):
            return self.scene.calibrate(*(data or [{"pressure_1_kpa": np.zeros(3), "curvature_rad": np.zeros(3)}]), **named)

        for bad in [5, None, 2.5, object(), b"table.csv", np.array(3.0)]:
            self.refuses(TypeError, [f"data is of type {type(bad).__name__}; expected the path"], calibrate, bad)
            self.refuses(TypeError, [f"fit is of type {type(bad).__name__}; expected a list of words"], calibrate, fit=bad)
        self.refuses(TypeError, ["data[1] is of type int; expected the path"], calibrate,
                     [{"pressure_1_kpa": np.zeros(3), "curvature_rad": np.zeros(3)}, 3])
        self.refuses(TypeError, ["fit[1] is of type int; expected a str"], calibrate, fit=["stiffness", 3])
        self.refuses(ValueError, ["\"flexibility\"", "stiffness"], calibrate, fit="flexibility")
        self.refuses(TypeError, ["contraction is of type int; expected a str"], calibrate, contraction=3)
        for name in ["curvature_noise_rad", "corner_noise_px", "position_noise_m", "rotation_noise_rad", "rest_offset_m"]:
            for bad in ["x", None, [1, 2], object()]:
                self.refuses(TypeError, [f"{name} is of type {type(bad).__name__}; expected a number"], calibrate, **{name: bad})
            for bad, text in [(-1, "-1"), (np.nan, "nan"), (np.inf, "inf")]:
                self.refuses(ValueError, [f"{name} is {text}; expected a finite number >= 0"], calibrate, **{name: bad})
        self.refuses(TypeError, ["errors is of type int; expected True or False"], calibrate, errors=0)

    def test_runs(self):
        follow = self.scene.follow
        self.refuses(ValueError, ["either tips or path"], follow, seconds=1)
        self.refuses(ValueError, ["seconds is 0", "0.1 to 3600"], follow, np.zeros(3), seconds=0)
        self.refuses(ValueError, ["seconds is nan"], follow, np.zeros(3), seconds=np.nan)
        self.refuses(ValueError, ["too short for 3 tips"], follow, np.zeros((3, 3)), seconds=1)
        self.refuses(ValueError, ["sight is \"eyes\""], follow, np.zeros(3), seconds=1, sight="eyes")
        self.refuses(ValueError, ["force has shape (3,)"], follow, np.zeros(3), seconds=1, force=np.zeros(3))
        self.refuses(ValueError, ["blind ends at 1"], follow, np.zeros(3), seconds=1, blind=np.array([2.0, 1.0]))
        self.refuses(ValueError, ["path"], follow, path=np.zeros((2, 4)), seconds=1)

    def test_more_rows_than_memory(self):
        scene = self.scene
        for count in [10**13, 2**57, 2**58]:
            # Rows that are not read through: of zeros, none says whether they are Pa.
            for row in [GOOD, np.zeros(3)]:
                huge = np.broadcast_to(row, (count, 3))
                for call in [scene.forward, scene.tips, scene.curve, scene.jacobian]:
                    self.refuses(MemoryError, [f"pressures_pa has {count} rows", "expected at most"], call, huge)
                self.refuses(MemoryError, [f"tip has {count} rows"], scene.inverse, huge)
                self.refuses(MemoryError, [f"tip has {count} rows"], scene.inverse, huge, start=GOOD)
                self.refuses(ValueError, [f"start has {count} rows", "tip: 1"], scene.inverse, np.zeros(3), start=huge)
                self.refuses(ValueError, [f"tips has {count} rows; expected 1 to 1000"], scene.follow, huge, seconds=1)
                self.refuses(ValueError, ["out is no array"], scene.tips, GOOD, out=huge)
                self.refuses(ValueError, [f"pressures_pa has {count} rows; expected one per picture: 1"], scene.localize,
                             np.zeros((720, 1280), np.uint8), huge)
            column = np.broadcast_to(0.0, (count,))
            for call in [scene.fit, scene.calibrate]:
                self.refuses(ValueError, [f"[\"x_m\"] has shape ({count},); expected 1 to 200000"], call, {"x_m": column})
        many = 2**56
        for name, width in [("force", 4), ("blind", 2)]:
            self.refuses(ValueError, [f"{name} has {many} rows; expected one"], scene.follow, np.zeros(3), seconds=1,
                         **{name: np.broadcast_to(0.0, (many, width))})
        self.refuses(ValueError, [f"path has {many} rows; expected 2 to 100000"], scene.follow, seconds=1,
                     path=np.broadcast_to(0.0, (many, 4)))
        self.refuses(MemoryError, [f"pose has {many} rows"], scene.inverse, pose=np.broadcast_to(0.0, (many, 7)))
        for call, given in [(scene.inverse, {"twists": np.broadcast_to(0.0, (many, 1, 6))}),
                            (scene.localize, {"image": np.broadcast_to(np.uint8(0), (2**43, 720, 1280))})]:
            with self.assertRaises(MemoryError) as caught:
                call(**given)
            self.assertIn(str(many) if "twists" in given else str(2**43), str(caught.exception))


# A child, as such an object once ended the process. The last one is of an __init__() that failed.
UNMADE = """
import helix_arm, numpy as np
from helix_arm import _core
def refused(call):
    try:
        call()
    except TypeError as error:
        assert "without __init__()" in str(error), error
    else:
        raise AssertionError("not refused")
kinds = [kind for kind in vars(_core).values() if isinstance(kind, type) and not issubclass(kind, Exception)]
assert _core.Scene in kinds and len(kinds) == 8, kinds
objects = [kind.__new__(kind) for kind in kinds + [helix_arm.Scene] * 2]
try:
    objects[-1].__init__("/no/such.yaml")
except helix_arm.DocumentError:
    pass
for one in objects:
    for name in dir(one):
        if isinstance(getattr(type(one), name), property):
            refused(lambda: getattr(one, name))
for one in objects[-2:]:
    for call in [lambda: repr(one), lambda: one.forward(np.zeros(3)), lambda: one.tips(np.zeros(3)),
                 lambda: one.curve(np.zeros(3)), lambda: one.jacobian(np.zeros(3)), lambda: one.inverse(np.zeros(3)),
                 lambda: one.workspace(5), lambda: one.fit("a.csv"), lambda: one.localize(np.zeros((7, 5), np.uint8)),
                 lambda: one.calibrate("a.csv"), lambda: one.follow(np.zeros(3), seconds=1),
                 lambda: helix_arm.Scene.load("demo").follow(np.full(3, 0.1), seconds=1, rig=one)]:
        refused(call)
print(len(objects))
"""


class UnmadeObjectTest(unittest.TestCase):
    def test_an_object_without_init_is_refused(self):
        result = subprocess.run([sys.executable, "-c", UNMADE], capture_output=True, text=True, timeout=60)
        self.assertEqual((result.returncode, result.stderr, result.stdout), (0, "", "10\n"))


class RandomCallTest(unittest.TestCase):
    CALLS = draws(2_000, 10_000)

    def value(self, random):
        """Mostly wrong in one way or another."""
        kind = random.integers(12)
        shape = tuple(random.integers(0, 5, random.integers(0, 4)))
        if kind < 5:
            shape = [(3,), (2, 3), (0, 3), (1, 6), (2, 1, 6)][kind]
        numbers = random.choice([0.0, 1e5, -1.0, 1e300, np.nan, np.inf, 0.3]) * random.uniform(0, 1, shape)
        layout = random.integers(7)
        if layout == 0:
            numbers = np.asfortranarray(numbers)
        elif layout == 1 and numbers.ndim:
            numbers = np.repeat(numbers, 2, axis=-1)[..., ::-2]
        elif layout == 2:
            numbers = np.asarray(numbers).astype(random.choice([np.float32, np.int64, np.complex128, ">f8", "U5", object]))
        elif layout == 3:
            numbers = np.asarray(numbers)
            numbers.setflags(write=False)
        elif layout == 4:
            numbers = np.asarray(numbers).tolist()
        elif layout == 5 and random.integers(3) == 0:
            return random.choice(np.array([None, "text", b"bytes", 3, -1, 2.5, True, {}, object(), 10**30], dtype=object))
        return numbers

    def test_only_named_exceptions_leave(self):
        random = np.random.default_rng(20)
        scenes = [helix_arm.Scene.load(name) for name in ["demo", "planar_50", "loaded"]]
        arguments = {
            "forward": ["pressures_pa", "threads"], "tips": ["pressures_pa", "out", "threads"],
            "curve": ["pressures_pa", "points"], "jacobian": ["pressures_pa", "threads", "by"],
            "inverse": ["tip", "pose", "twists", "start", "prefer", "cocontraction", "threads"],
            "workspace": ["points", "seed", "sensitivity"], "fit": ["captures"], "localize": ["image", "pressures_pa"],
            "calibrate": ["data", "fit", "contraction", "curvature_noise_rad", "corner_noise_px", "position_noise_m",
                          "rotation_noise_rad", "rest_offset_m", "errors"], "follow": ["tips", "path", "seconds", "sight", "force", "blind", "seed"],
        }
        refused = 0
        for _ in range(self.CALLS):
            name = str(random.choice(list(arguments)))
            # The run of a follow() that is right takes seconds.
            given = {one: self.value(random) for one in arguments[name] if random.integers(3) > 0}
            if name == "jacobian" and random.integers(3) > 0:
                given["by"] = random.choice(["pressures", "lengths", "stiffness", "load", "tip"], random.integers(4)).tolist()
            if isinstance(given.get("points"), int):
                given["points"] = min(given["points"], 1000)
            if name == "follow":
                given["seconds"] = 0.1 if random.integers(50) == 0 else self.value(random)
            try:
                getattr(scenes[random.integers(len(scenes))], name)(**given)
            except (TypeError, ValueError, MemoryError) as error:
                refused += 1
                self.assertTrue(str(error))
                self.assertNotIn("incompatible function arguments", str(error))
        self.assertGreater(refused, self.CALLS // 2)
        self.assertLess(refused, self.CALLS, "no call was right")


if __name__ == "__main__":
    unittest.main()
