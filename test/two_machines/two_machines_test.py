#!/usr/bin/env python3
"""launch/two_machines.launch on two machines, each a network namespace of this one: the camera machine commands the arm, its
cable is pulled and put back."""
import ctypes
import os
import subprocess
import sys
import tempfile
import time
import unittest

import rospy
import rosunit
from std_srvs.srv import Trigger

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ArmShape, PressureArray, SafetyState, TargetStatus  # noqa: E402
from processes import SOURCE, Process, wait_for  # noqa: E402

CONTROL, CAMERA = "10.77.0.1", "10.77.0.2"
CLONE_NEWNET = 0x40000000
TARGET_TIMEOUT, VENT_TIME = 1.0, 3.0  # [s]
MOVES = 3e4  # far above what a series sends while it waits [Pa]
# Of all waits together, below the TIMEOUT of ctest; and of a roslaunch to end, which gives a node 15 s before it kills it [s].
ALL_WAITS, END = 170, 18
# In the scene of the demo, whose lease ends TARGET_TIMEOUT after the last target: all other timeouts are long.
LONG = (("reading_timeout_s: 0.5", "reading_timeout_s: 3"), ("kpa: 40, time_s: 1,", "kpa: 40, time_s: 3,"))


def run(*command):
    subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


class Network:
    """A network namespace without a name, that of a sleeping child."""

    def __init__(self):
        self.holder = Process(["unshare", "--net", "sleep", "infinity"])
        self.id = str(self.holder.child.pid)
        self.file = "/proc/%s/ns/net" % self.id
        own = os.readlink("/proc/self/ns/net")
        if not wait_for(lambda: self.holder.child.poll() is not None or os.readlink(self.file) != own) or \
                self.holder.child.poll() is not None:
            raise PermissionError("no network namespace: " + self.holder.output())

    def inside(self, *command):
        return ["nsenter", "--target=" + self.id, "--net", *command]

    def enter(self):
        """Moves this thread there, and all that it starts from now on."""
        with open(self.file) as file:
            if ctypes.CDLL(None, use_errno=True).setns(file.fileno(), CLONE_NEWNET) != 0:
                raise OSError(ctypes.get_errno(), self.file + " cannot be entered")

    def join(self, switch, port, address):
        run(*switch.inside("ip", "link", "add", port, "type", "veth", "peer", "name", "eth0", "netns", self.id))
        run(*switch.inside("ip", "link", "set", port, "master", "bridge", "up"))
        run(*self.inside("ip", "address", "add", address + "/24", "dev", "eth0"))
        for device in ("lo", "eth0"):
            run(*self.inside("ip", "link", "set", device, "up"))


def moves(command):
    return max(command.pressure) > MOVES


def rests(command):
    return not any(command.pressure)


