#!/usr/bin/env python3
"""--session keeps a run of the command, and `helix_arm session rerun` makes it again.

usage: session_test.py --command HELIX_ARM
"""
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

COMMAND = None


class Session(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="helix_arm session ")
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def call(self, *words, given=None):
        return subprocess.run([COMMAND, *map(str, words)], cwd=str(self.folder), input=given, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, timeout=120)

    def keep(self, *words, given=None):
        """@return the run's folder, its record, and the call; which is as without --session."""
        call = self.call(*words, "--session", "kept", given=given)
        run = max((self.folder / "kept").iterdir(), key=lambda each: each.stat().st_mtime_ns)
        self.assertEqual((run / "stdout.txt").read_bytes(), call.stdout)
        return run, json.loads((run / "session.json").read_text()), call

    def rerun(self, run, *options):
        again = self.call("session", "rerun", run, "--format", "json", *options)
        return again.returncode, json.loads(again.stdout) if again.stdout else again.stderr.decode()

    def test_a_calibration_is_made_again_from_its_copies_alone(self):
        data = self.folder / "monday"
        self.assertEqual(self.call("simulate", "demo", "--out", data, "--count", 4).returncode, 0)
        words = ("calibrate", "monday/scene.yaml", data / "tag_poses.csv", "--fit", "stiffness", "--out", self.folder / "S.yaml",
                 "--format", "json")
        plain = self.call(*words)
        run, record, call = self.keep(*words)
        self.assertEqual((call.returncode, call.stdout, call.stderr), (0, plain.stdout, plain.stderr))
        self.assertEqual(record["command"], [str(word) for word in words])
        self.assertEqual(record["scene_sha256"], hashlib.sha256((data / "scene.yaml").read_bytes()).hexdigest())
        self.assertEqual((run / "data/tag_poses.csv").read_bytes(), (data / "tag_poses.csv").read_bytes())
        self.assertEqual((run / "out/S.yaml").read_bytes(), (self.folder / "S.yaml").read_bytes())
        self.assertEqual(record["figures"], ["figure.png"])
        shutil.rmtree(str(data))
        (self.folder / "S.yaml").unlink()
        code, result = self.rerun(run, "--out", "again")
        self.assertEqual((code, result["differences"]), (0, []))
        self.assertFalse((self.folder / "S.yaml").exists())
        for name in ("figure.png", "stdout.txt"):
            self.assertTrue((self.folder / "again" / name).is_file(), name)

        text = (run / "stdout.txt").read_text()
        (run / "stdout.txt").write_text(text.replace('"K_kappa', '"K_kapa', 1))
        code, result = self.rerun(run)
        self.assertEqual((code, result["same"], result["differences"][0]["file"]), (1, False, "stdout.txt"))
        self.assertIn("K_kapa", result["differences"][0]["then"])
        (run / "data/tag_poses.csv").write_text("")
        self.assertEqual(self.rerun(run)[0], 2)
        self.assertIn("tag_poses.csv has changed since the run", self.rerun(run)[1])

    def test_a_run_that_fails_is_kept_with_its_code(self):
        run, record, call = self.keep("follow", "demo", "--tip", ";".join(["0.36,0.03,"] * 60))
        self.assertEqual((call.returncode, record["exit_code"]), (2, 2))
        self.assertIn(call.stderr, (run / "log.txt").read_bytes())
        self.assertNotEqual(call.stderr, b"")


if __name__ == "__main__":
    COMMAND = sys.argv[sys.argv.index("--command") + 1]
    unittest.main(argv=sys.argv[:1])
