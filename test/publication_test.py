#!/usr/bin/env python3
"""Containers, workflows, releases and the documentation site name what is there, and work as far as they can here."""
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path


ROOT = Path(__file__).resolve().parents[1]


def run(*command, folder, code=0):
    """What a command prints, which has to end with this code."""
    who = {name + each: "test@example.org" for name in ("GIT_AUTHOR_", "GIT_COMMITTER_") for each in ("NAME", "EMAIL")}
    done = subprocess.run(list(map(str, command)), cwd=str(folder), env={**os.environ, **who}, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, timeout=200)
    if done.returncode != code:
        raise AssertionError("%s ended with %d: %s" % (command, done.returncode, done.stdout.decode()))
    return done.stdout.decode()


class Publication(unittest.TestCase):
    @unittest.skipUnless((ROOT / ".git").exists(), "this is no checkout of git")
    def test_a_release_writes_its_version_everywhere_and_a_broken_link_stops_the_site(self):
        with tempfile.TemporaryDirectory(prefix="helix_arm release ") as scratch:
            clone = Path(scratch) / "package"
            run("git", "clone", "-q", "--shared", ROOT, clone, folder=scratch)
            self.assertIn("expected one above", run("scripts/release", "0.0.1", folder=clone, code=1))
            run("scripts/release", "98.7.6", "--source-only", folder=clone)
            self.assertEqual(run("git", "describe", folder=clone) + run("git", "status", "--porcelain", folder=clone), "v98.7.6\n")
            for name, text in (("CITATION.cff", r"\nversion: 98.7.6\ndate-released: 20"), ("package.xml", "<version>98.7.6</version>"),
                               ("CHANGELOG.rst", r"\n98.7.6 \(20\d\d-\d\d-\d\d\)\n-{19}\n\* ")):
                self.assertRegex((clone / name).read_text(), text)
            run("sha256sum", "-c", "SHA256SUMS", folder=clone / "build/release")
            self.assertIn("helix_arm-98.7.6/package.xml", run("tar", "tf", clone / "build/release/helix_arm-98.7.6.tar.gz", folder=clone))
            if subprocess.run([sys.executable, "-c", "import myst_parser, sphinx_rtd_theme"]).returncode:
                self.skipTest("Sphinx or MyST is not installed")
            run("scripts/docs", "--pages", folder=clone)
            with open(str(clone / "docs/theory.md"), "a") as page:
                page.write("\n[gone](scene.md#gone)\n")
            self.assertIn("gone", run("scripts/docs", "--pages", folder=clone, code=1))

    @unittest.skipUnless(shutil.which("doxygen"), "Doxygen is not installed")
    def test_every_public_class_and_function_is_documented(self):
        config = (ROOT / "docs/site/Doxyfile").read_text().replace("WARNINGS = NO", "").replace("WARN_IF_UNDOCUMENTED = NO", "")
        with tempfile.TemporaryDirectory() as folder:
            config += 'OUTPUT_DIRECTORY = "%s"\nWARN_LOGFILE = "%s/log"\n' % (folder, folder)
            subprocess.run(["doxygen", "-"], input=config.encode(), cwd=str(ROOT), check=True)
            found = (Path(folder) / "log").read_text()
        self.assertEqual(re.findall(r"(?:Compound (\S+)|Member (.*) of namespace \S+) is not documented", found), [])
        self.assertIn("of class", found)  # names that say all need nothing: so Doxygen has looked


if __name__ == "__main__":
    unittest.main()
