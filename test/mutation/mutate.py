#!/usr/bin/env python3
"""Breaks the laws of laws.yaml one at a time, in a copy of the package, and asserts that the test named there then fails.

usage: mutate.py [--check [--build DIR] | --list] [--only REGEX]
  --check  only the table: each snippet occurs exactly once, names differ, tests exist; fast, and itself a test of ctest
  --build  with --check: a configured build folder, whose ctest has to know the tests
  --list   prints the laws
  --only   the laws whose layer or name the expression matches
Copies the package to helix_arm_mutation/tree in the temporary folder (inside the package, roslaunch would find its launch files
twice) and builds it there as scripts/build does; unchanged, all tests that are named have to pass. Then, for each law: edits,
builds what its test needs, runs the test, restores. All laws take some hours on two cores.
Exit code: 0 when every law was caught; 1 if one survived or did not build, or if the table has a fault; 2 on a wrong call.
"""
import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, namedtuple
from pathlib import Path

import yaml

GTEST, ROSTEST = "_ctest_helix_arm_gtest_", "_ctest_helix_arm_rostest_"
Law = namedtuple("Law", "name test before after")
TABLE = yaml.safe_load((Path(__file__).resolve().parent / "laws.yaml").read_text(encoding="utf-8"))
LAWS = {layer: [Law(**row) for row in rows] for layer, rows in TABLE.items()}
ROOT = Path(__file__).resolve().parents[2]
PRODUCT = ("include", "src", "firmware", "python")
SUFFIXES = (".hpp", ".cpp", ".h", ".c", ".py")
OPTIONAL = ("firmware", "rviz_panel")  # layers that CMake leaves out where what they need is not installed
VARIABLES = ("HOME", "ROS_HOME", "ROS_HOSTNAME", "ROS_IP", "TMPDIR", "TERM")  # as in scripts/common.sh
CAUGHT, SURVIVED, NOT_BUILT = "caught", "SURVIVED", "DOES NOT BUILD"


def rows_of(only):
    """[(layer, law)] that an expression matches."""
    wanted = re.compile(only)
    return [(layer, law) for layer, laws in LAWS.items() for law in laws if wanted.search(layer) or wanted.search(law.name)]


def sources_of(root):
    """{path: text} of the product."""
    files = [path for folder in PRODUCT for path in sorted((root / folder).rglob("*")) if path.suffix in SUFFIXES]
    return {path: path.read_text(encoding="utf-8") for path in files}


def places_of(snippet, sources):
    """[(path, match)], whatever blanks and line ends are between the words of the snippet."""
    pattern = re.compile(r"\s+".join(re.escape(word) for word in snippet.split()))
    return [(path, match) for path, text in sources.items() for match in pattern.finditer(text)]


def tests_of(build):
    """Names of the tests of a configured build folder."""
    listed = subprocess.run(["ctest", "-N"], cwd=str(build), stdout=subprocess.PIPE, universal_newlines=True, check=True)
    return set(re.findall(r"^ *Test +#\d+: (\S+)", listed.stdout, re.MULTILINE))


def is_left_out(layer, tests):
    return layer in OPTIONAL and not any(law.test in tests for law in LAWS[layer])


def faults_of_table(rows, tests):
    """@param tests  those of ctest; None: not known."""
    sources, faults = sources_of(ROOT), []
    for name, count in Counter(law.name for _, law in rows).items():
        if count > 1:
            faults.append("%s: %d laws have this name; expected one" % (name, count))
    for layer, law in rows:
        files = [path.relative_to(ROOT).as_posix() for path, _ in places_of(law.before, sources)]
        if len(files) != 1:
            found = "%d times, in %s" % (len(files), ", ".join(files)) if files else "nowhere"
            faults.append("%s: \"%s\" occurs %s; expected once" % (law.name, law.before, found))
        if law.before.split() == law.after.split():
            faults.append("%s: its edit changes nothing; expected another snippet" % law.name)
        if tests is not None and law.test not in tests and not is_left_out(layer, tests):
            faults.append("%s: ctest has no test %s; expected one that ctest -N lists" % (law.name, law.test))
    return faults


def targets_of(test):
    """What is built for a test, with the programs that it starts."""
    if test.startswith(GTEST):
        return [test[len(GTEST):]]
    if test.startswith(ROSTEST):
        return ["all", test[len(ROSTEST):] + "_rostest"]
    return ["helix_arm_python", "helix_arm_cli"]


