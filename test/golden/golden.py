#!/usr/bin/env python3
"""Records what the command helix_arm prints and writes, and compares two records: for changes that must not change that.

usage: golden.py make HELIX_ARM OUT_DIR [--only TEXT]
       golden.py compare OUT_DIR_A OUT_DIR_B [--renames FILE] [--digits N]

make     runs the calls of calls.txt, and checks each scene and profile that it names with each of their values broken. Writes a
         file for each call into OUT_DIR, which must be empty or absent: arguments, exit code, stdout, stderr, and the files
         that the call wrote (large and binary ones as their SHA-256; a PDF by its unpacked streams).
         Times, rates, dates, the version, checksums and the folders of the call and of the package are replaced by <..>; all
         numbers of calls that read a simulated regulator by <n>; the picture of `trade`, which draws times, has only its name.
         Calls that read ../shared/data are left out where it is missing.
         --only TEXT     calls whose name contains TEXT, and those whose output others read
compare  prints every difference, and exits with 1 if there is one.
         --renames FILE  a pair of words per line, old and new (apart by a tab if they have blanks), for A before comparing. The
                         order of keys in JSON is then free: they are sorted by name.
         --digits N      compares numbers by their first N digits, and those below 1e-9 as 0: for another compiler
Exit code: 0 done, or nothing differs; 1 something differs, or a call did not end within 300 s; 2 golden.py was called wrongly.
"""

import argparse
import concurrent.futures
import difflib
import hashlib
import json
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

from calls import broken_calls, read_calls, unique_names

HERE = Path(__file__).resolve().parent
SHARED = HERE.parents[2] / "shared/data"
LARGEST = 100_000  # [bytes] of a file that is recorded as text
DEADLINE = 300  # [s] of one call
MOST_LINES, MOST_FILES = 40, 60  # of differences that are shown
SECTION = "=== "
UNRECORDED = re.compile(r"trade\.png$")  # draws times
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.])")
# Pattern and replacement, of all calls and of those whose arguments match a pattern.
ALWAYS = (
    (r"\b[0-9a-f]{64}\b", "<sha256>"),
    (r"\b\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", "<date>"),
    (r'(helix_arm |package_version: "?|calibrated_by: )\d+\.\d+\.\d+', r"\1<version>"),
)
OF_CALLS = {
    "^workspace": ((r'("(?:seconds|points_per_second)": )[^,\n]+', r"\1<time>"), (r"(?m)^(seconds|points per second) .*", r"\1 <time>"),
                  (r"(?m)(^ *\d+ %, .* left\n)+", "<progress>\n")),
    "^trade": ((r'("(?:time_ns|on_frontier)": )[^,\n]+', r"\1<time>"), (r" +[\d.e+-]+ (?:ns|us|ms) ", " <time> "),
              (r"(?m)^ \* ", "   ")),
    r"^regulator \S+ (probe --sec|set .*--sec|vent --form)|^check demo --probe": ((NUMBER.pattern, "<n>"),),
}
TIMED_COLUMNS = {"seconds", "time_ns", "on_frontier", "points_per_second"}


def refuse(reason):
    print("golden.py: " + reason, file=sys.stderr)
    sys.exit(2)


