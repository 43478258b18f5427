#!/usr/bin/env python3
"""Nonsense ends no node: every topic that a node subscribes to gets messages of which one value is NaN, infinite, huge, of a wrong
size, or stamped long ago or far ahead. The nodes go on, and the arm takes a target."""
import copy
import math
import os
import sys
import time
import unittest

import genpy
import roslib.message
import rosgraph
import rospy
import rostest
from actionlib_msgs.msg import GoalID
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import TargetStatus  # noqa: E402
from processes import Process, node, wait_for  # noqa: E402

# Sound messages of topics on which no node publishes, where an empty one is none.
SOUND = {
    "helix_arm/ShapeTarget": {"twist": [0.4, 0, 0, 0, 0.1, 0]},
    "helix_arm/TipTarget": {"pose": {"position": {"x": 0.35}, "orientation": {"w": 1}}},
    "geometry_msgs/PoseStamped": {"pose": {"position": {"x": 0.35}}},
    "geometry_msgs/WrenchStamped": {"wrench": {"force": {"y": 0.3}}},
    "helix_arm/RunCalibrationActionGoal": {"goal": {"fit": ["stiffness"], "plan": [0, 0, 0, 1e5, 0, 0]}},
    "visualization_msgs/InteractiveMarkerFeedback": {"client_id": "/rviz", "marker_name": "tip", "event_type": 1,
                                                     "pose": {"position": {"x": 0.35}, "orientation": {"w": 1}}},
    "tf2_msgs/TFMessage": {"transforms": [{"header": {"frame_id": "arm_base"}, "child_frame_id": "table",
                                           "transform": {"rotation": {"w": 1}}}]},
    "helix_arm/FollowTipPathActionGoal": {"goal": {"hold_s": 0.1, "path": {"joint_names": ["tip"], "points": [
        {"transforms": [{"translation": {"x": 0.366, "y": y, "z": 0.0088}, "rotation": {"w": 1}}], "velocities": [{}],
         "time_from_start": {"secs": int(1 + 1000 * (y - 0.0035))}} for y in (0.0035, 0.0185)]}}},
}
BITS = {"bool": 1, "int8": 8, "byte": 8, "uint8": 8, "char": 8, "int16": 16, "uint16": 16, "int32": 32, "uint32": 32, "int64": 64,
        "uint64": 64}


def nonsense_of(kind):
    """Values of a type of field; none of a group of fields."""
    if kind.startswith("float"):
        return [math.nan, math.inf, -math.inf, 1e30, -1e30]
    if kind == "string":
        return ["", "/", "no such name", "x" * 10000]
    if kind == "time":
        return [genpy.Time(), genpy.Time(1), rospy.Time.now() + rospy.Duration(3600), genpy.Time(0xffffffff, 999999999)]
    if kind == "duration":
        return [genpy.Duration(-1 << 31), genpy.Duration((1 << 31) - 1)]
    if kind not in BITS:
        return []
    signed = kind in ("int8", "byte", "int16", "int32", "int64")
    return [0, -1 << (BITS[kind] - 1) if signed else 0, (1 << (BITS[kind] - signed)) - 1]


def variants_of(kind, sound):
    """Values in place of a sound one: nonsense; of a list also in its first part, and lists of other lengths."""
    base, _, length = kind.partition("[")
    if not length:
        return nonsense_of(kind)
    out = []
    if length == "]":
        out += [sound[:0], sound[:-1], sound + sound[:1], sound[:1] * 1000]
    if not isinstance(sound, bytes) and sound:
        out += [[value] + list(sound[1:]) for value in nonsense_of(base)]
    return out


def make_nonsense(message, path=""):
    """Gives each field in turn nonsense, and yields its name while it has some. actionlib ends where the ids of its goals have
    stamps that ROS cannot compute with: they stay."""
    for name, kind in zip(message.__slots__, message._slot_types):
        if kind == "actionlib_msgs/GoalID":
            continue
        sound = getattr(message, name)
        for value in variants_of(kind, sound):
            setattr(message, name, value)
            yield "%s%s = %.80s" % (path, name, value)
        setattr(message, name, sound)
        for part in sound[:1] if isinstance(sound, list) else [sound]:
            if "/" in kind:  # a group of fields
                yield from make_nonsense(part, path + name + ".")


