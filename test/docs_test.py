#!/usr/bin/env python3
"""Checks README.md, CONTRIBUTING.md, SECURITY.md and docs/*.md against the package: links and anchors, paths, commands and
their options, tests and the length of the README.

usage: docs_test.py --root PACKAGE --command HELIX_ARM
  --command  the built helix_arm, which is asked for its subcommands and options
Exit code: 0 when nothing is wrong; 1 with every fault as file:line; 2 on a wrong call.
"""

import argparse
import itertools
import re
import subprocess
import sys
from pathlib import Path

README_LINES = 200
FOLDERS = ("action", "cmake", "config", "docs", "examples", "firmware", "include", "launch", "msg", "rviz", "scripts", "src",
           "srv", "test")
# Options of other programs, where a code span begins with one.
FOREIGN_OPTIONS = {"--ros-args", "--clock", "--sanitize", "--minutes", "--prefix"}
PATH = re.compile(r"(?<![\w/.$~<>*-])((?:%s)/[\w./*{},<>-]*)" % "|".join(FOLDERS))
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")


class Line:
    """One line of a document, with its code and its prose apart."""

    def __init__(self, number, text, is_code, section):
        self.number, self.text, self.is_code, self.section = number, text, is_code, section
        self.spans = [] if is_code else [m.replace("\\|", "|") for m in re.findall(r"`([^`]+)`", text)]
        self.prose = "" if is_code else re.sub(r"`[^`]*`", "", text)

    def code(self):
        """What is code here: the line itself, or its spans."""
        return [self.text] if self.is_code else self.spans