class Recorder:
    """Runs calls, each in a folder of its own below `work`, and writes their records."""

    def __init__(self, command, work, out):
        self.command, self.work, self.out = command, work, out
        self.late = []
        (work / "data").mkdir()
        (work / "home").mkdir()
        self.environment = {"PATH": "/usr/bin:/bin:/usr/sbin:/sbin", "HOME": str(work / "home"), "LC_ALL": "C.UTF-8",
                            "SOURCE_DATE_EPOCH": "0", "TMPDIR": str(work)}
        fault = self.execute(["forward", "demo", "--set", "no_such_key=1", "--input", "0,0,0"], work, None).stderr.decode()
        found = re.search(r"(/\S+)/config/scenes/demo\.yaml", fault)
        if not found:
            refuse("%s does not name its scene demo: %s" % (command, fault))
        self.package = Path(found.group(1))

    def execute(self, words, folder, stdin):
        given = {"input": (folder / stdin).read_bytes()} if stdin else {"stdin": subprocess.DEVNULL}
        return subprocess.run([self.command, *words], cwd=folder, env=self.environment, **given, timeout=DEADLINE,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def record(self, call, name):
        folder = Path(tempfile.mkdtemp(dir=str(self.work)))
        (folder / "data").symlink_to(self.work / "data")
        (folder / "shared").symlink_to(SHARED)
        for path, content in call.files.items():
            (folder / path).write_bytes(content)
        try:
            done = self.execute(call.words, folder, call.stdin)
        except subprocess.TimeoutExpired:
            self.late.append(name)
            return
        outputs = [("exit code", b"%d\n" % done.returncode), ("stdout", done.stdout), ("stderr", done.stderr)]
        for path in sorted(folder.rglob("*")):
            place = path.relative_to(folder).as_posix()
            if path.is_file() and call.files.get(place) != path.read_bytes():
                outputs.append(("file " + place, path.read_bytes()))
        words = " ".join(shlex.quote(word) for word in call.words) + (" << " + call.stdin if call.stdin else "") + call.note
        sections = [self.section(title, content, call, folder) for title, content in outputs]
        (self.out / (name + ".txt")).write_text(SECTION + "arguments\n%s\n" % words + "".join(sections), encoding="utf-8")
        if call.keep:
            shutil.move(str(folder / "out"), str(self.work / "data" / call.keep))
        shutil.rmtree(str(folder))

    def section(self, title, content, call, folder):
        if UNRECORDED.search(title):
            return "%s%s\n" % (SECTION, title)
        text = content.decode("utf-8", "replace")
        if "\0" in text or "\ufffd" in text or (len(content) > LARGEST and title.startswith("file")):
            return "%s%s: %s\n" % (SECTION, title, digest(content))
        for place, mark in ((folder, "<here>"), (self.work, "<work>"), (self.package, "<package>")):
            text = text.replace(str(place), mark)
        text = text if title == "exit code" else normalised(text, " ".join(call.words))
        end = "" if text.endswith("\n") or not text else "<no newline>\n"
        return "%s%s\n%s%s" % (SECTION, title, text, end)


def digest(content):
    """Size and SHA-256; of a PDF that of its unpacked streams, without dates."""
    if content.startswith(b"%PDF"):
        streams = []
        for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.S):
            try:
                streams.append(zlib.decompress(stream))
            except zlib.error:
                streams.append(stream)
        pages = re.sub(rb"\(D:[^)]*\)", b"", b"\n".join(streams))
        return "PDF of %d streams, sha256 %s" % (len(streams), hashlib.sha256(pages).hexdigest())
    return "%d bytes, sha256 %s" % (len(content), hashlib.sha256(content).hexdigest())


def normalised(text, arguments):
    """The text without what differs between two runs."""
    marks = [] if "--help" in arguments else [mark for mark in OF_CALLS if re.search(mark, arguments)]
    rules = [rule for mark in marks for rule in OF_CALLS[mark]]
    for pattern, replacement in (*ALWAYS, *rules):
        text = re.sub(pattern, replacement, text)
    lines = text.split("\n")
    titles = lines[0].split(",")
    timed = [i for i, title in enumerate(titles) if title in TIMED_COLUMNS]
    for k in range(1, len(lines) if timed else 0):
        cells = lines[k].split(",")
        if len(cells) == len(titles):
            lines[k] = ",".join("<time>" if i in timed else cell for i, cell in enumerate(cells))
    return "\n".join(lines)


