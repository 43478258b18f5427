#!/usr/bin/env python3
"""No message, whatever it holds, ends a node: every topic that any node subscribes to gets messages whose fields are extreme,
one by one and all at once, and the nodes go on; so do the services of visual_servo. follow_path alone may end, in order, where
a message says that its goal has ended."""
import math
import os
import struct
import sys
import tempfile
import threading
import time
import unittest

import genpy
import roslib.message
import rosgraph
import rospy
import rosservice
import rostest
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import FollowTipPathActionFeedback, FollowTipPathActionGoal, FollowTipPathActionResult, TargetStatus  # noqa: E402
from helix_arm.srv import ClearSamples, Reload  # noqa: E402
from processes import Process, node, wait_for  # noqa: E402

START = 1.7e9  # of the time that this test gives [s]
WALK = "/walk"  # the action of follow_path
CODES = {"bool": "B", "int8": "b", "byte": "b", "uint8": "B", "char": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
         "int64": "q", "uint64": "Q", "float32": "f", "float64": "d", "time": "II", "duration": "ii"}
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


class Field:
    """One field of a message, or the message: a value, a text, an array or a group of fields, as bytes."""

    def __init__(self, path, kind, value):
        self.path, self.kind, self.data, self.parts, self.counted = path, kind, b"", [], None  # counted: the length that it tells
        self.claims = kind == "string" or kind.endswith("[]")
        if kind == "string" or kind.startswith(("uint8[", "char[")):
            self.data = value.encode() if isinstance(value, str) else bytes(value)
        elif "[" in kind:
            self.parts = [Field("%s[%d]" % (path, i), kind[:kind.index("[")], one) for i, one in enumerate(value)]
        elif kind in CODES:
            self.data = struct.pack("<" + CODES[kind], *([value.secs, value.nsecs] if kind in ("time", "duration") else [value]))
        else:
            self.parts = [Field((path + "." + name).lstrip("."), of, getattr(value, name))
                          for name, of in zip(value.__slots__, value._slot_types)]

    def is_array(self):
        return "[" in self.kind and not self.data and not self.kind.startswith(("uint8[", "char["))

    def written(self):
        count = len(self.parts) if self.is_array() else len(self.data)
        length = struct.pack("<I", count if self.counted is None else self.counted) if self.claims else b""
        return length + self.data + b"".join(part.written() for part in self.parts)

    def all(self):
        return [self] + [field for part in self.parts for field in part.all()]

    def extremes(self):
        """Extreme values of its type, as bytes."""
        if self.kind == "string":
            return [b"", b"\0\0\0", b"/", b"\xff\xfe\x80\n%s%n%n", b"../../etc/passwd", b"0", b"x" * 1000000]
        if self.kind == "uint8[]":
            return [b"", b"\xff\xd8\xff", b"\xff" * 1000000]
        code = CODES.get(self.kind)
        if code is None:
            return []
        most = 0xffffffff
        if code == "II":
            values = [(0, 0), (0, most), (1, 1000000000), (0x7fffffff, 999999999), (0x80000000, 0), (most, 0), (most, 999999999),
                      (most, most)]
        elif code == "ii":
            ends = (0, -1 << 31, (1 << 31) - 1)
            values = [(secs, nsecs) for secs in ends for nsecs in ends]
        elif code in "fd":
            largest = sys.float_info.max if code == "d" else 3.4028234663852886e38
            least = 5e-324 if code == "d" else 1.401298464324817e-45
            values = [(x,) for x in (0.0, -largest, largest, math.nan, math.inf, -math.inf, least, -0.0, 1e30)]
        else:
            bits = 8 * struct.calcsize(code)
            signed = code.islower()
            values = [(0,), (-1 << (bits - 1) if signed else 0,), ((1 << (bits - signed)) - 1,)]
        return [struct.pack("<" + code, *value) for value in values]