def slug(heading):
    """The anchor that GitHub gives a heading."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").strip().lower()
    return re.sub(r"[^\w\- ]", "", text).replace(" ", "-")


class Document:
    def __init__(self, root, path):
        self.path, self.name = path, path.relative_to(root).as_posix()
        self.lines, self.anchors = [], set()
        fenced = indented = False
        before, section = "", ""
        for number, text in enumerate(path.read_text(encoding="utf-8").split("\n"), 1):
            is_fence = text.startswith("```")
            indented = text.startswith("    ") and (indented or not before.strip()) and not fenced
            heading = re.match(r"#+ (.*)", text)
            if heading and not fenced:
                self.anchors.add(slug(heading.group(1)))
                if text.startswith("## "):
                    section = heading.group(1).strip("` ")
            self.lines.append(Line(number, text, (fenced and not is_fence) or indented, section))
            fenced ^= is_fence
            before = text


class Command:
    """Subcommands and options of the built command, as its --help has them."""

    def __init__(self, path):
        self.path = path
        self.shared = self.options_of(self.help())
        self.options = {}
        for name in self.subcommands(self.help()):
            text = self.help(name)
            self.options[name] = self.options_of(text)
            for nested in self.subcommands(text):
                scene = ["SCENE"] if re.search(r"^Positionals:\n  SCENE ", text, re.M) else []
                self.options[name] |= self.options_of(self.help(name, *scene, nested))
        if not self.options:
            raise OSError("%s --help names no subcommand" % path)

    def help(self, *words):
        run = subprocess.run([self.path, *words, "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=60,
                             universal_newlines=True, check=True)
        return run.stdout

    @staticmethod
    def subcommands(text):
        listed = re.search(r"^Subcommands:\n((?:  .*\n)+)", text, re.M)
        return re.findall(r"^  ([a-z]+) ", listed.group(1), re.M) if listed else []

    @staticmethod
    def options_of(text):
        listed = re.search(r"^Options:\n((?:  .*\n?)+)", text, re.M)
        return set(re.findall(r"^  (?:-\w,)?(--[a-z-]+)", listed.group(1), re.M)) if listed else set()


def test_names(root):
    """Names that ctest knows, from the CMake files below test: helix_arm_test and its like, foreach unrolled."""
    names, programs = set(), set()
    for path in (root / "test").rglob("CMakeLists.txt"):
        text = re.sub(r"#[^\n]*", "", path.read_text(encoding="utf-8"))
        loops = []
        for call in re.finditer(r"\b(\w+)\s*\(([^()]*)\)", text):
            function, words = call.group(1), call.group(2).split()
            if function == "foreach" and words:
                loops.append((words[0], words[1:]))
            elif function == "endforeach" and loops:
                loops.pop()
            elif function in ("helix_arm_test", "helix_arm_rostest", "helix_arm_python_test",
                              "helix_arm_python_rostest", "helix_arm_process_test", "helix_arm_fuzz", "helix_arm_benchmark",
                              "add_test", "add_executable") and words:
                name = words[1] if words[0] == "NAME" and len(words) > 1 else words[0]
                for values in itertools.product(*(items for _, items in loops)):
                    full = name
                    for (variable, _), value in zip(loops, values):
                        full = full.replace("${%s}" % variable, value)
                    (programs if function in ("add_executable", "helix_arm_benchmark") else names).add(full)
    return names, programs


class Package:
    """What the documents may name."""

    def __init__(self, root, command):
        self.root, self.command = root, command
        self.tests, self.programs = test_names(root)
        self.cases = set()
        for path in (root / "test").rglob("*.cpp"):
            self.cases |= set(re.findall(r"^(?:TYPED_)?TEST(?:_[FP])?\((\w+),\s*(\w+)\)", path.read_text(encoding="utf-8"), re.M))


class Checker:
    def __init__(self, root, command):
        self.root = root
        names = [root / "README.md", root / "CONTRIBUTING.md", root / "SECURITY.md", *sorted((root / "docs").glob("*.md"))]
        self.documents = {path.resolve(): Document(root, path) for path in names if path.is_file()}
        self.package = Package(root, command)
        self.faults = []
        for path in names[:3]:
            if not path.is_file():
                self.faults.append("%s:1: is missing" % path.name)

    def fault(self, document, line, text):
        self.faults.append("%s:%d: %s" % (document.name, line, text))

    def check(self):
        for document in self.documents.values():
            if document.name == "README.md" and len(document.lines) - 1 > README_LINES:
                self.fault(document, README_LINES + 1, "the README has %d lines; expected at most %d" %
                           (len(document.lines) - 1, README_LINES))
            for line in document.lines:
                self.check_links(document, line)
                self.check_paths(document, line)
                self.check_commands(document, line)
                self.check_tests(document, line)
        return sorted(self.faults, key=lambda fault: (fault.split(":")[0], int(fault.split(":")[1])))

    def check_links(self, document, line):
        for target in LINK.findall(line.prose):
            if re.match(r"[a-z]+:", target):
                continue
            path, _, anchor = target.partition("#")
            file = (document.path.parent / path).resolve() if path else document.path.resolve()
            if not file.exists():
                self.fault(document, line.number, "link to %s, which is not there" % target)
            elif anchor:
                other = self.documents.get(file) or (Document(self.root, file) if file.suffix == ".md" else None)
                if other is None or anchor not in other.anchors:
                    self.fault(document, line.number, "link to %s, but there is no such heading" % target)

    def check_paths(self, document, line):
        for code in line.code():
            for found in PATH.findall(code):
                path = found.rstrip(".,:;")
                if any(mark in path for mark in ("<", "NAME")):
                    continue
                if not any(self.root.glob(path.rstrip("/"))):
                    self.fault(document, line.number, "path %s, which is not there" % path)
            for header in re.findall(r'#include "(helix_arm/[\w/]+\.hpp)"', code):
                if not (self.root / "include" / header).is_file():
                    self.fault(document, line.number, "includes %s, which is not there" % header)
            bare = re.fullmatch(r"(\w+\.test)", code)
            if bare and not any((self.root / "test").rglob(bare.group(1))):
                self.fault(document, line.number, "names %s, which is not there" % code)

    def check_commands(self, document, line):
        command = self.package.command
        everything = command.shared.union(*command.options.values())
        in_section = document.name == "docs/cli.md" and line.section in command.options
        for code in line.code():
            code = re.sub(r"(^|\s)#.*", "", code)
            call = re.search(r"(?<![\w/.])\$?helix_arm\s+([a-z]\w*)\b(?!\.launch)(.*)", code)
            if call and not re.search(r"\b(roslaunch|rosrun|rosbag|rospack)\b.*helix_arm", code):
                name, rest = call.groups()
                if name not in command.options:
                    self.fault(document, line.number, "helix_arm has no subcommand %s; expected one of %s" %
                               (name, ", ".join(sorted(command.options))))
                    continue
                for option in OPTION.findall(rest):
                    if option not in command.options[name] | command.shared:
                        self.fault(document, line.number, "helix_arm %s has no option %s" % (name, option))
            elif not line.is_code and code.startswith("--"):
                known = command.options[line.section] | command.shared if in_section else everything | FOREIGN_OPTIONS
                for option in OPTION.findall(code):
                    if option not in known:
                        self.fault(document, line.number, "helix_arm%s has no option %s" %
                                   (" " + line.section if in_section else "", option))

    def check_tests(self, document, line):
        known = self.package.tests | self.package.programs
        for code in line.code():
            for name in re.findall(r"(?<![\w/.-])([a-z]\w*_(?:test|benchmark|rostest))\b(?![.\w])", code):
                if name not in known:
                    self.fault(document, line.number, "there is no test or program %s" % name)
            case = re.fullmatch(r"([A-Z]\w+)\.([A-Z]\w+)", code)
            if case and case.groups() not in self.package.cases:
                self.fault(document, line.number, "there is no test case %s" % code)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parent.parent)
    parser.add_argument("--command", required=True)
    arguments = parser.parse_args()
    root = arguments.root.resolve()
    try:
        command = Command(arguments.command)
    except (OSError, subprocess.SubprocessError) as error:
        print("docs_test: %s does not tell its options: %s" % (arguments.command, error), file=sys.stderr)
        return 2
    faults = Checker(root, command).check()
    for fault in faults:
        print(fault)
    print("%d faults" % len(faults))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