def make(arguments):
    out = arguments.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    if any(out.iterdir()):
        refuse("%s is not empty; give another folder" % out)
    with tempfile.TemporaryDirectory(prefix="golden_") as work:
        work = Path(work).resolve()
        recorder = Recorder(str(Path(arguments.command).resolve()), work, out)
        calls, files, documents = read_calls(HERE / "calls.txt")
        for name, content in files.items():
            (work / "data" / name).write_bytes(content)
        calls = [call for call in calls if SHARED.is_dir() or "shared/" not in " ".join(call.words)]
        named = unique_names(calls + broken_calls(documents, recorder.package))
        for name, call in named.items():
            if call.keep:
                recorder.record(call, name)
        rest = [(call, name) for name, call in named.items() if not call.keep and arguments.only in name]
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(lambda item: recorder.record(*item), rest))
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print("%d calls, %.0f s of CPU time" % (len(list(out.iterdir())), used.ru_utime + used.ru_stime))
    for name in recorder.late:
        print("golden.py: %s did not end within %d s" % (name, DEADLINE), file=sys.stderr)
    return 1 if recorder.late else 0


def renamed(text, renames):
    for old, new in renames:
        text = re.sub(r"(?<![A-Za-z0-9_])%s(?![A-Za-z0-9_])" % re.escape(old), lambda _: new, text)
    return text


def records(folder, renames):
    """Records by their arguments, renamed."""
    texts = [renamed(path.read_text(encoding="utf-8"), renames) for path in sorted(folder.glob("*.txt"))]
    if not texts:
        refuse("%s holds no records; expected a folder that `golden.py make` wrote" % folder)
    return {text.split("\n", 2)[1]: text for text in texts}


def rounded(text, digits):
    def shorter(found):
        value = float(found.group())
        return "0" if abs(value) < 1e-9 else "%.*g" % (digits, value)
    return NUMBER.sub(shorter, text)


def sorted_keys(text):
    """The text with each JSON section written anew, its keys sorted and its numbers as they stood."""
    def rewritten(found):
        try:
            value = json.loads(found.group(2), parse_float=str, parse_int=str)
        except ValueError:
            return found.group()
        return found.group(1) + json.dumps(value, indent=2, sort_keys=True) + "\n"
    return re.sub(r"(?ms)^(=== (?:stdout|file [^\n]*)\n)([{\[].*?)(?=^=== |\Z)", rewritten, text)


def compare(arguments):
    renames = []
    if arguments.renames:
        lines = arguments.renames.read_text(encoding="utf-8").splitlines()
        renames = [line.split("\t" if "\t" in line else None, 1) for line in lines if line.strip()]
    a, b = records(arguments.a, renames), records(arguments.b, [])
    differences = 0
    for name in sorted({*a, *b}):
        if name not in a or name not in b:
            text = "only in %s: %s\n" % (arguments.a if name in a else arguments.b, name)
        else:
            before, after = a[name], b[name]
            if renames and before != after:
                before, after = sorted_keys(before), sorted_keys(after)
            if arguments.digits and before != after:
                before, after = rounded(before, arguments.digits), rounded(after, arguments.digits)
            diff = list(difflib.unified_diff(before.splitlines(), after.splitlines(), "A " + name, "B " + name, "", "", 1, ""))
            more = ["... %d more lines" % (len(diff) - MOST_LINES)] if len(diff) > MOST_LINES else []
            text = "".join(line + "\n" for line in diff[:MOST_LINES] + more)
        differences += bool(text)
        if text and differences <= MOST_FILES:
            print(text)
    print("%d calls, %d differ" % (len({*a, *b}), differences))
    return 1 if differences else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="task", required=True)
    making = commands.add_parser("make")
    making.add_argument("command")
    making.add_argument("out", type=Path)
    making.add_argument("--only", default="")
    comparing = commands.add_parser("compare")
    comparing.add_argument("a", type=Path)
    comparing.add_argument("b", type=Path)
    comparing.add_argument("--renames", type=Path)
    comparing.add_argument("--digits", type=int)
    arguments = parser.parse_args()
    return make(arguments) if arguments.task == "make" else compare(arguments)


if __name__ == "__main__":
    sys.exit(main())
