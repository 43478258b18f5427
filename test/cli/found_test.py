#!/usr/bin/env python3
"""Files that people have fed to helix_arm (shared/data/found): each ends as told, and says what is wrong.

usage: found_test.py --command HELIX_ARM
"""
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

FOUND = Path(__file__).resolve().parents[3] / "shared/data/found"
COMMAND = sys.argv[sys.argv.index("--command") + 1]
SERIES = "stiffness,length_scale"
# File, what is fitted, exit code, words of the result.
TABLES = (
    ("good.csv", SERIES, 0, ["success"]),
    ("text_column.csv", SERIES, 0, ["success"]),
    ("index_column.csv", SERIES, 0, ["success"]),
    ("seen_nan.csv", SERIES, 0, ["success"]),
    ("swapped.csv", SERIES, 1, ["channels_exchanged", "muscle_", "force"]),
    ("yup_world.csv", SERIES, 1, ["frame_of_positions", "fit base"]),
    ("series_psi_as_kpa.csv", SERIES, 1, ["pressure_unit", "psi"]),
    ("series_w_first_values.csv", SERIES, 0, ["are left out", "w first"]),
    ("low.csv", "stiffness,contraction", 1, ["reaches 100 kPa", "lower max_pressure_kpa"]),
    ("len_mm.csv", "contraction", 1, ["if it is in millimetres"]),
    ("header_case_typo.csv", SERIES, 2, ["Pressure_2_kpa", "expected pressure_2_kpa"]),
    ("semicolon.csv", SERIES, 2, ["divided by semicolons"]),
)


@unittest.skipUnless(FOUND.is_dir(), "%s is not here" % FOUND)
class Found(unittest.TestCase):
    def calibrate(self, scene, data, *more):
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder, "out.yaml")
            run = subprocess.run([COMMAND, "calibrate", str(scene), str(data), "--out", str(out), *more], stdout=subprocess.PIPE,
                                 stderr=subprocess.STDOUT, timeout=300, check=False)
            self.assertEqual(out.exists(), run.returncode == 0)
            return run.returncode, run.stdout.decode()

    def test_tables_and_series(self):
        for name, fit, code, words in TABLES:
            with self.subTest(name):
                found, text = self.calibrate(FOUND / "chambers.yaml", FOUND / name, "--fit", fit)
                self.assertEqual(found, code, text)
                for word in words:
                    self.assertIn(word, text)

    def test_what_a_suspect_of_a_series_corrects(self):
        code, text = self.calibrate(FOUND / "chambers.yaml", FOUND / "swapped.csv", "--fit", SERIES, "--apply-suspect", "1")
        self.assertEqual(code, 0, text)
        self.assertIn("calibrated as if without channels_exchanged", text)

    def test_a_bag_of_another_package(self):
        code, text = self.calibrate("demo", FOUND / "bag_of_apriltag_ros.bag", "--fit", "stiffness")
        self.assertEqual(code, 2, text)
        self.assertIn("/pressure_measured has the type std_msgs/Float32MultiArray; expected helix_arm/PressureArray", text)

    def test_a_scene_in_millimetres(self):
        run = subprocess.run([COMMAND, "check", str(FOUND / "scene_quintic_of_180_m.yaml")], stdout=subprocess.PIPE,
                             stderr=subprocess.STDOUT, check=False)
        self.assertEqual(run.returncode, 2)
        self.assertIn("if it is in millimetres", run.stdout.decode())

    def test_a_vacuum(self):
        run = subprocess.run([COMMAND, "regulator", str(FOUND / "vacuum_simulated.yaml"), "set", "--pressure-kpa=-20,0,10",
                              "--seconds", "2", "--format", "csv"], stdout=subprocess.PIPE, check=False)
        self.assertEqual(run.returncode, 0)
        self.assertLess(min(float(row.split(",")[1]) for row in run.stdout.decode().splitlines()[1:] if "," in row), -15e3, run.stdout)

    # The device, what its log must not hold, and words of the result; of a copy of the profile that does not ask for the unit.
    def test_alicats(self):
        for mode, asks, words in (("bar", True, ['answers "ALS": "?"', "expected", "Set the unit PSIG on the device", "nothing then checks"]),
                                  ("ramp", False, ["ramp"])):  # "it ramps", or "check that it does not ramp" where the first answer faults
            with self.subTest(mode), tempfile.TemporaryDirectory() as folder:
                line, scene, own = (Path(folder, name) for name in ("line", "scene.yaml", "own.yaml"))
                shipped = (Path(__file__).resolve().parents[2] / "config/regulators/alicat.yaml").read_text()
                own.write_text("\n".join(row for row in shipped.splitlines() if asks or not row.startswith("  unit_")))
                scene.write_text((FOUND / "alicat.yaml").read_text().replace("profile: alicat", "profile: " + str(own))
                                 .replace("alicat_port", str(line)))
                device = subprocess.Popen([sys.executable, str(FOUND / "alicat_in_bar_or_ramping.py"), str(line), mode])
                try:
                    while not line.is_symlink():
                        self.assertIsNone(device.poll())
                    run = subprocess.run([COMMAND, "regulator", str(scene), "set", "--pressure-kpa", "50,0,0", "--seconds", "2", "--yes"],
                                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=60, check=False)
                finally:
                    device.terminate()
                    device.wait()
                self.assertEqual(run.returncode, 1, run.stdout)
                for word in words:
                    self.assertIn(word, run.stdout.decode())
                sent = re.findall(r"'AS(.*)'", Path(str(line) + ".log").read_text())
                self.assertEqual(any(float(one) > 0 for one in sent), not asks, sent)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
