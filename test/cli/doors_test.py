#!/usr/bin/env python3
"""Subcommands that no other test runs do their main thing once; --session keeps a run, and `session rerun` makes it again.

usage: doors_test.py --command HELIX_ARM
"""
import csv
import json
import math
import os
import pty
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

COMMAND = None


class Doors(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="helix_arm doors ")
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def call(self, *words, code=0):
        run = subprocess.run([COMMAND, *map(str, words)], cwd=str(self.folder), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, timeout=120)
        self.assertEqual(run.returncode, code, (words, run.stderr[-2000:], run.stdout[-500:]))
        return run.stdout

    def json(self, *words, **options):
        return json.loads(self.call(*words, "--format", "json", **options))

    def table(self, text):
        return list(csv.DictReader(line for line in text.split("\n") if line and not line.startswith("#")))

    def rows(self, name):
        return self.table((self.folder / name).read_text())

    def write(self, name, lines):
        (self.folder / name).write_text("\n".join(lines) + "\n")

    def assert_near(self, found, expected, most):
        self.assertLess(max(abs(float(a) - float(b)) for a, b in zip(found, expected)), most, (found, expected))

    def tip(self, scene, kpa):
        return self.json("forward", scene, "--pressure-kpa", ",".join(map(str, kpa)))["tip"]["position_m"]

    def test_simulated_pictures_and_poses_are_measured(self):
        self.json("simulate", "demo", "--out", "rig", "--count", 2)
        truth = [[row["section_1_%s" % name] for name in ("vx_m", "wy_rad", "wz_rad")] for row in self.rows("rig/truth.csv")]
        seen = self.json("localize", "rig/scene.yaml", "rig")
        fitted = self.json("fit", "rig/scene.yaml", "rig/tag_poses.csv")
        for found, most in ((seen["frames"], 0.03), (fitted["captures"], 0.2)):
            for one, expected in zip(found, truth):
                self.assert_near([one["twist"][0][k] for k in (0, 4, 5)], expected, most)
        self.assertEqual([one["state"] for one in seen["frames"]], 2 * ["measured"])

    def test_a_circle_begins_on_its_first_axis(self):
        points = self.table(self.call("path", "circle", "--centre", "0.35,0.01,-0.02", "--radius", 0.02, "--period", 8,
                                      "--format", "csv").decode())
        self.assert_near(points[0].values(), (0, 0.35, 0.03, -0.02), 1e-12)
        self.assert_near(points[50].values(), (2, 0.35, 0.01, 0), 1e-12)

    def test_a_workspace_holds_the_tips_of_its_pressures(self):
        self.assertEqual(self.json("workspace", "loaded", "--count", 50, "--out", "tips.csv")["count"], 50)
        row = self.rows("tips.csv")[7]
        kpa, tip = list(row.values())[:3], list(row.values())[3:6]
        self.assert_near(tip, self.tip("loaded", kpa), 1e-9)
        self.json("workspace", "demo", "--count", 50, "--sensitivity", "--out", "tips.ply")
        header, _, points = (self.folder / "tips.ply").read_bytes().partition(b"end_header\n")
        self.assertTrue(header.startswith(b"ply\n") and len(points) == 50 * 6 * 4)

    def test_a_trade_has_every_tier(self):
        tiers = [row["tier"] for row in self.json("trade", "loaded", "--no-files", "--pictures", 0)["rows"] if row["part"] == "model"]
        self.assertEqual(sorted(tiers), ["exact", "linear"] + 7 * ["loaded"])

    def test_a_motion_ends_near_rest_and_keeps_its_energy(self):
        self.write("steps.csv", ("time_s,pressure_1_kpa,pressure_2_kpa,pressure_3_kpa", "0,0,0,0", "0.1,200,0,50", "1,200,0,50"))
        energy = self.json("motion", "loaded", "steps.csv", "--out", "motion.csv")["energy_j"]
        self.assert_near([energy.pop("work")], [sum(energy.values())], 1e-6)
        self.assert_near(list(self.rows("motion.csv")[-1].values())[1:4], self.tip("loaded", (200, 0, 50)), 0.02)

    def test_a_payload_map_has_a_row_for_each_place(self):
        self.assertEqual(len(self.table(self.call("payload", "loaded", "--map", "--count", 30, "--format", "csv").decode())), 30)

    def test_a_release_gives_the_mode_of_a_scene(self):
        swing = [0.03 * math.exp(-1.26 * t) * math.cos(12.566 * t)
                 for t in (max(0.02 * k - 1, 0) for k in range(400))]
        self.write("pull.csv", ["trial,time_s,x_m,y_m", *("pull,%.2f,0.3,%.6f" % (0.02 * k, y) for k, y in enumerate(swing))])
        self.assertAlmostEqual(self.json("calibrate", "demo", "pull.csv", "--fit", "mode", "--out", "mode.yaml")["mode"]
                               ["frequency_hz"]["value"], 2.01, delta=0.05)
        self.assertIn("mode_hz: 2.0", (self.folder / "mode.yaml").read_text())

    def test_a_testing_machine_gives_curve_and_stiffness(self):
        self.write("bellows.yaml", (
            "name: bellows", "contractions:", "  bellows: {table: {pressure_kpa: [0, 80], length_m: [0.06, 0.1]}}", "arm:",
            "  geometry: spatial", "  stiffness: {K_gamma: 10, K_tau_m2: 1.0e-4, K_kappa_m2: 1.0e-4}",
            "  sections: [{name: arm, ring: {count: 4, radius_m: 0.03, contraction: bellows}}]"))
        self.write("stand.csv", ("pressure_kpa,length_m,force_n", *(
            "%g,%g,%.6f" % (p, x, 2 * (10 + 0.2 * p) * (x - 0.06 - 1e-3 * p) / 0.06) for x in (0.05, 0.07, 0.09) for p in range(0, 81, 2))))
        found = self.json("calibrate", "bellows.yaml", "stand.csv", "--fit", "contraction,K_eps", "--muscles", 2, "--out", "out.yaml")
        for one in found["curve"]:
            p = one["pressure_pa"] / 1e3
            self.assert_near([one["length_m"], one["K_eps_n"] / 1e3], [0.06 + 1e-3 * p, 0.01 + 2e-4 * p], 1e-4)
        self.assertLess(self.json("evaluate", "out.yaml", "stand.csv", "--muscles", 2)["rms_n"], 0.05)

    def test_a_terminal_is_asked(self):
        """Enter keeps what --defaults gives."""
        self.call("new", "--out", "told.yaml", "--defaults")
        pid, terminal = pty.fork()
        if pid == 0:
            os.chdir(str(self.folder))
            os.execv(COMMAND, [COMMAND, "new", "--out", "asked.yaml"])
        os.write(terminal, 20 * b"\n")
        said = b""
        try:
            while True:
                more = os.read(terminal, 4096)
                said += more
                if not more:
                    break
        except OSError:  # the other end is closed
            pass
        self.assertEqual(os.waitpid(pid, 0)[1], 0, said)
        self.assertIn(b"in kPa (1 to 2000) [300]: ", said)
        self.assertEqual((self.folder / "asked.yaml").read_text().replace("asked", "told"), (self.folder / "told.yaml").read_text())

    def test_a_session_is_made_again_from_its_copies_alone(self):
        self.json("simulate", "demo", "--out", "monday", "--count", 4)
        self.json("calibrate", "monday/scene.yaml", "monday/tag_poses.csv", "--fit", "stiffness", "--out", "S.yaml",
                  "--session", "kept")
        (run,) = (self.folder / "kept").iterdir()
        self.assertEqual((run / "out/S.yaml").read_bytes(), (self.folder / "S.yaml").read_bytes())
        self.assertEqual(json.loads((run / "session.json").read_text())["figures"], ["figure.png"])
        shutil.rmtree(str(self.folder / "monday"))
        self.assertEqual(self.json("session", "rerun", run)["differences"], [])
        text = (run / "stdout.txt").read_text()
        (run / "stdout.txt").write_text(text.replace("K_kappa", "K_kapa", 1))
        self.assertEqual(self.json("session", "rerun", run, code=1)["differences"][0]["file"], "stdout.txt")

    def test_doctor_tells_a_fault_by_its_code(self):
        for uri, state in (("http://127.0.0.1:1", "not_checked"), ("robot", "fault")):
            run = subprocess.run([COMMAND, "doctor", "--format", "json"], stdout=subprocess.PIPE, timeout=60,
                                 env={**os.environ, "ROS_HOSTNAME": "localhost", "ROS_MASTER_URI": uri})
            checks = {check["name"]: check["state"] for check in json.loads(run.stdout)["checks"]}
            self.assertEqual((checks["ros_master"], run.returncode), (state, int("fault" in checks.values())))


if __name__ == "__main__":
    COMMAND = os.path.abspath(sys.argv[sys.argv.index("--command") + 1])
    unittest.main(argv=sys.argv[:1])
