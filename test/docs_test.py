#!/usr/bin/env python3
"""Checks README.md, CONTRIBUTING.md, SECURITY.md and docs/*.md against the package: links and anchors, paths, launch arguments, commands
and their options, tests, ROS names, the example of a scene, the length of the README and a few phrases.

usage: docs_test.py --root PACKAGE --command HELIX_ARM
  --command  the built helix_arm, which is asked for its subcommands and options
Exit code: 0 when nothing is wrong; 1 with every fault as file:line; 2 on a wrong call.
"""

import argparse
import itertools
import re
import subprocess
import sys
import tempfile
from pathlib import Path

README_LINES = 200
EXAMPLE_LINES = 25
PHRASES = ("way of the tip", "one a channel", "what became of", "as one has it", "nobody ramps")
FOLDERS = ("action", "cmake", "config", "docs", "examples", "firmware", "include", "launch", "msg", "rviz", "scripts", "src",
           "srv", "test")
# Options of other programs, where a code span begins with one.
FOREIGN_OPTIONS = {"--ros-args", "--clock", "--sanitize", "--minutes", "--prefix"}
PATH = re.compile(r"(?<![\w/.$~<>*-])((?:%s)/[\w./*{},<>-]*)" % "|".join(FOLDERS))
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
CAMEL = re.compile(r"[A-Z][a-z]+(?:[A-Z][a-z]+)+|Save|Reload|Calibrate")


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
        self.launch = {path.name: set(re.findall(r'<arg name="(\w+)"', path.read_text(encoding="utf-8")))
                       for path in (root / "launch").glob("*.launch")}
        self.types = {path.stem for kind in ("msg", "srv", "action") for path in (root / kind).iterdir()}
        self.types |= {name for path in root.glob("*_plugins.xml")
                       for name in re.findall(r'class name="helix_arm/(\w+)"', path.read_text(encoding="utf-8"))}
        build = (root / "CMakeLists.txt").read_text(encoding="utf-8")
        self.nodes = set(" ".join(re.findall(r"set\(helix_arm_(?:nodes|scripts)\s+([^)]+)\)", build)).split())
        self.topics, self.services = self.ros_names()
        self.cases = set()
        for path in (root / "test").rglob("*.cpp"):
            self.cases |= set(re.findall(r"^(?:TYPED_)?TEST(?:_[FP])?\((\w+),\s*(\w+)\)", path.read_text(encoding="utf-8"), re.M))
        self.parameters = set()
        for path in (*(root / "src/ros_bridge").rglob("*.[ch]pp"), *(root / "python").rglob("*.py")):
            self.parameters |= set(re.findall(r'reader\.\w+\(\s*"(\w+)"', path.read_text(encoding="utf-8")))

    def ros_names(self):
        topics, services, into = set(), set(), None
        for path in (self.root / "src/ros_bridge").rglob("names.hpp"):
            for line in path.read_text(encoding="utf-8").split("\n"):
                if line.startswith("// "):
                    into = topics if line.startswith("// Topics") else services if line.startswith("// Services") else None
                value = re.match(r'.*\bk\w+\[\] =\s*(?:"([^"]+)")?', line) or re.match(r'\s+"([^"]+)";', line)
                if into is not None and value and value.group(1):
                    into.add(value.group(1).lstrip("/"))
        for path in (self.root / "python").rglob("*.py"):
            services |= set(re.findall(r'\b(?:serve|ActionServer)\("~?(\w+)"', path.read_text(encoding="utf-8")))
        return topics, services

    def has_type(self, name):
        plain = re.sub(r"Action(Goal|Feedback|Result)?$", "", name)
        return name in self.types or plain in self.types

    def has_topic(self, name):
        parts = name.lstrip("/").split("/")
        of_action = ("goal", "feedback", "result", "status", "cancel")
        is_action = len(parts) > 1 and parts[-2] in self.services and parts[-1] in of_action
        return is_action or "/".join(parts) in self.topics or parts[-1] in self.topics or parts[0] in self.topics


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
            titles = None
            for line in document.lines:
                self.check_links(document, line)
                self.check_paths(document, line)
                self.check_launch(document, line)
                self.check_commands(document, line)
                self.check_tests(document, line)
                self.check_types(document, line)
                titles = self.check_columns(document, line, titles)
                for phrase in PHRASES:
                    if phrase in line.text.lower():
                        self.fault(document, line.number, 'says "%s"; see Words in CONTRIBUTING.md' % phrase)
            if document.name == "docs/cli.md":
                self.check_sections(document)
            if document.name == "docs/scene.md":
                self.check_scene_example(document)
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

    def check_launch(self, document, line):
        declared = set().union(*self.package.launch.values())
        for code in line.code():
            code = re.sub(r"(^|\s)#.*", "", code)
            file = re.search(r"(?<![\w/])(\w+\.launch)\b(.*)", code)
            if file and file.group(1) not in self.package.launch:
                self.fault(document, line.number, "names %s; expected one of %s" %
                           (file.group(1), ", ".join(sorted(self.package.launch))))
                continue
            known = self.package.launch[file.group(1)] if file else declared
            given = re.findall(r"(?<!\S)\(?(\w+):=", file.group(2) if file else code)
            if re.search(r"\b_\w+:=|\brosrun\b", code):
                continue
            for name in given:
                if name not in known:
                    self.fault(document, line.number, "argument %s:= is not declared by %s" %
                               (name, file.group(1) if file else "any launch file"))

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

    def check_sections(self, document):
        """Every subcommand is named; its options are told by its --help."""
        named = {line.section for line in document.lines} | {code for line in document.lines for code in line.code()}
        for name in sorted(set(self.package.command.options) - named):
            self.fault(document, 1, "subcommand %s is not named" % name)

    def check_scene_example(self, document):
        """The scene that docs/scene.md begins with is short, and gives what the page says."""
        text = document.path.read_text(encoding="utf-8")
        scene = re.search(r"^```yaml\n(.*?)^```", text, re.M | re.S)
        call = re.search(r"^\$ helix_arm (.*?) arm\.yaml (.*?) \| grep '(.*?)'\n(.*)$", text, re.M)
        if not scene or not call or scene.group(1).count("\n") > EXAMPLE_LINES:
            self.fault(document, 1, "no example of a scene of at most %d lines with a call of helix_arm" % EXAMPLE_LINES)
            return
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "arm.yaml").write_text(scene.group(1), encoding="utf-8")
            run = subprocess.run([str(Path(self.package.command.path).resolve()), call.group(1), "arm.yaml", *call.group(2).split()],
                                 cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=60, universal_newlines=True)
        printed = "\n".join(line for line in run.stdout.split("\n") if call.group(3) in line)
        if printed != call.group(4):
            self.fault(document, text[:call.start()].count("\n") + 2, "the example prints %s" % printed)

    def check_tests(self, document, line):
        known = self.package.tests | self.package.programs
        for code in line.code():
            for name in re.findall(r"(?<![\w/.-])([a-z]\w*_(?:test|benchmark|rostest))\b(?![.\w])", code):
                if name not in known:
                    self.fault(document, line.number, "there is no test or program %s" % name)
            case = re.fullmatch(r"([A-Z]\w+)\.([A-Z]\w+)", code)
            if case and case.groups() not in self.package.cases:
                self.fault(document, line.number, "there is no test case %s" % code)

    def check_types(self, document, line):
        for code in line.code():
            for name in re.findall(r"(?<![\w/])helix_arm/([A-Z]\w+)", code):
                if not self.package.has_type(name):
                    self.fault(document, line.number, "there is no message, service or action %s" % name)
            in_table = document.name == "docs/nodes.md" and line.text.startswith("|")
            if in_table and CAMEL.fullmatch(code) and not self.package.has_type(code):
                self.fault(document, line.number, "there is no message, service or action %s" % code)
            for name in re.findall(r"(?<![\w$/])~([a-z]\w+)\b(?!/)", code):
                if name not in self.package.parameters | self.package.services:
                    self.fault(document, line.number, "no node has a parameter, service or action ~%s" % name)
            for node, name in re.findall(r"rosservice call /(\w+)/(\w+)", code):
                if node not in self.package.nodes or name not in self.package.services:
                    self.fault(document, line.number, "there is no service /%s/%s" % (node, name))
            for name in re.findall(r"rostopic (?:pub|echo|hz|info)(?: -\w+(?: [\d.]+)?)* (/[\w/]+)", code):
                if not self.package.has_topic(name):
                    self.fault(document, line.number, "there is no topic %s" % name)

    def check_columns(self, document, line, titles):
        """Columns of topics and of tests; returns the titles of the table that this line is of."""
        if line.is_code or not line.text.startswith("|"):
            return None
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line.text)[1:-1]]
        if titles is None:
            return cells
        for title, cell in zip(titles, cells):
            for name in re.findall(r"`([^`]+)`", cell):
                if title == "topic" and not self.package.has_topic(name):
                    self.fault(document, line.number, "there is no topic %s" % name)
                known = self.package.tests | self.package.programs
                if title.startswith("test") and re.fullmatch(r"[a-z]\w+", name) and not name.endswith("_test") \
                        and name not in known:
                    self.fault(document, line.number, "there is no test or program %s" % name)
        return titles


def check_scripts(root):
    """Every script tells its usage where it is asked for help, and does nothing."""
    for path in sorted(path for path in (root / "scripts").iterdir() if path.is_file()):
        text = path.read_text(encoding="utf-8")
        if not text.startswith("#!") and "__main__" not in text:
            continue
        program = ["/bin/bash"] if text.startswith("#!/bin/bash") else [sys.executable]
        run = subprocess.run([*program, str(path), "--help"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
        if run.returncode != 0 or b"usage: " not in run.stdout or b"Traceback" in run.stdout:
            yield "scripts/%s --help: exit code %d, %r; expected its usage" % (path.name, run.returncode, run.stdout[-200:])


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
    faults = [*Checker(root, command).check(), *check_scripts(root)]
    for fault in faults:
        print(fault)
    print("%d faults" % len(faults))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
