#!/usr/bin/env python3
"""Checks the locks with Clang's thread-safety analysis, which GCC does not have: a member that is declared with
HELIX_ARM_GUARDED_BY is used only with its mutex locked.

usage: thread_safety_test.py --root PACKAGE --commands COMPILE_COMMANDS.JSON --clang CLANG++ [--self-test]
  --commands   of the build, whose generated headers must be there
  --self-test  plants one fault of each kind in a copy of the sources and asserts that it is found
Exit code: 0 when nothing is wrong; 1 with every fault; 2 on a wrong call.

Four rules hold below include/ and src/:
- Clang finds no access without the lock, in no source that names a mutex or defines a class whose header names one. Guarded
  members are private, so the other sources cannot reach them.
- Every header that names a mutex is included by one of these sources.
- Every mutex guards at least one member.
- Mutexes, locks and conditions of the standard library and of pthread are used by the wrappers only.
"""

import argparse
import json
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "scripts"))
from source_commands import source_commands  # noqa: E402

# Where the standard library's and pthread's mutexes are wrapped.
WRAPPERS = ("include/helix_arm/basics/mutex.hpp", "include/helix_arm/regulator/realtime.hpp")
WARNINGS = ["-Wno-everything", "-Werror", "-Wthread-safety"]

DIRECT = re.compile(r"\b(?:(?:std|boost)::(?:\w*mutex|lock_guard|\w+_lock|condition_variable\w*)"
                    r"|pthread_(?:mutex|cond|rwlock)_\w+)\b")
NAMES_ONE = re.compile(r"\b(?:Mutex|MutexLock|PriorityMutex|PriorityLock|HELIX_ARM_(?:GUARDED_BY|REQUIRES|EXCLUDES))\b")
MUTEX = re.compile(r"\b(?:Mutex|PriorityMutex)\s+(\w+)\s*;")
CLASS = re.compile(r"\b(?:class|struct)\s+(?:HELIX_ARM_\w+(?:\([^)]*\))?\s+)?(\w+)[^;{()]*\{")
INCLUDE = re.compile(r'#\s*include\s+"([^"]+)"')


class Sources:
    """Headers and sources of the package, without comments."""

    def __init__(self, root):
        self.root = root
        self.text = {path.relative_to(root).as_posix(): re.sub(r"//[^\n]*", "", path.read_text(encoding="utf-8"))
                     for folder in ("include", "src") for path in sorted((root / folder).rglob("*.[ch]pp"))}
        self.naming = {name for name, text in self.text.items() if NAMES_ONE.search(text) and name not in WRAPPERS}

    def to_analyse(self):
        """The sources that name a mutex or define members of a class whose header does."""
        classes = {found for name in self.naming if name.endswith(".hpp") for found in CLASS.findall(self.text[name])}
        defines = re.compile(r"^\S[^\n]*\b(?:%s)::~?\w+\(" % "|".join(sorted(classes) or ["(?!)"]), re.M)
        return sorted(name for name, text in self.text.items()
                      if name.endswith(".cpp") and (name in self.naming or defines.search(text)))

    def included(self, name, seen):
        """Adds to `seen` what a file includes of the package, directly or not."""
        for path in INCLUDE.findall(self.text[name]):
            for candidate in ("include/" + path, "src/" + path, name.rpartition("/")[0] + "/" + path):
                if candidate in self.text and candidate not in seen:
                    seen.add(candidate)
                    self.included(candidate, seen)
        return seen


def line_of(text, position):
    return text.count("\n", 0, position) + 1


def declaration_faults(sources):
    """Mutexes that guard nothing, and those that are not wrapped."""
    faults = []
    for name, text in sources.text.items():
        for found in MUTEX.finditer(text) if name not in WRAPPERS else ():
            if not re.search(r"HELIX_ARM_GUARDED_BY\(%s\)" % found.group(1), text):
                faults.append("%s:%d: %s guards nothing; declare its members with HELIX_ARM_GUARDED_BY(%s)"
                              % (name, line_of(text, found.start()), found.group(1), found.group(1)))
        for found in DIRECT.finditer(text) if name not in WRAPPERS else ():
            faults.append("%s:%d: %s is unknown to the analysis; use basics::Mutex, MutexLock and Condition"
                          % (name, line_of(text, found.start()), found.group()))
    return faults


def reach_faults(sources):
    """Headers with a mutex whose inline functions are not analysed."""
    reached = set().union(*(sources.included(name, set()) for name in sources.to_analyse()))
    return ["%s:1: names a mutex, but no source that is analysed includes it" % name
            for name in sorted(sources.naming - reached) if name.endswith(".hpp")]


