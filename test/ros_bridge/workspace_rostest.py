#!/usr/bin/env python3
"""The cloud of tips: fields, frame and points, for those who come late as well."""
import os
import sys

import numpy as np
import rospy
import rostest
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import PointCloud2, PointField

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm import Scene  # noqa: E402
from helix_arm.srv import Reload  # noqa: E402
from processes import SOURCE  # noqa: E402
from ros_case import RosCase  # noqa: E402

SCENES = SOURCE + "/config/scenes/"
COUNT, SEED = 3000, 5  # as in workspace.test


class WorkspaceCloud(RosCase):
    def setUp(self):
        self.clouds, self.log = self.inbox("workspace", PointCloud2), self.inbox("/rosout", Log)
        self.assert_wait(lambda: self.clouds and self.log.subscriber.get_num_connections() > 1)

    def reload(self, scene, success=True):
        """The two clouds that follow: an empty one, and that of the scene."""
        before = len(self.clouds)
        self.assertEqual(rospy.ServiceProxy("workspace_cloud/reload", Reload)(scene).success, success)
        self.assert_wait(lambda: not success or len(self.clouds) > before + 1)
        return self.clouds[before:before + 2]

    def test_holds_tips_and_their_sensitivity_in_the_frame_of_the_base(self):
        _, cloud = self.reload("loaded")
        self.assertEqual(cloud.header.frame_id, "left_arm_base")
        self.assertEqual([(field.name, field.offset, field.datatype, field.count) for field in cloud.fields],
                         [(name, 4 * k, PointField.FLOAT32, 1) for k, name in enumerate(
                             ("x", "y", "z", "per_kpa_m", "per_mm_m", "per_percent_K_m"))])
        self.assertEqual((cloud.width, cloud.height, cloud.point_step, cloud.row_step), (COUNT, 1, 24, 24 * COUNT))
        self.assertTrue(cloud.is_dense)
        expected = Scene.load("loaded").workspace(COUNT, seed=SEED, sensitivity=True)
        np.testing.assert_allclose(np.frombuffer(cloud.data, "<f4").reshape(COUNT, 6), np.column_stack((
            expected.tips, expected.moved_per_kpa_m, expected.moved_per_mm_m, expected.moved_per_percent_stiffness_m)), atol=1e-7)

    def test_a_reloaded_scene_has_a_cloud_of_its_own(self):
        self.reload(SCENES + "planar_76.yaml", False)
        empty, cloud = self.reload(SCENES + "demo.yaml")
        self.assertEqual((empty.width, len(empty.data)), (0, 0), "the old points do not stand for the new scene")
        tip = Scene.load("demo").workspace(1, seed=SEED).tips[0]
        np.testing.assert_allclose(np.frombuffer(cloud.data, "<f4")[:3], tip, atol=1e-7)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "workspace", WorkspaceCloud, sys.argv)
