"""helix_arm.experiments: figures against closed forms and recordings of real arms; a run that is stopped, killed and resumed."""
import contextlib
import json
import math
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from helix_arm.experiments import EXPERIMENTS, Recording, iso9283, read_series, step

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from test_size import draws

DATA = Path(__file__).resolve().parents[3] / "shared/data"
COMMAND = None
TIME = np.arange(1, 20001) / 100


def recording(target, tip, time=TIME):
    """Of one actuator whose readings are its targets, and a tip that moves along x."""
    tips = np.column_stack([tip, np.zeros((len(time), 2))])
    return Recording(time, target[:, None], target[:, None], tips)


def figures(name, trials, actuators=("m",)):
    return {one.name: one for one in EXPERIMENTS[name].analyse(trials, actuators).figures}


class ClosedFormTest(unittest.TestCase):
    def test_iso_9283_as_computed_by_hand(self):
        x = np.array([[1.0, 0, 0], [-1, 0, 0], [3, 0, 0], [-3, 0, 0]])  # l = 1, 1, 3, 3: mean 2, S = sqrt(4 / 3)
        self.assertAlmostEqual(iso9283.pose_accuracy(x, np.array([0.0, 3, 4])), 5)
        self.assertAlmostEqual(iso9283.pose_repeatability(x), 2 + 3 * 1.1547005383792515)
        one, two = np.zeros((3, 3)), np.array([[3.0, 0, 0], [0, 4, 0], [0, 0, 5]])  # D = 3, 4, 5: mean 4, S = 1
        self.assertAlmostEqual(iso9283.distance_accuracy(one, two, 3.5), 0.5)
        self.assertAlmostEqual(iso9283.distance_repeatability(one, two), 3)
        paths = np.stack([x, 2 * x], axis=1)  # the second point is twice as far: RT = 2 RP
        self.assertAlmostEqual(iso9283.path_repeatability(paths), 2 * (2 + 3 * 1.1547005383792515))
        self.assertAlmostEqual(iso9283.path_accuracy(paths, np.array([[0.0, 3, 4], [0, 6, 8]])), 10)
        far = np.array([[1.0, 2, 0], [-1, 2, 0]])  # barycentre (0, 2, 0), l = 1, 1
        self.assertAlmostEqual(iso9283.accuracy_drift(x, far, np.zeros(3)), 2)
        self.assertAlmostEqual(iso9283.repeatability_drift(x, far), 1 - (2 + 3 * 1.1547005383792515))

    def test_step_of_a_second_order_arm(self):
        zeta, w, target = 0.3, 4.0, np.where((TIME // 10) % 2 == 1, 2e5, 1e5)
        tip, wd = np.zeros(len(TIME)), w * math.sqrt(1 - zeta**2)
        for k in range(1, 20):
            t = np.maximum(TIME - 10 * k, 0)
            tip -= (-1) ** k * (1 - np.exp(-zeta * w * t) * (np.cos(wd * t) + zeta * w / wd * np.sin(wd * t)))
        found = figures("step", {"m": recording(target, tip)})
        self.assertAlmostEqual(found["m up overshoot, tip"].value, 100 * math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2)), delta=0.05)
        rest = brentq(lambda t: math.exp(-zeta * w * t) * (math.cos(wd * t) + zeta * w / wd * math.sin(wd * t)) - 0.37, 0, 1)
        # The last row before the step is 0.01 s earlier.
        self.assertAlmostEqual(found["m up 63 % time, tip"].value, 0.01 + rest, delta=0.001)
        self.assertAlmostEqual(found["m frequency"].value, w / 2 / math.pi, delta=0.01)
        self.assertAlmostEqual(found["m damping ratio"].value, zeta, delta=0.01)

    def test_a_dead_time_is_apart_from_the_ramp_of_the_command(self):
        ramp, lag, dead = 1.2, 0.08, 0.05

        def reached(time):
            since = np.maximum(time[:, None] - [0, ramp], 0)
            return (since - lag * (1 - np.exp(-since / lag))) @ [1, -1] / ramp

        target, pressure = np.full(len(TIME), 1e5), 1e5 + 200 * np.random.default_rng(4).standard_normal(len(TIME))
        for k in range(1, 20):
            target -= (-1) ** k * 1e5 * np.clip((TIME - 10 * k) / ramp, 0, 1)
            pressure -= (-1) ** k * 1e5 * reached(TIME - 10 * k - dead)
        found = figures("step", {"m": Recording(TIME, target[:, None], pressure[:, None], recording(target, 1e-6 * pressure).tip_m)})
        self.assertAlmostEqual(found["m up dead time, pressure"].value, dead, delta=0.002)
        self.assertLess(found["m up dead time, pressure"].standard_error, 0.002)
        self.assertGreater(found["m up 5 % time, pressure"].value, dead + 0.08, "with the ramp")

    def test_the_vent_after_the_last_step_is_no_part_of_it(self):
        time = np.arange(0, 8, 0.01)
        target = np.interp(time, [0, 0.1, 2, 2.1, 4, 4.1, 6, 6.1], [0, 10, 10, 60, 60, 10, 10, 0])
        self.assertLess(time[step.steps_of(time, target)[-2].end], 6.02)

    def test_loop_of_play_and_lag(self):
        period = np.where(TIME < 100, 20.0, 5.0)
        target = 1e5 + 1e5 * np.abs(2 * ((TIME / period) % 1) - 1) * -1 + 1e5
        played, at, tip = 6e3, target[0], np.empty(len(TIME))
        for i, one in enumerate(np.interp(TIME - 0.2, TIME, target)):
            at = min(max(at, one - played), one + played)
            tip[i] = 1e-6 * at
        found = figures("hysteresis", {"m": recording(target, tip)})
        self.assertAlmostEqual(found["m play"].value, 6, delta=0.05)
        self.assertAlmostEqual(found["m lag"].value, 0.2, delta=0.005)
        self.assertAlmostEqual(found["m stroke"].value, 84, delta=0.05)  # 100 - 2 * 6 - 2 * 0.2 s of 10 kPa/s
        self.assertAlmostEqual(found["m loop width at 20 s"].value, 100 * 16 / 84, delta=0.05)

    def test_creep_that_is_a_logarithm(self):
        since = TIME - 20
        tip = np.where(since > 0, 0.05 + 2e-3 * np.log10(np.maximum(since, 0.01)), 0.0)
        found = figures("creep", {"m": recording(np.where(since > 0, 2e5, 0.0), tip)})
        self.assertAlmostEqual(found["m creep"].value, 2, delta=0.01)

    def test_frequency_response_of_a_lag(self):
        f, tau = np.array([0.05, 0.15, 0.35, 0.75, 1.55]), 0.4
        angle = 2 * np.pi * np.outer(TIME, f)
        lag = np.arctan(2 * np.pi * f * tau)
        tip = (np.cos(angle - lag) / np.sqrt(1 + (2 * np.pi * f * tau) ** 2)).sum(axis=1)
        target = 1e5 + 1e4 * np.cos(angle).sum(axis=1)
        found = figures("bode", {"m period 20 s": recording(target, 1e-2 * tip)})
        self.assertAlmostEqual(found["m gain at 0.75 Hz"].value, 1 / math.hypot(1, 2 * math.pi * 0.75 * tau), delta=1e-4)
        self.assertAlmostEqual(found["m phase at 0.75 Hz"].value, -math.degrees(math.atan(2 * math.pi * 0.75 * tau)), delta=0.02)


