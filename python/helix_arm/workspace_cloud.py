"""The node workspace_cloud: shows the reachable tip positions."""
import threading

import numpy as np
import rospy
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from helix_arm import Scene
from helix_arm.node import FAILED, Node, Parameters, end, log, run
from helix_arm.reload import SCENES, ReloadServer

MOST_POINTS = 2000000
FIELDS = ("x", "y", "z", "per_kpa_m", "per_mm_m", "per_percent_K_m")  # float32


class WorkspaceCloud(Node):
    """Publishes `workspace` (sensor_msgs/PointCloud2), latched, once it is complete, and empty when a reload starts a new one.

    Tips at inputs drawn evenly within their limits, in the arm's base frame: x, y, z [m] and, if all inputs are pressures, the
    tip displacement [m] for an error of 1 kPa in every pressure, of 1 mm in every free length and of 1 % in the stiffness.
    `~reload` takes another file of the same rig.
    """

    def __init__(self) -> None:
        reader = Parameters()
        path = reader.file("scene", SCENES, ".yaml")
        self._count = reader.count("count", 100000, 1, MOST_POINTS)  # inputs to sample
        self._seed = reader.count("seed", 1, 0, 2**31 - 1)
        self._frame = reader.frame("frame_prefix") + "arm_base"
        scene_folder = reader.folder("scene_folder")
        reader.finish()
        self._publisher = rospy.Publisher("workspace", PointCloud2, latch=True, queue_size=10)
        self._reload = ReloadServer(path, scene_folder, self._adopt)
        self._start(self._reload.scene)

    def _adopt(self, scene: Scene) -> None:
        self._publish(scene, np.empty((0, 3)))  # the previous points are of another scene
        self._start(scene)

    def _start(self, scene: Scene) -> None:
        self._sampled = scene
        threading.Thread(target=self._run, args=(scene,), daemon=True).start()

    def _run(self, scene: Scene) -> None:
        try:
            self._sample(scene)
        except Exception as fault:
            log.fatal(str(fault))
            self._verdict = FAILED
            end.make()

    def _sample(self, scene: Scene) -> None:
        found = scene.workspace(self._count, seed=self._seed, sensitivity=not scene._tendons, threads=1)
        with self._reload.lock:
            if scene is not self._sampled:
                return  # another one was loaded meanwhile
            sensitivity = (found.moved_per_kpa_m, found.moved_per_mm_m, found.moved_per_percent_stiffness_m)
            self._publish(scene, np.column_stack((found.tips, *sensitivity)) if not scene._tendons else found.tips)
        if found.unbalanced == self._count:
            log.warning(f"{scene.name}: the cloud of the workspace is empty: by tier {scene.tier} no shape balances the load at "
                        f"any of {self._count} inputs; check the scene's load and K_eps, then reload")
            return
        log.info(f"{scene.name}: {self._count - found.unbalanced} tips by tier {scene.tier}")
        if found.unbalanced:
            log.info(f"{scene.name}: {found.unbalanced} of {self._count} inputs are omitted, because no shape balances the load "
                     "there")

    def _publish(self, scene: Scene, points: np.ndarray) -> None:
        fields = FIELDS if not scene._tendons else FIELDS[:3]
        step = 4 * len(fields)
        self._publisher.publish(PointCloud2(
            header=Header(stamp=rospy.Time.now(), frame_id=self._frame), height=1, width=len(points), point_step=step,
            row_step=step * len(points), is_dense=True, data=points.astype("<f4").tobytes(),
            fields=[PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(fields)]))


def main() -> None:
    run("workspace_cloud", WorkspaceCloud)
