"""What tests of nodes share: messages that came, nodes that end with the test, and waits with a deadline."""
import os
import sys
import tempfile
import unittest

import rospy
import yaml

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from processes import Process, node, wait_for  # noqa: E402


class Inbox(list):
    """All messages of a topic, in the order they came."""

    def __init__(self, topic, kind):
        super().__init__()
        self.subscriber = rospy.Subscriber(topic, kind, self.append)

    def next(self, condition=lambda message: True, deadline=20):
        """Waits for one that came after this call, and for which the condition holds; None when none did."""
        first = len(self)
        wait_for(lambda: any(map(condition, self[first:])), deadline)
        return next(filter(condition, self[first:]), None)

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

    def assert_wait(self, condition, deadline=20):
        self.assertTrue(wait_for(condition, deadline), self.why())
