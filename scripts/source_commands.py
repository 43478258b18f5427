#!/usr/bin/env python3
"""Prints the compile commands of a build with an entry for each source, as Clang's tools expect them: CMake lists those of the
files into which it combines sources instead.

usage: source_commands.py BUILD > FOLDER/compile_commands.json
"""

import json
import re
import sys
from pathlib import Path

INCLUDE = re.compile(r'^#include "([^"]+)"', re.MULTILINE)


def source_commands(commands):
    """Entries of compile_commands.json, those of combined sources repeated for each of them."""
    out = []
    for entry in commands:
        path = Path(entry["directory"], entry["file"])
        sources = INCLUDE.findall(path.read_text()) if path.parent.name == "Unity" else [entry["file"]]
        for source in sources:
            out.append({**entry, "file": source, "command": entry["command"].replace(entry["file"], source)})
    return out


if __name__ == "__main__":
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(__doc__)
        sys.exit()
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    with open(Path(sys.argv[1], "compile_commands.json")) as commands:
        json.dump(source_commands(json.load(commands)), sys.stdout, indent=1)