@unittest.skipUnless(DATA.exists(), f"{DATA}, recordings of real arms, is absent")
class RealArmTest(unittest.TestCase):
    def within(self, figure, expected, digits):
        self.assertLess(abs(figure.value - expected), 2 * figure.standard_error + digits, figure.name)

    def test_steps_of_a_three_chamber_arm(self):
        trials = read_series(DATA / "three_chamber_steps.csv", 3)
        found = figures("step", {name: trials[name] for name in "45"}, ["1", "2", "3"])
        self.within(found["1 up 10 to 172 kPa 63 % time, tip"], 2.9, 0.05)  # as told: to a tenth
        self.within(found["1 down 172 to 10 kPa 63 % time, tip"], 2.7, 0.05)
        self.within(found["1 up 10 to 172 kPa drift of the start"], 4.5, 0.05)

    def test_rings_of_a_silicone_segment(self):
        found = figures("step", read_series(DATA / "silicone_rings.csv", 0), [])
        self.within(found["arm frequency"], 8.14, 0.005)
        self.within(found["arm damping ratio"], 0.084, 0.0005)


class RunTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.out = Path(folder.name)

    def words(self, out, *more, call=("step", "demo", "--actuators", "muscle_1,muscle_3", "--repeats", "2", "--hold-s", "4")):
        return [COMMAND, "experiment", *call, "--out", str(out), "--format", "json", *more]

    def interrupted(self, words, parts, number):
        """Exit code and output of a call that got the signal in the middle of the trial whose file `parts` names."""
        call = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        while call.poll() is None:
            with contextlib.suppress(FileNotFoundError):  # one that is complete by now
                if any(part.stat().st_size > 10000 for part in parts.parent.glob(parts.name)):
                    break
        call.send_signal(number)
        return call.communicate(timeout=60)[0], call.returncode

    def test_a_stopped_or_killed_run_keeps_what_it_has_and_resumes(self):
        whole = json.loads(subprocess.run(self.words(self.out / "whole"), stdout=subprocess.PIPE, check=True).stdout)
        self.assertEqual(list(whole), ["experiment", "scene", "scene_sha256", "version", "date", "figures", "ended"])
        self.assertEqual(set(whole["figures"][0]), {"name", "symbol", "value", "standard_error", "unit", "definition"})
        for number, code in ((signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL))[:draws(1, 2)]:
            out = self.out / str(number)
            said, exit_code = self.interrupted(self.words(out), out / "raw/step-muscle_3.part.csv", number)
            self.assertEqual(exit_code, code)
            rows = read_series(out / "raw/step-muscle_3.part.csv", 3)["muscle_3"]
            self.assertGreater(len(rows.time_s), 50)
            if number == signal.SIGINT:
                self.assertEqual(json.loads(said)["ended"], "muscle_3: interrupted")
            again = json.loads(subprocess.run(self.words(out), stdout=subprocess.PIPE, check=True).stdout)
            self.assertEqual(again["figures"], whole["figures"])
        self.assertTrue(all((self.out / "whole" / f"step.{kind}").stat().st_size > 1000 for kind in ("pdf", "html", "json")))
        refused = subprocess.run(self.words(self.out / "whole", "--seed", "2"), stderr=subprocess.PIPE)
        self.assertEqual(refused.returncode, 2)
        self.assertIn(b"is of another scene, rig, protocol or seed; choose another --out", refused.stderr)


if __name__ == "__main__":
    COMMAND = sys.argv[sys.argv.index("--command") + 1]
    unittest.main(argv=sys.argv[:1])
