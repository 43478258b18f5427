#!/usr/bin/env python3
"""Nodes and launch files as processes: their output, their exit, their behaviour without a master, and the host of each."""
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import unittest

import rosunit

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from processes import SOURCE, Master, Process, node  # noqa: E402
from test_size import draws  # noqa: E402

SCENE = "_scene:=" + SOURCE + "/config/scenes/spatial_50.yaml"
LAUNCH = SOURCE + "/launch/"
READY = "loop at"


class Case(unittest.TestCase):
    runs = 0

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = os.path.realpath(folder.name)
        self.master = Master()
        self.addCleanup(self.master.__exit__)

    def file(self, name, text):
        path = os.path.join(self.folder, name)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "w") as file:
            file.write(text)
        return path

    def run_node(self, name, *arguments, command=None):
        process = Process((command or [node(name)]) + list(arguments), self.master.variables)
        self.addCleanup(process.__exit__)
        return process

    def assert_prints(self, process, text, deadline=90):
        self.assertTrue(process.prints(text, deadline), text + " in:\n" + process.output())

    def assert_ends(self, process, code, *words, deadline=90):
        """With this code, having said so."""
        self.assertEqual(process.code(deadline), code, process.output())
        for word in words:
            self.assertIn(word, process.output())

    def assert_refused(self, arguments, words, name="pressure_command"):
        Case.runs += 1  # each in a namespace of its own: parameters outlive the node that brought them
        process = self.run_node(name, "__ns:=/run_%d" % Case.runs, *arguments)
        self.assert_ends(process, 2, *words)
        self.assertNotIn(READY, process.output(), "it started nevertheless")
        return process


class NodeProcess(Case):
    def test_a_bad_scene_ends_it_with_2_and_every_fault(self):
        scene = self.file("bad.yaml", "name: bad\narm: {geometry: spatial, stiffness: {K_gamma: -3}, sections: []}\ncolour: green\n")
        self.assert_refused(["_scene:=" + scene], ["K_gamma", "-3", "colour", scene + ":"])

    def every_node(self):
        """Of two arms: one of spatial_50 that a series moves, and a simulated rig. They work."""
        rig = ["__ns:=rig", "_scene:=demo"]
        nodes = {"pressure_command": self.run_node("pressure_command", SCENE)}
        # First, since rospy may miss a publisher that registers at the moment at which it subscribes.
        self.assert_prints(nodes["pressure_command"], READY)
        nodes.update({name: self.run_node(name, *arguments) for name, arguments in (
            ("pressure_series", [SCENE, "_loop:=true"]), ("monitor", []), ("simulated_rig", rig), ("vision", rig),
            ("calibration", rig))})
        for name, words in (("calibration", "ready to record"), ("pressure_series", "row 1"),
                            ("monitor", "tip"), ("vision", "measured")):
            self.assert_prints(nodes[name], words)
        return nodes

    def test_a_lost_master_ends_every_node_with_1(self):
        nodes = self.every_node()
        self.master.stop()
        for process in nodes.values():
            self.assert_ends(process, 1, "is gone")

    def test_a_master_that_forgot_the_node_ends_it(self):
        process = self.run_node("pressure_command", SCENE)
        self.assert_prints(process, READY)
        process.signal(signal.SIGSTOP)  # it is not to see that there is none for a while
        self.master.stop()
        self.master.start()
        process.signal(signal.SIGCONT)
        self.assert_ends(process, 1, "does not know this node")

class LaunchFiles(Case):
    def run_launch(self, file, arguments, scene):
        launch = self.run_node("", "-p", str(self.master.port), LAUNCH + file, "rviz:=false", *arguments, command=["roslaunch"])
        monitor = self.run_node("monitor", "_seconds:=3", "_min_rate:=1", "_scene:=" + scene)
        verdict = monitor.code(45)
        launch.signal(signal.SIGINT)
        return verdict, launch.code(), monitor.output() + launch.output()

    def assert_runs(self, file, *arguments, scene="spatial_50"):
        """The arm runs well by the monitor, which judges by the scene, and everything ends well."""
        verdict, end, output = self.run_launch(file, arguments, scene)
        # A machine that is busy with other tests stops a node for so long that the arm vents, as it is to: that tells nothing.
        if re.search(r"fault: no target came|fault: the regulator's link went down|\(safety.reading_timeout_s\)", output):
            verdict, end, output = self.run_launch(file, arguments, scene)
        self.assertEqual((verdict, end), (0, 0), output)
        self.assertIsNone(re.search("has died|cannot launch|ERROR|FATAL", output), output)

    def test_demo_runs_and_is_measured_to_be_calibrated(self):
        self.assert_runs("demo.launch", "calibration:=true", scene="demo")

# What it takes to have all nodes of a launch file; one variant without arguments where it is not among these.
VARIANTS = {"arm.launch": ["vision:=rendered closed_loop:=true calibration:=true workspace:=true"],
            "demo.launch": ["", "calibration:=true"], "follow.launch": ["path:=circle"], "teleop.launch": ["", "device:=spacenav"],
            "vision.launch": ["", "manager:=/eyes"],
            "two_machines.launch": ["role:=control rig:=true", "role:=camera commander:=true data:=tour_3 rviz:=true"]}


HOSTS = """import json, sys, roslaunch.config as config
for file, arguments in json.loads(sys.argv[1]):
    for node in config.load_config_default([(file, arguments)], None).nodes:
        print('node', file, node.name, dict(node.env_args).get('ROS_HOSTNAME'))
"""


class Hosts(unittest.TestCase):
    def test_launch_files_give_every_node_its_host(self):
        rows = (([], "", "localhost"), (["ROS_HOSTNAME=robot"], "host:=192.0.2.8", "192.0.2.8"),
                (["ROS_HOSTNAME=robot"], "", "robot"), (["ROS_IP=192.0.2.7"], "", "192.0.2.7"))
        for shell, arguments, expected in rows[:draws(1, 4)]:
            # The address by which another machine reaches this one has no default.
            files = [file for file in os.listdir(LAUNCH) if arguments or file != "two_machines.launch"]
            calls = [(LAUNCH + file, variant.split() + arguments.split()) for file in files for variant in VARIANTS.get(file, [""])]
            command = ["env", "-u", "ROS_HOSTNAME", "-u", "ROS_IP", *shell, sys.executable, "-c", HOSTS, json.dumps(calls)]
            lines = subprocess.run(command, check=True, stdout=subprocess.PIPE, universal_newlines=True).stdout
            for file in files:
                with open(LAUNCH + file) as text:
                    declared = set(re.findall('<node [^>]*name="([^"]*)"', text.read()))
                hosts = dict(re.findall(r"^node %s (\S+) (\S+)$" % re.escape(LAUNCH + file), lines, re.M))
                self.assertEqual(set(hosts.values()) - {expected}, set(), file)
                self.assertEqual(declared - set(hosts), set(), file + " does not start these: VARIANTS")


if __name__ == "__main__":
    rosunit.unitrun("helix_arm", "node_process_test", "__main__", sys.argv)