class AnyMessage(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("any_message", anonymous=True, disable_signals=True)
        cls.statuses, cls.newest = [], {}  # of tf: stamps by their frames [s]
        rospy.Subscriber("target_status", TargetStatus, cls.statuses.append)
        rospy.Subscriber("/tf", TFMessage, cls.on_tf)
        cls.nodes = {name: Process([node(name), "_scene:=demo"] + more) for name, more in (
            ("pressure_command", ["_regulator:=topic"]), ("simulated_rig", ["_camera_rate:=5"]), ("vision", ["_source:=image/compressed"]),
            ("calibration", []), ("monitor", []), ("teleop", []), ("experiment", []), ("pressure_series", ["_loop:=true", "_ramp_s:=0.5"]),
            ("workspace_cloud", ["_count:=1000"]), ("visual_servo", []))}
        for service in ("pressure_command/enable", "calibration/clear_samples", "workspace_cloud/reload", "visual_servo/reset"):
            rospy.wait_for_service(service, 60)

    @classmethod
    def tearDownClass(cls):
        for one in cls.nodes.values():
            one.__exit__()

    @classmethod
    def on_tf(cls, message):
        for transform in message.transforms:
            frame = transform.child_frame_id
            cls.newest[frame] = max(cls.newest.get(frame, 0), transform.header.stamp.to_sec())

    def check_alive(self, after):
        for name, one in self.nodes.items():
            self.assertIsNone(one.child.poll(), "%s ended after %s:\n%s" % (name, after, one.output()[-2000:]))

    def takes_targets(self):
        # What came may have vented the arm, rightly; it can be enabled again.
        rospy.ServiceProxy("pressure_command/enable", Trigger)()
        self.statuses.clear()
        return wait_for(lambda: any(status.outcome == TargetStatus.REACHED for status in list(self.statuses)), 0.5)

    def subscriptions(self):
        """Topics that the nodes under test subscribe to, with their types and the number of these nodes."""
        master = rosgraph.Master("/any_message")
        types = dict(master.getTopicTypes())
        counts = {topic: sum(name[1:] in self.nodes for name in names) for topic, names in master.getSystemState()[1]}
        return {topic: (roslib.message.get_message_class(types[topic]), count) for topic, count in counts.items() if count > 0}

    def sound(self, topic, of):
        """A message as the nodes send it; where none does, one that they accept."""
        try:
            return rospy.wait_for_message(topic, of, 1)
        except rospy.ROSException:
            message = of()
            genpy.message.fill_message_args(message, [SOUND.get(of._type, {})])
            return message

    def publisher(self, topic, of, subscribers):
        publisher = rospy.Publisher(topic, of, queue_size=100)
        self.assertTrue(wait_for(lambda: publisher.get_num_connections() >= subscribers), topic)
        return publisher

    def test_every_value_of_every_topic_may_be_nonsense(self):
        topics = {topic: of for topic, of in self.subscriptions().items() if of[0] is not GoalID}
        self.assertGreaterEqual(len(topics), 24)
        for topic, (of, subscribers) in sorted(topics.items()):
            message, publisher, sent = self.sound(topic, of), self.publisher(topic, of, subscribers), 0
            for what in make_nonsense(message):
                publisher.publish(message)
                time.sleep(0.002)
                sent += 1
                if sent % 40 == 0:
                    self.check_alive("%s: %s, or one before it" % (topic, what))
            self.assertGreater(sent, 5, topic)
            self.check_alive(topic)
            self.assertTrue(wait_for(self.takes_targets, 30), "the arm takes no target after " + topic)
            publisher.unregister()

    def test_a_stamp_from_far_ahead_does_not_end_tf(self):
        """Listeners of tf ignore what is older than their newest frame by more than 10 s: one frame from far ahead would be the
        last that they take."""
        for topic, frame in (("/pressure_measured", "model_tip"), ("/image/compressed", "measured_tip")):
            self.assertTrue(wait_for(lambda: frame in self.newest), topic)
            of, subscribers = self.subscriptions()[topic]
            publisher, message = self.publisher(topic, of, subscribers), copy.deepcopy(self.sound(topic, of))
            for ahead in (3600, 4e8):
                message.header.stamp = rospy.Time.now() + rospy.Duration(ahead)
                publisher.publish(message)
                sent = time.time()
                self.assertTrue(wait_for(lambda: self.newest[frame] > sent + 0.5), topic)
                self.assertLess(self.newest[frame], time.time() + 5, topic + ": it is of the future")
            publisher.unregister()


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "any_message", AnyMessage, sys.argv)
