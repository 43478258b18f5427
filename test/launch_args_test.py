#!/usr/bin/env python3
"""Checks what `roslaunch --ros-args` says of every launch file: each argument is documented there, not in another launch file,
and none that has a default is listed as required, as roslaunch does with a default that is empty. No parameter of another launch
reaches a node.

usage: launch_args_test.py --root PACKAGE
Exit code: 0 when nothing is wrong; 1 with every fault as file: argument: fault.
"""

import argparse
import re
import sys
import xml.etree.ElementTree
from pathlib import Path

from roslaunch.arg_dump import get_args


def faults_of(path):
    faults = []
    for name, (doc, default) in sorted(get_args([str(path)]).items()):
        if not doc:
            faults.append("%s: %s: no doc" % (path.name, name))
        elsewhere = re.search(r"\bas (in|for|of|\w+ of) \w+\.launch", doc or "")
        if elsewhere:
            faults.append("%s: %s: its doc says only \"%s\"; write the sentence itself" % (path.name, name, elsewhere.group()))
        if default is not None and not default:
            faults.append("%s: %s: its default is empty, so --ros-args lists it as required; take a word for it" %
                          (path.name, name))
    for node in xml.etree.ElementTree.parse(str(path)).iter("node"):
        if node.get("pkg") not in ("rviz", "tf2_ros") and node.get("clear_params") != "true":
            faults.append("%s: %s: it keeps the parameters of an earlier launch; add clear_params=\"true\"" %
                          (path.name, node.get("name")))
    return faults


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--root", required=True, type=Path)
    root = parser.parse_args().root
    files = sorted((root / "launch").glob("*.launch"))
    if len(files) < 5:
        print("only %d launch files below %s" % (len(files), root))
        return 1
    faults = [fault for path in files for fault in faults_of(path)]
    print("\n".join(faults) if faults else "%d launch files: all arguments are documented, all nodes clear their parameters" % len(files))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