class TwoMachines(unittest.TestCase):
    def setUp(self):
        self.end = time.monotonic() + ALL_WAITS
        try:
            self.switch, self.control, self.camera = networks = Network(), Network(), Network()
        except (PermissionError, FileNotFoundError) as error:
            print("[  SKIPPED ]", error)  # which ctest looks for
            self.skipTest(str(error))
        for network in networks:
            self.addCleanup(network.holder.__exit__)
        run(*self.switch.inside("ip", "link", "add", "bridge", "type", "bridge"))
        run(*self.switch.inside("ip", "link", "set", "bridge", "up"))
        self.control.join(self.switch, "control", CONTROL)
        self.camera.join(self.switch, "camera", CAMERA)
        self.control.enter()
        self.launches = {}

    def launch(self, role, address, *arguments):
        command = ["roslaunch", "--wait", "helix_arm", "two_machines.launch", "role:=" + role, "host:=" + address,
                   "scene:=" + self.scene.name, *arguments]
        if role == "control":
            command.remove("--wait")  # the master is its own
        process = Process(command if role == "control" else self.camera.inside(*command),
                          {"ROS_MASTER_URI": "http://%s:11311" % CONTROL, "ROS_HOSTNAME": address})
        self.addCleanup(process.__exit__)
        self.addCleanup(process.code, END)
        self.addCleanup(process.signal, 2)
        self.launches[role] = process

    def wait_for(self, condition, deadline=None):
        ok = wait_for(condition, max(0, self.end - time.monotonic()) if deadline is None else deadline)
        self.assertTrue(ok, "\n".join(role + ":\n" + process.output() for role, process in self.launches.items()))

    def cable(self, state):
        """Of the camera machine: down or up."""
        run(*self.switch.inside("ip", "link", "set", "camera", state))

    def test_the_arm_vents_when_the_link_is_cut_and_stays_vented_when_it_heals(self):
        self.scene = tempfile.NamedTemporaryFile("w", suffix=".yaml")
        with open(SOURCE + "/config/scenes/demo.yaml") as demo:
            text = demo.read()
        for rule, longer in LONG:
            self.assertIn(rule, text)
            text = text.replace(rule, longer)
        self.scene.write(text)
        self.scene.flush()
        self.launch("control", CONTROL, "rig:=true")
        self.launch("camera", CAMERA, "commander:=true")
        os.environ.update({"ROS_MASTER_URI": "http://%s:11311" % CONTROL, "ROS_HOSTNAME": CONTROL})
        self.wait_for(lambda: subprocess.run(["rosparam", "list"], stdout=-3, stderr=-3).returncode == 0)
        rospy.init_node("two_machines_test", disable_signals=True)
        safety, command, status, targets, measured = boxes = [[] for _ in range(5)]
        for box, topic, kind in zip(boxes, ("safety_state", "pressure_command", "target_status", "pressure_target", "measured"),
                                    (SafetyState, PressureArray, TargetStatus, PressureArray, ArmShape)):
            rospy.Subscriber(topic, kind, box.append)

        def goes_on():
            # On a busy machine a link of the chain may be late, which vents it: again, then.
            if safety[-1].state != SafetyState.ENABLED:
                try:
                    rospy.ServiceProxy("/pressure_command/enable", Trigger)()
                except rospy.ServiceException:
                    return False
            return safety[-1].state == SafetyState.ENABLED and moves(command[-1])

        # Nothing moves before it is enabled, although the commander commands.
        self.wait_for(lambda: all(boxes))
        self.assertEqual(status[-1].outcome, TargetStatus.DROPPED)
        self.assertEqual(safety[-1].state, SafetyState.DISABLED)
        self.assertTrue(all(map(rests, command)))
        self.wait_for(goes_on)

        self.cable("down")
        cut = rospy.Time.now()
        # A second more than the rules allow, for the messages.
        self.wait_for(lambda: safety[-1].state == SafetyState.VENTED, TARGET_TIMEOUT + VENT_TIME + 1)
        vented = (safety[-1].header.stamp - cut).to_sec()
        print("vented %.3f s after the cut" % vented)
        self.assertEqual(safety[-1].cause, "stale_target")
        self.assertLessEqual(vented, TARGET_TIMEOUT + VENT_TIME)

        commands_before, states_before, answers_before, targets_before = map(len, (command, safety, status, targets))
        heal = rospy.Time.now()
        self.cable("up")
        # What the commander sends from now on is answered again, and pictures come.
        self.wait_for(lambda: len(status) > answers_before and status[-1].target_stamp > heal)
        self.wait_for(lambda: measured[-1].header.stamp > heal)

        def backlog():
            return sum(cut < target.header.stamp < heal for target in targets[targets_before:])

        self.wait_for(lambda: backlog() > 0)
        print("%d targets of the time of the cut came late" % backlog())
        self.assertEqual({answer.outcome for answer in status[answers_before:]}, {TargetStatus.DROPPED})
        self.assertGreater(len(command), commands_before)
        self.assertTrue(all(map(rests, command[commands_before:])))
        for state in safety[states_before:]:
            self.assertEqual((state.state, state.cause), (SafetyState.VENTED, "stale_target"), state)
        self.wait_for(goes_on)


if __name__ == "__main__":
    rosunit.unitrun("helix_arm", "two_machines_test", TwoMachines, sys.argv)
