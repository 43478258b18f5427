"""A user of visual_servo on the demo's simulated rig: repeats targets, sends goals, and reads what the loop says."""
import math
import os
import sys
import time

import actionlib
import numpy as np
import rospy
from geometry_msgs.msg import Point, PoseStamped, Quaternion, Transform, Vector3
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectoryPoint

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
from helix_arm.msg import (ArmShape, FollowTipPathAction, FollowTipPathGoal, LoopStatus, PressureArray, SafetyState,  # noqa: E402
                           TargetStatus, TipTarget)
from processes import Process, node, wait_for  # noqa: E402
from ros_case import Inbox, RosCase  # noqa: E402

# Places around the middle of what the arm reaches, base frame [m].
MIDDLE = np.array([0.366, 0.0035, 0.0088])
BESIDE = MIDDLE + [0, 0.015, 0]


def place(point):
    return np.array([point.x, point.y, point.z])


def target_at(values, frame=""):
    out = TipTarget(mode=TipTarget.POSITION)
    out.header.frame_id = frame
    out.pose.position = Point(*values)
    return out


def goal_along(places, step, **fields):
    """Along points that are this far apart in time [s], base frame [m]; held for a moment."""
    goal = FollowTipPathGoal(**{"goal_tolerance": 0.005, "hold_s": 0.1, **fields})
    for k, values in enumerate(places):
        transform = Transform(Vector3(*values), Quaternion(w=1))
        goal.path.points.append(MultiDOFJointTrajectoryPoint(transforms=[transform], time_from_start=rospy.Duration(step * k)))
    return goal


def call(service):
    return rospy.ServiceProxy(service, Trigger)().success


def close_loop(closed):
    return rospy.ServiceProxy("visual_servo/close_loop", SetBool)(closed).success


class LoopRig(RosCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.start_vision()
        for name, topic, kind in (("loop", "loop_status", LoopStatus), ("estimate", "estimate", ArmShape),
                                  ("measured", "measured", ArmShape), ("sent", "pressure_target", PressureArray),
                                  ("status", "target_status", TargetStatus), ("safety", "safety_state", SafetyState)):
            setattr(cls, name, Inbox(topic, kind))
        for name, kind in (("tip_target", TipTarget), ("tip_target_pose", PoseStamped), ("pressure_target", PressureArray)):
            setattr(cls, name, rospy.Publisher(name, kind, queue_size=10))

    @classmethod
    def tearDownClass(cls):
        cls.vision.__exit__()

    @classmethod
    def start_vision(cls):
        cls.vision = Process([node("vision"), "_scene:=demo", "_source:=image/compressed"])

    def setUp(self):
        self.last_sent, self.feedback = 0, []
        self.assertTrue(wait_for(lambda: all(one.get_num_connections() for one in (
            self.tip_target, self.tip_target_pose, self.pressure_target)) and self.loop and self.safety and self.measured and
            not rospy.Time.now().is_zero()), self.vision.output())
        self.client = actionlib.SimpleActionClient("visual_servo/follow_tip_path", FollowTipPathAction)
        self.assertTrue(self.client.wait_for_server(rospy.Duration(20)))
        self.assert_comes_to(LoopStatus.IDLE)
        # Vented and enabled, so that no timeout of targets runs before the first one; refused while pressure remains.
        self.assertTrue(call("pressure_command/vent"))
        self.assert_wait(lambda: self.safety[-1].state in (SafetyState.VENTED, SafetyState.DISABLED))
        self.assert_wait(lambda: call("pressure_command/enable") or wait_for(
            lambda: self.safety[-1].state == SafetyState.ENABLED, 0.2))
        self.assert_wait(lambda: self.safety[-1].state == SafetyState.ENABLED)

    def why(self):
        return self.loop[-1:], self.safety[-1:]

    def assert_wait(self, condition, deadline=60, target=None):
        """The condition comes to hold, while a target is repeated at 20 Hz."""
        def holds():
            if target is not None and time.monotonic() > self.last_sent + 0.05:
                self.last_sent = time.monotonic()
                target.header.stamp = rospy.Time.now()
                self.tip_target.publish(target)
            return condition()

        super().assert_wait(holds, deadline)

    def assert_comes_to(self, state, target=None, deadline=40):
        self.assert_wait(lambda: self.loop and self.loop[-1].state == state, deadline, target)

    def assert_tip_comes_to(self, values, distance, target):
        """The measured tip comes within this of a place [m]."""
        self.assert_wait(lambda: math.dist(place(self.measured[-1].tip.position), values) < distance, 40, target)

    def send(self, goal):
        """Sends a goal; its feedback is noted."""
        self.feedback = []
        self.client.send_goal(goal, feedback_cb=self.feedback.append)

    def is_done(self, client=None):
        # A client's own state misses an end that comes before its send_goal() returns.
        return (client or self.client).gh.get_comm_state() == actionlib.CommState.DONE

    def assert_ends(self, code, *words, client=None):
        """The goal ends with this error_code."""
        client = client or self.client
        self.assert_wait(lambda: self.is_done(client), 60)
        result = client.get_result()
        self.assertEqual(result.error_code, code, result)
        for word in words:
            self.assertIn(word, result.error_string)

    def assert_under_way(self):
        self.assert_wait(lambda: len(self.feedback) > 2, 40)

    def assert_goes_on(self, count):
        """So many more states of the loop come."""
        first = len(self.loop)
        self.assert_wait(lambda: len(self.loop) > first + count)
