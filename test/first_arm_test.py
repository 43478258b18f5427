#!/usr/bin/env python3
"""Follows docs/first_arm.md: runs its commands in order, in an empty folder, and looks at what they leave behind.

Blocks with the info string "sh" are run line by line, "sh terminal" in the background until the next <!-- end --> or, if their
command has the word, <!-- end WORD -->, "sh webcam" not at all. rviz is left out.
"""
import argparse
import itertools
import json
import math
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent / "support"))
from processes import Process, free_port, wait_for  # noqa: E402

PATIENCE_S = 240  # of a command, and of what it waits for
NODES_UP = r"\b(rosservice|rostopic echo)\b"  # such commands wait until what they name is there


class Fault(Exception):
    pass


def steps_of(text):
    """[("run" or "terminal", line) or ("end", word)] in the page's order."""
    steps, kind = [], None
    for line in text.split("\n"):
        if line.startswith("```"):
            kind = line[3:].strip() if kind is None else None
        elif re.match(r"<!-- end .*-->", line.strip()):
            steps.append(("end", line.strip()[len("<!-- end"):-len("-->")].strip()))
        elif kind == "sh" and line.strip():
            steps.append(("run", line))
        elif kind == "sh terminal" and line.strip():
            steps.append(("terminal", line))
    return steps


class Reader:
    """A person in front of terminals."""

    def __init__(self, folder, setup):
        self.folder, self.setup = folder, setup
        self.variables = {"ROS_HOSTNAME": "localhost", "ROS_HOME": str(folder / "ros"),
                          "ROS_MASTER_URI": "http://localhost:%d" % free_port()}
        self.terminals = []
        self.said = {}

    def start(self, line):
        if line.startswith("roslaunch"):
            line += " rviz:=false"
        return Process(["bash", "-c", "unset ROS_IP; source '%s' && %s" % (self.setup, line)], self.variables, str(self.folder))

    def run(self, line):
        deadline = time.monotonic() + PATIENCE_S
        while True:
            for text, process in self.terminals:
                expect(process.child.poll() is None, "%s ended by itself:\n%s" % (text, process.output()[-3000:]))
            with self.start(line) as process:
                code = process.code(max(1, deadline - time.monotonic()))
                text = process.output()
            if code == 0:
                self.said[line] = text
                return
            waits = code is not None and time.monotonic() < deadline and re.search(NODES_UP, line)
            expect(waits, "%s\nended with %s:\n%s" % (line, "no answer" if code is None else code, text[-3000:]))
            time.sleep(0.2)  # the node is not up yet

    def open_terminal(self, line):
        self.terminals.append((line, self.start(line)))
        if re.search(r"regulator \S+ emulate", line):
            expect(wait_for((self.folder / "board").exists, PATIENCE_S), "%s does not emulate" % line)

    def end(self, word=""):
        for terminal in [one for one in reversed(self.terminals) if word in one[0]]:
            terminal[1].signal(signal.SIGINT)
            terminal[1].code(20)
            terminal[1].__exit__()
            self.terminals.remove(terminal)

    def follow(self, steps):
        for kind, line in steps:
            if kind == "run":
                self.run(line)
            elif kind == "terminal":
                self.open_terminal(line)
            else:
                self.end(line)

    def told(self, part):
        return "\n".join(text for line, text in self.said.items() if part in line)


def expect(holds, what):
    if not holds:
        raise Fault(what)


def answer(reader, command, *words):
    run = subprocess.run([command, *words, "--format", "json"], cwd=str(reader.folder), stdout=subprocess.PIPE, check=True,
                         timeout=PATIENCE_S)
    return json.loads(run.stdout.decode())