class Analysis:
    """Runs Clang on sources of `root` as they are compiled, which is known for those of `built`."""

    def __init__(self, clang, built, root, commands):
        self.clang, self.root = clang, root
        self.moves = {str(built / folder): str(root / folder) for folder in ("include", "src")}
        self.commands = {}
        for entry in commands:
            path = Path(entry["directory"], entry["file"]).resolve()
            if (built / "src") in path.parents:
                self.commands[path.relative_to(built).as_posix()] = entry

    def moved(self, word):
        for old, new in self.moves.items():
            if word == old or word.startswith(old + "/"):
                return new + word[len(old):]
        return word

    def options(self, entry):
        """What the preprocessor and the language need; the rest is GCC's own."""
        words = entry.get("arguments") or shlex.split(entry["command"])
        out, take = [], False
        for word in words:
            if take or word in ("-I", "-isystem", "-D", "-U", "-include"):
                out.append(self.moved(word))
                take = not take
            elif re.match(r"-(?:[DU]|std=)", word):
                out.append(word)
            elif word.startswith("-I"):
                out.append("-I" + self.moved(word[2:]))
        return out

    def faults(self, name):
        if name not in self.commands:
            return ["%s: is not compiled; build first, or list it in CMakeLists.txt" % name]
        entry = self.commands[name]
        run = subprocess.run([self.clang, "-fsyntax-only", "-fno-caret-diagnostics", *self.options(entry), *WARNINGS,
                              str(self.root / name)], cwd=entry["directory"], stdout=subprocess.PIPE,
                             stderr=subprocess.STDOUT, universal_newlines=True)
        found = [line.replace(str(self.root) + "/", "") for line in run.stdout.splitlines() if "error: " in line]
        if run.returncode != 0 and not found:
            found = ["%s: %s ends with %d: %s" % (name, self.clang, run.returncode, run.stdout)]
        return found

    def faults_of(self, names):
        with ThreadPoolExecutor(2) as pool:
            return sorted({fault for found in pool.map(self.faults, names) for fault in found})


def check(sources, analysis):
    names = sources.to_analyse()
    return names, declaration_faults(sources) + reach_faults(sources) + analysis.faults_of(names)


# File, what is replaced there (None: the end), by what, and what is to be said.
SYNTAX = (
    ("src/regulator/regulator_io.cpp", "  const basics::MutexLock lock(error_mutex_);\n", "",
     "requires holding mutex 'error_mutex_'"),
    ("src/regulator/guard_process.cpp", "[this]() HELIX_ARM_REQUIRES(mutex_)", "[this]()", "requires holding mutex 'mutex_'"),
    ("src/ros_bridge/pressure/pressure_command_node.cpp", "    const regulator::PriorityLock lock(mutex_);\n", "",
     "requires holding mutex 'mutex_'"),
)
DECLARATIONS = (
    ("src/regulator/realtime.cpp", None, "std::mutex planted;\n", "std::mutex is unknown"),
    ("src/regulator/realtime.cpp", None, "std::unique_lock<M> planted(m);\n", "std::unique_lock is unknown"),
    ("include/helix_arm/regulator/regulator_io.hpp", None, "pthread_mutex_t planted;\n", "pthread_mutex_t is unknown"),
    ("src/regulator/realtime.cpp", None, "basics::Mutex planted_;\n", "planted_ guards nothing"),
    ("src/cli/command.hpp", None, "void planted() HELIX_ARM_EXCLUDES(planted_);\n", "no source that is analysed"),
)


def self_test(root, clang, commands):
    """What was planted and not found."""
    missed = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder).resolve()
        for name in ("include", "src"):
            shutil.copytree(str(root / name), str(copy / name))
        analysis = Analysis(clang, root, copy, commands)

        def expect(plant, find):
            name, old, new, expected = plant
            path = copy / name
            text = path.read_text(encoding="utf-8")
            planted = text + new if old is None else text.replace(old, new)
            path.write_text(planted, encoding="utf-8")
            faults = find(Sources(copy), name)
            path.write_text(text, encoding="utf-8")
            if planted == text or not any(fault.startswith(name + ":") and expected in fault for fault in faults):
                missed.append("%s: %r was planted, but %r was not said; only %s" % (name, new or old, expected, faults))

        for plant in DECLARATIONS:
            expect(plant, lambda sources, _: declaration_faults(sources) + reach_faults(sources))
        for plant in SYNTAX:
            expect(plant, lambda sources, name: analysis.faults(name) if name in sources.to_analyse() else [])
    return missed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--commands", type=Path, required=True)
    parser.add_argument("--clang", required=True)
    parser.add_argument("--self-test", action="store_true")
    arguments = parser.parse_args()
    root = arguments.root.resolve()
    try:
        commands = source_commands(json.loads(arguments.commands.read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        print("thread_safety_test: %s is not the list of compiler calls: %s" % (arguments.commands, error), file=sys.stderr)
        return 2
    if arguments.self_test:
        faults = self_test(root, arguments.clang, commands)
        summary = "%d planted faults, %d missed" % (len(SYNTAX) + len(DECLARATIONS), len(faults))
    else:
        names, faults = check(Sources(root), Analysis(arguments.clang, root, root, commands))
        summary = "%d sources analysed, %d faults: %s" % (len(names), len(faults), " ".join(names))
    for fault in faults:
        print(fault)
    print(summary)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
