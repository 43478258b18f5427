#!/usr/bin/env python3
"""Calls that helix_arm refuses, each with its message: refusals.txt.

usage: refusals_test.py --command HELIX_ARM
"""

import argparse
import os
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

TABLE = Path(__file__).with_name("refusals.txt")


def read_table():
    """(files by name, [(line, words, message)])."""
    files, calls, begin = {}, [], []
    for number, line in enumerate(TABLE.read_text(encoding="utf-8").splitlines(), 1):
        if line.startswith("file "):
            _, name, text = line.split(" ", 2)
            files[name] = text.encode("latin-1").decode("unicode_escape")
        elif line.startswith(" "):
            more, message = line.split("=>", 1)
            calls.append((number, [*begin, *shlex.split(more)], message.strip()))
        elif line and not line.startswith("#"):
            begin = [word for word in shlex.split(line) if word]
    return files, calls


def content():
    """Of the working folder, by path."""
    return {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--command", required=True, type=lambda path: str(Path(path).resolve()))
    command = parser.parse_args().command
    files, calls = read_table()
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for name, text in files.items():
            Path(name).parent.mkdir(exist_ok=True)
            Path(name).write_text(text, encoding="utf-8")
        before = content()
        for number, words, message in calls:
            run = subprocess.run([command, *words], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120, check=False)
            if run.returncode != 2 or run.stdout or message not in run.stderr or content() != before:
                faults += 1
                print(f"{TABLE.name}:{number}: {shlex.join(words)}: exit code {run.returncode}, {sorted(content().keys() ^ before.keys())}"
                      f"\n  expected {message}\n  {run.stdout}{run.stderr}")
        os.chdir("/")
    print(f"{len(calls)} calls, {faults} not refused as expected")
    return 1 if faults or not calls else 0


if __name__ == "__main__":
    sys.exit(main())