def expect_cli(reader, command):
    """What the commands without ROS have to leave behind."""
    expect((reader.folder / "tags.pdf").stat().st_size > 10000, "tags.pdf is small")
    scene = (reader.folder / "my_arm.yaml").read_text(encoding="utf-8")
    camera = scene[scene.index("\ncamera:"):]

    def written(key):
        return [float(number) for number in re.search(key + r": \[([^\]]*)\]", camera).group(1).split(",")]

    for focal in written("focal_px"):
        expect(focal != 930 and abs(focal / 930 - 1) < 0.005, "focal length is %s px" % focal)
    placed = answer(reader, command, "camera", "place", "my_arm.yaml", "--source", "rest_pictures")
    azimuth = math.radians(35)
    truth = (0.6 * math.cos(azimuth), 0.6 * math.sin(azimuth), 0.45)
    for value, true, sd in zip(written("position_m"), truth, placed["standard_error"]["position_m"]):
        expect(abs(value - true) < 3 * sd + 1e-3, "the camera is placed at %s, not at %s" % (written("position_m"), truth))
    check = answer(reader, command, "check", "my_arm.yaml")
    expect(check["passed"], "check finds %s" % check["findings"])
    expect(not any(one["check"] == "camera_uncalibrated" for one in check["findings"]), "the camera is not calibrated")
    reached = re.search(r"^ *muscle_1 +(-?[\d.]+) ", reader.told("regulator my_arm.yaml set"), re.M)
    expect(reached and abs(float(reached.group(1)) - 20) < 4, "set to 20 kPa: " + reader.told("regulator my_arm.yaml set"))


def expect_ros(reader, command):
    message = reader.told("run_calibration/result")
    error = re.search(r"tip error ([\d.]+) mm before, ([\d.]+) mm after; calibrated my_arm: K_kappa", message)
    expect(error, "the result of the calibration is " + message)
    expect(float(error.group(2)) < 0.5 * float(error.group(1)), "the tip error stays: " + message)
    reason = reader.told("/safety_state/reason")
    expect("target" in reason, "the arm says that it vented for " + reason)
    expect(reader.told("/reload").count("True") == 4, "reload: " + reader.told("/reload"))
    expect("closed" in reader.told("/loop_status/state"), "the loop is " + reader.told("/loop_status/state"))
    steady = []
    for scene, more in (("my_arm.yaml", ["--open"]), ("calibrated.yaml", ["--open"]), ("calibrated.yaml", [])):
        run = answer(reader, command, "follow", scene, "--rig", "my_rig.yaml", "--tip", "0.27,0.03,0.02", "--seconds", "4", *more)
        steady.append(run["steady_rms_m"][0])
    # With the loop closed, what remains is the error of the camera's place, so that it is not below that of the calibrated model.
    expect(steady[1] < 0.5 * steady[0] and steady[2] < 2e-3, "steady errors of follow: %s m" % steady)


def without_ros(steps):
    """The steps of the sections before the first roslaunch, and the emulation."""
    return [*itertools.takewhile(lambda step: not step[1].startswith("roslaunch"), steps), ("end", "")]


def follow(steps, arguments, ros):
    with tempfile.TemporaryDirectory() as folder:
        reader = Reader(Path(folder).resolve(), arguments.setup)
        try:
            reader.follow(steps if ros else without_ros(steps))
            expect_cli(reader, arguments.command)
            if ros:
                expect_ros(reader, arguments.command)
        except (Fault, OSError, subprocess.SubprocessError) as fault:
            return str(fault)
        finally:
            reader.end()
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--page", type=Path, default=Path(__file__).resolve().parent.parent / "docs" / "first_arm.md")
    parser.add_argument("--command", required=True)
    parser.add_argument("--setup", required=True, help="setup.bash of the workspace")
    parser.add_argument("--ros", action="store_true", help="also what needs a master")
    arguments = parser.parse_args()
    steps = steps_of(arguments.page.read_text(encoding="utf-8"))
    fault = follow(steps, arguments, arguments.ros)
    print(fault or "%d commands followed" % len(steps))
    return 1 if fault or len(steps) < 20 else 0


if __name__ == "__main__":
    sys.exit(main())
