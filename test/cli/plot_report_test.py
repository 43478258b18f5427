#!/usr/bin/python3
"""scripts/plot_report, which draws what `helix_arm calibrate --format json` and others print."""

import contextlib
import copy
import io
import json
import math
import random
import runpy
import struct
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from matplotlib import image

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/plot_report"
sys.path.insert(0, str(SCRIPT.parent))  # for the modules beside it
MAIN = runpy.run_path(str(SCRIPT))["main"]
WIDTH = 1280


def capture(number, kpa, kind):
    model = math.tanh(kpa / 250)
    measured = model + 0.03 * math.sin(5 * number)
    curvature = kind == "curvature"
    return {"capture": number, "pressure_pa": [1e3 * kpa, 0.0], "kind": kind, "measured_rad": measured if curvature else None,
            "model_rad": model if curvature else None, "held_out_rad": model if curvature and number % 2 == 0 else None,
            "rms": abs(measured - model), "outlier_tags": [5, 7] if number == 3 and not curvature else [], "outlier": number == 4,
            "gain": 0.2}


def arm(name, kind, captures):
    return {"name": name, "captures": [capture(i, 30.0 * i, kind) for i in range(1, captures + 1)]}


def held_out(groups):
    return {"error": 0.05, "in_sample": 0.04, "groups": [{"label": f"{30 * i}, 0 kPa", "error": 0.01 * i} for i in range(groups)]}


def report():
    """One of everything."""
    points = [{"pressure_pa": 4e4 * i, "length_m": 0.43 - 0.1 * math.tanh(0.2 * i)} for i in range(11)]
    return {"scene": "spatial_50 at $5", "arms": [arm("planar_76", "curvature", 11), arm("wide", "curvature", 9)],
            "held_out_error": 0.05, "error_unit": "rad", "held_out": {"by_pressure": held_out(11), "by_arm": held_out(2)},
            "contractions": [{"name": "muscle", "rms_m": 6.5e-4, "samples": points, "curve": points}],
            "parameters": {"K_kappa": {"value": 1.2718e-4, "standard_error": 3e-6, "initial": 1.38e-4, "identifiable": True,
                                       "unit": "m^2"},
                           "K_gamma": {"value": 10.0, "standard_error": None, "initial": 10.0, "identifiable": False, "unit": ""}}}


def circle_runs():
    """A run around a circle in the y-z plane, closed beside open."""
    def circle(radius):
        return [[0.36, 1e-3 * radius * math.cos(0.0314 * i), 1e-3 * radius * math.sin(0.0314 * i)] for i in range(200)]

    runs = [{"name": name, "time_s": [0.01 * i for i in range(200)], "tip_m": circle(radius + 0.4),
             "error_m": [1e-3 * (radius - 19.6)] * 200}
            for name, radius in (("open loop: RMS 10 mm", 30), ("closed loop: RMS 0.4 mm", 20))]
    return {"scene": "demo $5", "follow": {"wanted_m": circle(20), "along_path": True, "blind_s": [0.5, 1], "runs": runs}}


