"""The node workspace_cloud: shows the reachable tip positions."""
import threading

import numpy as np
import rospy
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from helix_arm.node import DONE, FAILED, Parameters, ReloadServer, default_folder, guarded, run

MOST_POINTS = 2000000
FIELDS = ("x", "y", "z", "per_kpa_m", "per_mm_m", "per_percent_K_m")  # float32


class WorkspaceCloud:
    """Publishes `workspace` (sensor_msgs/PointCloud2), latched, once it is complete, and empty when a reload starts a new one.

    Tips at inputs drawn evenly within their limits, in the arm's base frame: x, y, z [m] and, if all inputs are pressures, the
    tip displacement [m] for an error of 1 kPa in every pressure, of 1 mm in every free length and of 1 % in the stiffness.
    `~reload` takes another file of the same rig.
    """

    def __init__(self, end):
        reader = Parameters()
        path = reader.scene("scene", required=True)
        self._count = reader.count("count", 100000, 1, MOST_POINTS)
        self._seed = reader.count("seed", 1, 0, 2**31 - 1)
        self._frame = reader.frame("frame_prefix", "") + "arm_base"
        scene_folder = reader.folder("scene_folder", default_folder())
        reader.finish()
        self._end, self._verdict = end, DONE
        self._publisher = rospy.Publisher("workspace", PointCloud2, latch=True, queue_size=10)
        self._reload = ReloadServer(path, scene_folder, self._adopt)
        self._start(self._reload.scene)

    def step(self):
        pass

    def finish(self):
        return self._verdict

    def _adopt(self, scene):
        self._publish(scene, np.empty((0, 3)))  # the previous points are of another scene
        self._start(scene)

    def _start(self, scene):
        self._sampled = scene
        threading.Thread(target=self._run, args=(scene,), daemon=True).start()

    def _run(self, scene):
        if guarded(lambda: self._sample(scene)) != DONE:
            self._verdict = FAILED
            self._end.set()

    def _sample(self, scene):
        found = scene.workspace(self._count, seed=self._seed, sensitivity=scene._is_pneumatic, threads=1)
        with self._reload.lock:
            if scene is not self._sampled:
                return DONE  # another one was loaded meanwhile
            sensitivity = (found.moved_per_kpa_m, found.moved_per_mm_m, found.moved_per_percent_stiffness_m)
            self._publish(scene, np.column_stack((found.tips, *sensitivity)) if scene._is_pneumatic else found.tips)
        if found.unbalanced == self._count:
            rospy.logwarn("%s: the cloud of the workspace is empty: by tier %s no shape balances the load at any of %d inputs; "
                          "check the scene's load and K_eps, then reload", scene.name, scene.tier, self._count)
            return DONE
        rospy.loginfo("%s: %d tips by tier %s", scene.name, self._count - found.unbalanced, scene.tier)
        if found.unbalanced:
            rospy.loginfo("%s: %d of %d inputs are omitted, because no shape balances the load there", scene.name,
                          found.unbalanced, self._count)
        return DONE

    def _publish(self, scene, points):
        fields = FIELDS if scene._is_pneumatic else FIELDS[:3]
        step = 4 * len(fields)
        self._publisher.publish(PointCloud2(
            header=Header(stamp=rospy.Time.now(), frame_id=self._frame), height=1, width=len(points), point_step=step,
            row_step=step * len(points), is_dense=True, data=points.astype("<f4").tobytes(),
            fields=[PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(fields)]))


def main():
    run("workspace_cloud", WorkspaceCloud)
