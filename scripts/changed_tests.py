#!/usr/bin/env python3
"""Prints, as an expression for ctest -R, the tests of what has changed since a revision: by the dependencies that ninja has recorded,
the programs and libraries that contain a changed file, and the tests that name one of these in their LINK.

usage: changed_tests.py BUILD REVISION, where BUILD is built; exits with 1 if the change touches none that it knows
"""
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def output_of(*command):
    return subprocess.run(command, cwd=str(ROOT), stdout=subprocess.PIPE, check=True, universal_newlines=True).stdout


def changed_since(revision):
    """Paths in the package, of files that git tracks or would track."""
    listed = output_of("git", "diff", "--name-only", revision) + output_of("git", "ls-files", "--others", "--exclude-standard")
    return set(listed.split("\n")) - {""}


def containing(files, build):
    """{file: targets of CMake that compile or include it}."""
    out, target = {one: set() for one in files}, None
    for line in output_of("ninja", "-C", build, "-t", "deps").splitlines():
        if line.endswith(("(VALID)", "(STALE)")):
            target = re.search(r"CMakeFiles/([^/]+)\.dir/", line)
        elif target and line.startswith("    "):
            path = Path(build, line.strip()).resolve()
            name = path.relative_to(ROOT).as_posix() if ROOT in path.parents else ""
            if name in out:
                out[name].add(target.group(1))
    return out


def parts_of(path):
    """A file of ros_bridge belongs to a part of a library, a Python file to what Python imports."""
    part = re.match(r"src/(ros_bridge/\w+)/", path)
    return {part.group(1)} if part else {"helix_arm_python"} if path.startswith("python/") else {path}


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    build, revision = sys.argv[1:]
    rows = [row.split() for row in Path(build, "test/touched.txt").read_text().splitlines()]
    wanted = set()
    for path, targets in sorted(containing(changed_since(revision), build).items()):
        found = {test for target, test in rows if target in targets | parts_of(path)}
        print("%s: %s" % (path, "%d tests" % len(found) if found else "no test is known; scripts/test runs all"), file=sys.stderr)
        wanted |= found
    if not wanted:
        return 1
    print("^(%s)$" % "|".join(sorted(map(re.escape, wanted))))
    return 0


if __name__ == "__main__":
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(__doc__)
        sys.exit()
    sys.exit(main())