class PlotReport(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.source, self.target = self.folder / "report.json", self.folder / "report.png"

    def run_script(self, source, target):
        """(exit code, what it says on stderr)."""
        said = io.StringIO()
        with contextlib.redirect_stderr(said):
            exit_code = MAIN([str(source), str(target)])
        return exit_code, said.getvalue()

    def test_it_is_a_program(self):
        run = subprocess.run([str(SCRIPT), "/dev/zero", str(self.target)], stderr=subprocess.PIPE, universal_newlines=True, check=False)
        self.assertEqual((run.returncode, "/dev/zero is not a regular file" in run.stderr), (2, True))

    def picture(self, document):
        """Whether each pixel is not white, of the picture that it draws."""
        self.source.write_text(json.dumps(document))
        self.assertEqual(self.run_script(self.source, self.target), (0, ""))
        inked = image.imread(str(self.target))[:, :, :3].min(axis=2) < 250 / 255
        self.assertEqual(inked.shape[1], WIDTH)
        return inked

    def assert_refused(self, document, message):
        self.target.unlink(missing_ok=True)
        self.source.write_text(document if isinstance(document, str) else json.dumps(document))
        exit_code, said = self.run_script(self.source, self.target)
        self.assertEqual(exit_code, 2)
        self.assertIn(message, said)
        self.assertNotIn("Traceback", said)
        self.assertFalse(self.target.exists())

    def test_it_shows_all_that_the_report_has(self):
        inked = self.picture(report())
        # Contraction and two arms, residuals, two kinds of groups: three rows; and the table.
        self.assertTrue(3 * 400 < len(inked) < 4 * 400, inked.shape)
        for row in range(3):
            for column in range(2):
                panel = inked[50 + 400 * row:450 + 400 * row, column * WIDTH // 2:(column + 1) * WIDTH // 2]
                self.assertGreater(panel.mean(), 0.02, (row, column))
        self.assertGreater(inked[-60:].mean(), 0.01)
        inked = self.picture({"contractions": report()["contractions"]})
        self.assertLess(len(inked), 500)
        self.assertGreater(inked.mean(), 0.02)

    def write_cloud(self, width, missing=0):
        """Points in a box as helix_arm workspace writes them, of which some may be missing."""
        count, draw = 4000, random.Random(1).random
        header = (f"ply\nformat binary_little_endian 1.0\ncomment of $50\nelement vertex {count}\nproperty float x\n"
                  "property float y\nproperty float z\nproperty float per_kpa_m\nend_header\n")
        points = (struct.pack("<4f", 0.1 + 0.3 * draw(), width * draw(), 0.2 * draw(), 1e-4 * draw()) for _ in range(missing, count))
        (self.folder / "cloud.ply").write_bytes(header.encode() + b"".join(points))

    def test_maps_stand_in_a_row_per_quantity(self):
        maps = {"scene": "helical $50", "tier": "linear", "reach_m": 0.41, "cloud": "cloud.ply"}
        self.write_cloud(0.2)
        inked = self.picture(maps)
        height = (len(inked) - 50) // 2
        for row in range(2):
            for column in range(3):
                panel = inked[50 + row * height:50 + (row + 1) * height, column * WIDTH // 3:(column + 1) * WIDTH // 3]
                self.assertGreater(panel.mean(), 0.1, (row, column))
        self.write_cloud(0)
        self.assertLess(len(self.picture(maps)), len(inked), "of one plane, side by side")
        self.write_cloud(0.2, missing=1)
        self.assert_refused(maps, "expected a PLY file of points")
        (self.folder / "cloud.ply").write_text("ply\nproperty")
        self.assert_refused(maps, "expected a PLY file of points")
        (self.folder / "cloud.ply").unlink()
        self.assert_refused(maps, "cannot be read")

    def test_runs_show_the_tip_and_its_error_over_time(self):
        path = circle_runs()
        inked = self.picture(path)
        for half in (inked[:, :WIDTH // 2], inked[:, WIDTH // 2:]):
            self.assertGreater(half.mean(), 0.02)
        tips = copy.deepcopy(path)
        tips["follow"].update({"along_path": False, "blind_s": None, "runs": tips["follow"]["runs"][1:]})
        self.picture(tips)
        wrong = copy.deepcopy(path)
        wrong["follow"]["runs"][1]["error_m"].append(1)
        self.assert_refused(wrong, "follow.runs[1] has 200 times, 200 tips and 201 errors; expected the same")
        wrong = copy.deepcopy(path)
        wrong["follow"]["wanted_m"][3] = [1, 2]
        self.assert_refused(wrong, "follow.wanted_m[3] is [1, 2]; expected x, y, z")
        path["follow"]["runs"] = []
        self.assert_refused(path, "follow has 200 wanted tips and 0 runs; expected some")

if __name__ == "__main__":
    unittest.main()
