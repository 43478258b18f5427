#!/usr/bin/env python3
"""A recorded run played again: the same pictures give the same measurements."""
import itertools
import os
import signal
import sys

import rospy
import rostest
from sensor_msgs.msg import CameraInfo

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ArmShape  # noqa: E402
from ros_case import RosCase  # noqa: E402
from test_size import draws  # noqa: E402

WANTED = draws(9, 18)  # measurements
TOPICS = ("image/compressed", "camera_info", "model")
LIVE = ["/live/" + topic for topic in TOPICS]


class Replay(RosCase):
    def vision(self, ns):
        """With the prefix of the models, which are recorded."""
        return self.run_node("vision", "__ns:=" + ns, "_scene:=demo", "_source:=image/compressed", "_frame_prefix:=live_")

    def test_gives_the_same_measurements_as_often_as_it_is_played(self):
        bag, rosbag = self.path("run.bag"), ["rosrun", "rosbag"]
        live, replay = (self.inbox(ns + "/measured", ArmShape) for ns in ("live", "replay"))
        # The recorder listens before the node does, so that the bag holds all that the node sees; the rig takes pictures only
        # while someone does.
        info = self.inbox("live/camera_info", CameraInfo)
        recorder = self.run_node("", "record", "-O", bag, *LIVE, command=rosbag)
        self.assert_wait(lambda: len(info) >= 3)
        node = self.vision("live")
        self.assert_wait(lambda: len(live) >= WANTED)
        recorder.signal(signal.SIGINT)
        self.assertEqual(recorder.code(), 0, recorder.output())
        node.__exit__()

        # Only nodes that start from now on go by the clock of the bag.
        rospy.set_param("/use_sim_time", True)
        self.addCleanup(rospy.delete_param, "/use_sim_time")
        node, played = self.vision("replay"), []
        self.assertTrue(node.prints("looks for"), node.output())
        for _ in range(2):
            first = len(replay)
            player = self.run_node("", "play", "--clock", "--wait-for-subscribers", bag, "--topics", *LIVE,
                                   *["/live/%s:=/replay/%s" % (topic, topic) for topic in TOPICS], command=rosbag)
            self.assertEqual(player.code(), 0, player.output())
            self.assert_wait(lambda: len(replay) >= first + WANTED // 2)
            played.append(sorted((shape.header.stamp, shape.twist) for shape in replay[first:]))
        # A fit begins at the one before: up to the first picture that a node on a busy machine misses.
        alike = list(itertools.takewhile(lambda pair: pair[0][0] == pair[1][0], zip(*played)))
        self.assertGreaterEqual(len(alike), 3)
        for one, other in alike:
            self.assertEqual(one, other)
        self.assertTrue(node.prints("jumped back", 5), node.output())


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "replay", Replay, sys.argv)