def extremes_of(sound):
    """What is extreme, and the bytes: messages that differ from a sound one in one field; arrays in their length and in their
    first and last part; then some in which every field is extreme, and some that end too early. @param sound  makes one."""
    message, out = sound(), []

    def note(what):
        out.append((what, message.written()))

    def visit(field):
        data, parts = field.data, field.parts
        for number, field.data in enumerate(field.extremes()):
            note("%s, extreme %d" % (field.path, number))
        field.data = data
        if field.claims:
            for field.counted in (1 << 29, 0xffffffff):
                note("%s that claims %d" % (field.path, field.counted))
            field.counted = None
        if field.claims and field.is_array():
            changes = [("empty", [])]
            if parts:
                huge = min(100000, 2000000 // max(1, len(parts[0].written())))
                changes += [("one less", parts[:-1]), ("one more", parts + parts[:1]), ("huge", parts[:1] * huge)]
            for words, field.parts in changes:
                note("%s, %s" % (field.path, words))
            field.parts = parts
        for part in [parts[i] for i in sorted({0, len(parts) - 1})] if field.is_array() and parts else parts:
            visit(part)

    visit(message)
    for k in range(9):
        message = sound()
        for field in message.all():
            values = field.extremes()
            if not field.parts and values:
                field.data = values[k % len(values)]
        note("every field, extreme %d" % k)
    whole = sound().written()
    return out + [("cut to %d bytes" % n, whole[:n]) for n in (0, 1, len(whole) // 2)]


class Raw(rospy.AnyMsg):
    """A message of any type, as bytes."""

    def __init__(self, data=b""):
        super().__init__()
        self._buff = data

    @classmethod
    def of(cls, kind):
        """Those that say that they are of a type."""
        return type("Raw", (cls,), {"_type": kind._type, "_md5sum": kind._md5sum, "_full_text": kind._full_text, "_has_header": False})


def publisher_of(topic, kind, known={}):
    """The one of this test, for bytes."""
    if topic not in known:
        known[topic] = rospy.Publisher(topic, Raw.of(kind), queue_size=100)
    return known[topic]


class Heard:
    """What comes on a topic from others than this test."""

    def __init__(self, topic):
        self.count, self.last = 0, b""
        self.subscriber = rospy.Subscriber(topic, rospy.AnyMsg, self.on_message)

    def on_message(self, message):
        if message._connection_header["callerid"] != rospy.get_name():
            self.last, self.count = message._buff, self.count + 1

    def more(self, condition=lambda data: True, deadline=60):
        """Waits for one more, for which the condition holds."""
        seen = self.count
        return wait_for(lambda: self.count > seen and condition(self.last), deadline)


class SilentPathServer:
    """An action follow_tip_path whose goals run without end. With the clock, in a thread of its own."""

    def __init__(self):
        self.id, self.new, self.begin = GoalID(), False, time.monotonic()
        publisher_of(WALK + "/result", FollowTipPathActionResult)
        self.subscribers = [rospy.Subscriber(WALK + "/goal", FollowTipPathActionGoal, self.on_goal),
                            rospy.Subscriber(WALK + "/cancel", GoalID, lambda message: None)]
        threading.Thread(target=self.beat, daemon=True).start()

    def now(self):
        return genpy.Time.from_sec(START + time.monotonic() - self.begin)

    def on_goal(self, message):
        self.id, self.new = message.goal_id, True

    def take_goal(self):
        was, self.new = self.new, False
        return was

    def message(self, topic):
        status = GoalStatus(goal_id=self.id, status=GoalStatus.ACTIVE)
        if topic.endswith("status"):
            out = GoalStatusArray(status_list=[status])
        elif topic.endswith("feedback"):
            out = FollowTipPathActionFeedback(status=status)
            out.feedback.state = "closed"
        else:
            out = FollowTipPathActionResult(status=GoalStatus(goal_id=self.id, status=GoalStatus.ABORTED))
        out.header.stamp = self.now()
        return out

    def beat(self):
        turn = 0
        while not rospy.is_shutdown():
            messages = {"/clock": Clock(self.now())}
            if turn % 10 == 0:
                messages.update({topic: self.message(topic) for topic in (WALK + "/status", WALK + "/feedback")})
            for topic, message in messages.items():
                publisher = publisher_of(topic, message)
                try:
                    publisher.publish(publisher.data_class(Field("", message._type, message).written()))
                except rospy.ROSException:
                    return  # at the end
            turn += 1
            time.sleep(0.01)


class AnyMessage(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        # Before the nodes are told of simulated time: this one goes by the clock of the machine.
        rospy.init_node("any_message", anonymous=True, disable_signals=True)
        rospy.set_param("/use_sim_time", True)
        cls.folder, cls.nodes, cls.walk = tempfile.TemporaryDirectory(), {}, SilentPathServer()
        for name, program, more in (
                ("pressure_command", "pressure_command", ["_regulator:=topic"]), ("simulated_rig", "simulated_rig", ["_camera_rate:=5"]),
                ("vision", "vision", ["_source:=image/compressed"]),
                ("raw_vision", "vision", ["_source:=image", "__name:=raw_vision", "_frame_prefix:=raw_"]),
                ("calibration", "calibration", []), ("monitor", "monitor", []), ("teleop", "teleop", []), ("experiment", "experiment", []),
                ("pressure_series", "pressure_series", ["_loop:=true", "_ramp_s:=0.5"]),
                ("workspace_cloud", "workspace_cloud", ["_count:=1000"]), ("visual_servo", "visual_servo", [])):
            cls.nodes[name] = Process([node(program), "_scene:=demo"] + more)
        cls.start_path_client()
        cls.heard = {name: Heard(name) for name in (
            "pressure_measured", "pressure_target", "tag_detections", "loop_status", "target_status")}

    @classmethod
    def tearDownClass(cls):
        for one in cls.nodes.values():
            one.__exit__()

    @classmethod
    def start_path_client(cls):
        path = os.path.join(cls.folder.name, "path.csv")
        with open(path, "w") as file:
            file.write("time_s,x_m,y_m,z_m\n0,0.366,0.0035,0.0088\n1,0.366,0.0185,0.0088\n")
        cls.nodes["follow_path"] = Process([node("follow_path"), "_path:=" + path, "_action:=" + WALK,
                                            "_record:=" + os.path.join(cls.folder.name, "run.csv")])

    def revive_path_client(self):
        """Starts follow_path again where it has ended in order. False: its goal does not come."""
        if self.nodes["follow_path"].code(0) not in (0, 1):
            return True
        self.walk.take_goal()
        self.start_path_client()
        return wait_for(self.walk.take_goal)

    def check_alive(self, after):
        for name, one in self.nodes.items():
            code = one.code(0)
            if code is not None and not (name == "follow_path" and code in (0, 1)):
                self.fail("%s ended with %d after %s:\n%s" % (name, code, after, one.output()[-2000:]))

    def takes_targets(self):
        def reached(data):
            try:
                return TargetStatus().deserialize(data).outcome == TargetStatus.REACHED
            except genpy.DeserializationError:
                return False  # one that this test has sent

        # Whatever came may have vented the arm, rightly; it can be enabled again.
        rospy.ServiceProxy("pressure_command/enable", Trigger)()
        return self.heard["target_status"].more(reached, 0.5)

    def check_work(self, after):
        """The nodes run, hear and answer."""
        self.assertTrue(self.revive_path_client(), "no goal of follow_path after " + after)
        self.check_alive(after)
        for name, heard in self.heard.items():
            self.assertTrue(heard.more(), "no %s after %s" % (name, after))
        self.assertTrue(wait_for(self.takes_targets, 30), "the arm takes no target after " + after)
        for name, service in (("calibration/clear_samples", ClearSamples), ("workspace_cloud/reload", Reload),
                              ("visual_servo/reset", Trigger)):
            rospy.ServiceProxy(name, service)()
        printed = len(self.nodes["monitor"].output())
        self.assertTrue(wait_for(lambda: len(self.nodes["monitor"].output()) > printed), "no line of the monitor after " + after)
        self.check_alive(after)

    def setUp(self):
        for service in ("pressure_command/enable", "calibration/clear_samples", "workspace_cloud/reload", "visual_servo/reset"):
            rospy.wait_for_service(service, 60)
        self.check_work("the start")

    def subscriptions(self):
        """Topics with their types and the number of nodes under test that subscribe to them."""
        master = rosgraph.Master("/any_message")
        types = dict(master.getTopicTypes())
        counts = {topic: sum(node[1:] in self.nodes for node in nodes) for topic, nodes in master.getSystemState()[1]}
        return {topic: (roslib.message.get_message_class(types[topic]), count) for topic, count in counts.items() if count > 0}

    def sound(self, topic, of):
        """Makes a message of the topic as the nodes send it; where none does, one that they accept. Answers to the goal of
        follow_path are of this goal."""
        if topic.startswith(WALK):
            return lambda: Field("", of._type, self.walk.message(topic))
        message = of()
        heard = Heard(topic)
        if topic != "/clock" and heard.more(deadline=1):
            message.deserialize(heard.last)
        else:
            genpy.message.fill_message_args(message, [SOUND.get(of._type, {})])
        heard.subscriber.unregister()
        return lambda: Field("", of._type, message)

    def advertise(self, topic, of, subscribers):
        publisher = publisher_of(topic, of)
        self.assertTrue(wait_for(lambda: (not topic.startswith(WALK) or self.revive_path_client()) and
                                 publisher.get_num_connections() >= subscribers, 60), topic)
        return publisher

    def send_extremes(self, topic, of, subscribers):
        answers = topic.startswith(WALK)
        publisher = self.advertise(topic, of, subscribers)
        sound = self.sound(topic, of)
        extremes = extremes_of(sound)
        self.assertGreater(len(extremes), 10, topic)
        # A look takes a while. What follows the end of a goal says nothing to follow_path.
        between_looks, sent = 4 if answers else 40, ""
        for k in range(len(extremes)):
            what, data = extremes[k]
            publisher.publish(publisher.data_class(data))
            sent += "\n" + what
            time.sleep(0.002 + 1e-8 * len(data))  # time to take it, so that the queue of the node need not drop it
            if k % between_looks > 0 and k + 1 < len(extremes):
                continue
            self.check_alive("one of %s:%s" % (topic, sent))
            sent = ""
            if answers:
                # The client may be about to end when it is looked at.
                self.assertTrue(wait_for(
                    lambda: self.revive_path_client() and publisher.get_num_connections() >= subscribers, 60), topic)
                extremes = extremes_of(sound)  # of the new goal
        print("%s (%s): %d messages" % (topic, of._type, len(extremes)), flush=True)

    def send_to_all(self, is_wanted):
        """Sends extremes on all topics of a kind, and returns their number."""
        wanted = {topic: of for topic, of in self.subscriptions().items() if topic != "/clock" and is_wanted(topic)}
        for topic, (of, subscribers) in sorted(wanted.items()):
            self.send_extremes(topic, of, subscribers)
            self.check_work(topic)
        return len(wanted)

    def test_every_field_of_every_topic_may_be_extreme(self):
        self.assertGreaterEqual(self.send_to_all(lambda topic: not topic.startswith(WALK)), 24)

    def test_every_field_of_every_answer_may_be_extreme(self):
        self.assertEqual(self.send_to_all(lambda topic: topic.startswith(WALK)), 3)

    def test_every_request_to_visual_servo_may_be_extreme(self):
        services = [name for name, _ in rosgraph.Master("/any_message").getSystemState()[2]
                    if name.startswith("/visual_servo/") and not name.endswith(("get_loggers", "set_logger_level"))]
        self.assertEqual(len(services), 3)
        for name in services:
            of = rosservice.get_service_class_by_name(name)
            request = of._request_class()
            requests = extremes_of(lambda: Field("", request._type, request))
            any_service = type("Any", (), {"_type": of._type, "_md5sum": of._md5sum, "_request_class": Raw, "_response_class": Raw})
            for what, data in requests + [("a long tail", Field("", request._type, request).written() + b"x" * 1000000)]:
                try:
                    rospy.ServiceProxy(name, any_service)(Raw(data))
                except rospy.ServiceException:
                    pass  # refused
                self.check_alive("%s: %s" % (name, what))
            self.check_work(name)

    def test_no_reading_delays_the_emergency_stop(self):
        """A message of some bytes that claims 2^29 numbers, as a reading: as many as the queue takes. The stop is answered while
        they wait; each of them once cost 4 GB and 10 s before it."""
        of = roslib.message.get_message_class("helix_arm/PressureArray")
        message = Field("", of._type, of())
        for field in message.all():
            if field.path == "pressure":
                field.counted = 1 << 29
        self.assertLessEqual(len(message.written()), 32)
        publisher = self.advertise("pressure_measured", of, 3)
        for _ in range(50):
            publisher.publish(publisher.data_class(message.written()))
        stop = rospy.ServiceProxy("pressure_command/emergency_stop", SetBool)
        asked = time.monotonic()
        self.assertTrue(stop(True).success)
        self.assertLess(time.monotonic() - asked, 5)
        self.assertTrue(self.heard["pressure_target"].more(), "the series continues")
        stop(False)
        self.check_work("claims on pressure_measured")

    def test_a_stamp_from_far_ahead_does_not_end_tf(self):
        """Listeners of tf ignore what is older than their newest frame by more than 10 s: one frame from far ahead would be the
        last that they take."""
        newest = {}

        def on_tf(message):
            for transform in message.transforms:
                newest[transform.child_frame_id] = max(newest.get(transform.child_frame_id, 0), transform.header.stamp.to_sec())

        rospy.Subscriber("/tf", TFMessage, on_tf)
        for topic, frame in (("/pressure_measured", "model_tip"), ("/image/compressed", "measured_tip"), ("/image", "raw_measured_tip")):
            self.assertTrue(wait_for(lambda: frame in newest), topic)
            of, _ = self.subscriptions()[topic]
            publisher = self.advertise(topic, of, 1)
            message = self.sound(topic, of)()
            for ahead in (3600, 4e8):
                far = genpy.Time.from_sec(self.walk.now().to_sec() + ahead)
                for field in message.all():
                    if field.path == "header.stamp":
                        field.data = struct.pack("<II", far.secs, far.nsecs)
                publisher.publish(publisher.data_class(message.written()))
                sent = self.walk.now().to_sec()
                self.assertTrue(wait_for(lambda: newest[frame] > sent + 0.5), topic)
                self.assertLess(newest[frame], self.walk.now().to_sec() + 5, topic + ": it is of the future")

    def test_time_may_be_extreme(self):
        of, listeners = self.subscriptions()["/clock"]
        self.assertEqual(listeners, len(self.nodes))
        self.send_extremes("/clock", of, listeners)
        self.check_work("/clock")


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "any_message", AnyMessage, sys.argv)
