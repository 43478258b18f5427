#!/usr/bin/env python3
"""Bodies of a motion-capture system in place of tags: what is measured, and wrong poses, each of which is named and measured by
nobody."""
import os
import sys

import rospy
import rostest
from geometry_msgs.msg import PoseStamped, Quaternion, TransformStamped
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import ArmShape, TagDetections, VisionStatus  # noqa: E402
from ros_case import RosCase  # noqa: E402

BODIES = ("frame", "middle", "tip")


class Poses(RosCase):
    """Those of the simulated rig at rest, as the test relays them."""

    def setUp(self):
        self.change = lambda name, pose: pose  # what is relayed; None: nothing
        self.rig = self.run_node("simulated_rig", "_scene:=mocap", "_time_factor:=1", "_rate:=50")
        self.publishers = {name: rospy.Publisher("relayed/%s/pose" % name, PoseStamped, queue_size=50) for name in BODIES}
        self.subscribers = [rospy.Subscriber("mocap/%s/pose" % name, PoseStamped, self.relay, name) for name in BODIES]
        for one in self.subscribers:
            self.addCleanup(one.unregister)
        self.status, self.measured, self.detections = (self.inbox(topic, kind) for topic, kind in (
            ("vision_status", VisionStatus), ("measured", ArmShape), ("tag_detections", TagDetections)))

    def relay(self, pose, name):
        changed = self.change(name, pose)
        if changed is not None:
            self.publishers[name].publish(changed)

    def see(self, *arguments):
        self.vision = self.run_node("vision", "_scene:=mocap", "_source:=poses", "_stale_after_s:=0.5", *arguments)
        self.assertTrue(self.measured.next(), self.vision.output())

    def why(self):
        return self.status[-1:]

    def assert_named(self, change, state, *words):
        """While poses are changed, the status says why, and the arm is not measured; then it is again."""
        self.change = change
        said = self.status.next(lambda one: one.state == state and all(word in one.message for word in words))
        self.assertTrue(said, self.status[-1:])
        before = len(self.measured)
        self.assertTrue(self.status.next(lambda one: one.state == state), self.status[-1:])
        self.assertLessEqual(len(self.measured) - before, 1)
        self.change = lambda name, pose: pose
        self.assertTrue(self.measured.next(), self.status[-1:])

    def test_names_what_is_wrong_with_poses_and_measures_none_of_it(self):
        self.see("_topics:=relayed/NAME/pose")
        status = self.status.next(lambda one: one.state == VisionStatus.MEASURED and "3 bodies" in one.message)
        self.assertTrue(status, self.status[-1:])
        self.assertEqual([tag.id for tag in self.detections[-1].tags], [0, 1, 2])
        self.assertTrue(all(tag.fitted and not tag.outlier for tag in self.detections[-1].tags))

        def unturned(_, pose):
            pose.pose.orientation = Quaternion()
            return pose

        def ahead(seconds):
            def change(_, pose):
                pose.header.stamp += rospy.Duration(seconds)
                return pose
            return change

        fault = VisionStatus.CAMERA_FAULT
        self.assert_named(unturned, fault, "pose of body", "norm 0")
        self.assert_named(ahead(37), fault, "37.0", "after ROS time", "synchronise the clocks")
        self.assert_named(ahead(-0.4), fault, "before ROS time", "synchronise the clocks")
        self.assert_named(lambda name, pose: None, VisionStatus.STALE, "does the motion-capture system stream")
        self.assert_named(lambda name, pose: pose if name == "frame" else None, VisionStatus.FEW_TAGS, "not seen: middle, tip")
        # The rest of a set is measured.
        self.change = lambda name, pose: pose if name != "middle" else None
        seen = self.status.next(lambda one: one.state == VisionStatus.MEASURED and "not seen: middle" in one.message)
        self.assertTrue(seen, self.status[-1:])
        self.assertGreater(self.status[-1].bad_poses, 0)

    def test_takes_frames_of_tf(self):
        tf = rospy.Publisher("/tf", TFMessage, queue_size=50)

        def send(name, pose):
            out = TransformStamped(header=pose.header, child_frame_id="body_" + name)
            out.transform.translation, out.transform.rotation = pose.pose.position, pose.pose.orientation
            tf.publish([out])

        self.change = send
        self.see("_tf:=true", "_topics:=body_NAME")


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "mocap", "__main__", sys.argv)
