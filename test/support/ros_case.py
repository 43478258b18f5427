"""What tests of nodes share: messages that came, nodes that end with the test, and waits with a deadline."""
import os
import sys
import tempfile
import threading
import unittest

import rospy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from helix_arm.msg import PressureArray, TargetStatus  # noqa: E402
from processes import Process, node, wait_for  # noqa: E402


class Inbox(list):
    """All messages of a topic, in the order they came."""

    def __init__(self, topic, kind):
        super().__init__()
        self.subscriber = rospy.Subscriber(topic, kind, self.append)

    def next(self, condition=lambda message: True, deadline=60):
        """Waits for one that came after this call, and for which the condition holds; None when none did."""
        first = len(self)
        wait_for(lambda: any(map(condition, self[first:])), deadline)
        return next(filter(condition, self[first:]), None)

    def answer_to(self, publisher, target, deadline=60, age=0):
        """Of target_status: publishes a target, which gets another stamp than it had, and waits for the answer; one without outcome
        (255) when none came."""
        wait_for(lambda: rospy.Time.now() > target.header.stamp)
        first, stamp, topic = len(self), rospy.Time.now() - rospy.Duration(age), publisher.name.rpartition("/")[2]
        target.header.stamp = stamp
        publisher.publish(target)

        def mine():
            return [one for one in self[first:] if one.topic == topic and one.target_stamp == stamp]

        wait_for(mine, deadline)
        return next(iter(mine()), TargetStatus(outcome=255))

    def next_beside(self, other, deadline=60):
        """Waits for one that came after this call and for one of another topic with the same stamp: a busy machine may drop some of
        either. Both; None when none came."""
        first = len(self)

        def pairs():
            known = {one.header.stamp: one for one in list(other)}
            return [(one, known[one.header.stamp]) for one in self[first:] if one.header.stamp in known]

        wait_for(pairs, deadline)
        return next(iter(pairs()), None)

    def at(self, stamp):
        """Waits for one with this stamp, which may have come already."""
        wait_for(lambda: any(one.header.stamp == stamp for one in self))
        return next((one for one in self if one.header.stamp == stamp), None)


class RosCase(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("test", anonymous=True, disable_signals=True)

    def inbox(self, topic, kind):
        box = Inbox(topic, kind)
        self.addCleanup(box.subscriber.unregister)
        return box

    def path(self, name):
        """Of a file in a folder of this test, below that of temporary files."""
        if "folder" not in vars(self):
            folder = tempfile.TemporaryDirectory()
            self.addCleanup(folder.cleanup)
            self.folder = folder.name
        return os.path.join(self.folder, name)

    def scene_with(self, path, values):
        """Path of a scene with some values, by dotted key, set otherwise; None: without the key."""
        with open(path) as file:
            scene = yaml.safe_load(file)
        for key, value in values.items():
            *sections, last = key.split(".")
            section = scene
            for one in sections:
                section = section.setdefault(one, {})
            if value is None:
                del section[last]
            else:
                section[last] = value
        with open(self.path("with_%d.yaml" % len(os.listdir(self.path("")))), "w") as file:
            yaml.safe_dump(scene, file)
        return file.name

    def run_node(self, name, *arguments, command=None):
        process = Process((command or [node(name)]) + list(arguments))
        self.addCleanup(process.__exit__)
        return process

    def why(self):
        """What is told where a wait has failed."""

    def assert_wait(self, condition, deadline=60):
        self.assertTrue(wait_for(condition, deadline), self.why())


class CommanderCase(RosCase):
    """A user of one pressure_command. Pressures that are taken are held: repeated, as the watchdog of targets wants it."""
    NS, PERIOD = "", 0.2  # of the node; between repetitions [s]

    def setUp(self):
        self.held, ended = None, threading.Event()
        self.pressure_target = rospy.Publisher(self.NS + "pressure_target", PressureArray, queue_size=10)
        self.command, self.measured, self.status, self.diagnostics = (self.inbox(topic, kind) for topic, kind in (
            (self.NS + "pressure_command", PressureArray), (self.NS + "pressure_measured", PressureArray),
            (self.NS + "target_status", TargetStatus), ("/diagnostics", DiagnosticArray)))

        def beat():
            while not ended.wait(self.PERIOD):
                held = self.held
                if held is not None:
                    held.header.stamp = rospy.Time.now()
                    self.pressure_target.publish(held)

        heart = threading.Thread(target=beat)
        heart.start()
        self.addCleanup(heart.join)
        self.addCleanup(ended.set)

    def connect(self):
        """Enables the arm, at the pressures that it has."""
        def is_taken():
            if self.command and self.send_pressures(self.command[-1].pressure, deadline=0.2).outcome == TargetStatus.REACHED:
                return True
            rospy.ServiceProxy(self.NS + "pressure_command/enable", Trigger)()  # refused where it is not vented yet
            return False

        rospy.wait_for_service(self.NS + "pressure_command/enable", 60)
        self.assert_wait(lambda: self.measured and is_taken())

    def send_pressures(self, pressure, names=(), deadline=60):
        """The answer."""
        self.held = None
        target = PressureArray(name=names, pressure=pressure)
        answer = self.status.answer_to(self.pressure_target, target, deadline)
        if answer.outcome == TargetStatus.REACHED:
            self.held = target
        return answer

    def diagnosed(self, status, since=0):
        """The newest values of a status of the node, of those that came after so many; none before they came."""
        name = (self.NS + "pressure_command: ").lstrip("/") + status
        return next(({pair.key: pair.value for pair in one.values} for array in reversed(self.diagnostics[since:])
                     for one in array.status if one.name == name), {})

    def command_after(self, answer):
        """The command in force after an answer was given. Topics may overtake each other; stamps tell."""
        self.assert_wait(lambda: self.command[-1].header.stamp > answer.header.stamp)
        return list(next(one for one in self.command if one.header.stamp > answer.header.stamp).pressure)
