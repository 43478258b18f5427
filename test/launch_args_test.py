#!/usr/bin/env python3
"""No parameter of an earlier launch reaches a node: every node of every launch file clears its own.

usage: launch_args_test.py --root PACKAGE
"""

import argparse
import sys
import xml.etree.ElementTree
from pathlib import Path


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--root", required=True, type=Path)
    files = sorted((parser.parse_args().root / "launch").glob("*.launch"))
    keep = ["%s: %s" % (path.name, node.get("name")) for path in files for node in xml.etree.ElementTree.parse(str(path)).iter("node")
            if node.get("pkg") not in ("rviz", "tf2_ros") and node.get("clear_params") != "true"]
    print("%d launch files; without clear_params=\"true\": %s" % (len(files), ", ".join(keep) or "none"))
    return 1 if keep or len(files) < 5 else 0


if __name__ == "__main__":
    sys.exit(main())