class Copy:
    """A copy of the package, to be edited and built."""

    def __init__(self, root):
        self.root, self.build = root, root / "build"
        self.environment = {name: os.environ[name] for name in VARIABLES if os.environ.get(name)}
        self.environment["PATH"] = "/usr/bin:/bin:/usr/sbin:/sbin"
        if "ROS_IP" not in self.environment:
            self.environment.setdefault("ROS_HOSTNAME", "localhost")
        self.environment.update(CCACHE_BASEDIR=str(root), CCACHE_NOHASHDIR="1")  # checkouts share their cached objects

    def refresh(self):
        """Makes its files those of the package. What has not changed keeps its time, so that it is not compiled again."""
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=str(ROOT), stdout=subprocess.PIPE, check=True).stdout
        names = {name for name in listed.decode().split("\0") if name and (ROOT / name).is_file()}
        self.root.mkdir(parents=True, exist_ok=True)
        for top in [one for one in self.root.iterdir() if one.name not in ("build", "devel")]:
            for old in [top, *top.rglob("*")]:
                if old.is_file() and old.relative_to(self.root).as_posix() not in names:
                    old.unlink()
        for name in names:
            source, target = ROOT / name, self.root / name
            content = source.read_bytes()
            if not target.exists() or target.read_bytes() != content:
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(content)
            target.chmod(source.stat().st_mode)

    def call(self, command, folder):
        """Exit code and output."""
        done = subprocess.run(command, cwd=str(folder), env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              universal_newlines=True, errors="replace", check=False)
        return done.returncode, done.stdout

    def make(self, targets):
        code, output = self.call([str(self.root / "scripts" / "build")] + targets, self.root)
        if code != 0:
            sys.exit("the unchanged package does not build:\n" + output[-4000:])

    def test(self, names):
        expression = "^(%s)$" % "|".join(re.escape(name) for name in names)
        return self.call(["ctest", "-j2", "--output-on-failure", "-R", expression], self.build)

    def judge(self, law):
        """Breaks a law for as long as it takes to build and run its test. @return what became of it, and the last output."""
        (path, match), = places_of(law.before, sources_of(self.root))
        whole = match.string
        try:
            path.write_text(whole[:match.start()] + law.after + whole[match.end():], encoding="utf-8")
            code, output = self.call(["cmake", "--build", ".", "-j", str(os.cpu_count()), "--target"] + targets_of(law.test),
                                     self.build)
            if code != 0:
                return NOT_BUILT, output
            code, output = self.test([law.test])
            return CAUGHT if code != 0 else SURVIVED, output
        finally:
            path.write_text(whole, encoding="utf-8")


def run(rows):
    copy = Copy(Path(tempfile.gettempdir()) / "helix_arm_mutation" / "tree")
    copy.refresh()
    print("building the unchanged package in %s" % copy.root, flush=True)
    copy.make(["helix_arm_cli"])  # configures the tests as well
    tests = tests_of(copy.build)
    rows = [(layer, law) for layer, law in rows if not is_left_out(layer, tests)]
    faults = faults_of_table(rows, tests)
    if faults:
        sys.exit("\n".join(faults))
    names = sorted({law.test for _, law in rows})
    copy.make(sorted({target for name in names for target in targets_of(name)}))
    code, output = copy.test(names)
    if code != 0:
        sys.exit("a test fails although nothing was changed:\n" + output[-4000:])
    results = Counter()
    for layer, law in rows:
        begin = time.monotonic()
        result, output = copy.judge(law)
        results[result] += 1
        print("%s: %s: %s by %s in %.0f s" % (layer, law.name, result, law.test, time.monotonic() - begin), flush=True)
        if result == NOT_BUILT:
            print(output[-2000:], flush=True)
    print("%d laws: %s" % (len(rows), ", ".join("%d %s" % (count, result) for result, count in results.items())))
    return 0 if results[CAUGHT] == len(rows) else 1


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only the table")
    parser.add_argument("--build", type=Path, help="with --check: a configured build folder")
    parser.add_argument("--list", action="store_true", help="print the laws")
    parser.add_argument("--only", default="", help="expression for layers and names")
    arguments = parser.parse_args()
    if arguments.build and not arguments.check:
        parser.error("--build needs --check")
    rows = rows_of(arguments.only)
    if not rows:
        parser.error("--only %s matches no law; see --list" % arguments.only)
    if arguments.list:
        for layer, law in rows:
            print("%-12s%s (%s)" % (layer, law.name, law.test))
        return 0
    if arguments.check:
        faults = faults_of_table(rows, tests_of(arguments.build) if arguments.build else None)
        print("\n".join(faults) or "%d laws" % len(rows))
        return 1 if faults else 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that an edit is taken back
    return run(rows)


if __name__ == "__main__":
    sys.exit(main())
