"""Measurements of an arm: whether it stands still, and the samples that are recorded of it."""
from __future__ import annotations

import functools
import math
import threading
import time
from typing import Any, Callable, List, Optional, Tuple

import numpy as np
import rospy

from helix_arm import _core
from helix_arm.arguments import require
from helix_arm.file_access import RECORDED, quoted
from helix_arm.msg import ArmShape, BodyPoses, PressureArray, TagDetections, VisionStatus
from helix_arm.node import LONGEST_MESSAGE, FaultCount, listen, log
from helix_arm.scene import Scene

CLOCK_PATIENCE = 2.0  # longest stop of ROS time [s]


class MovingClock:
    """ROS time while it advances. If it stops, for example because the node that simulates it has ended, a steady clock continues
    it, so that earlier data still ages. now() is to be called more often than every CLOCK_PATIENCE."""

    def __init__(self) -> None:
        self._last, self._since = rospy.Time(), -math.inf
        self.stands = False  # whether ROS time had stopped at the last call of now()

    def now(self) -> float:
        """[s]"""
        ros, steady = rospy.get_rostime(), time.monotonic()
        if ros != self._last or self._since == -math.inf:
            self._since = steady
        self._last, still = ros, steady - self._since
        self.stands = still > CLOCK_PATIENCE
        return ros.to_sec() + (still if self.stands else 0.0)


class Recording:
    """The samples that were recorded of an arm, and its scene. series: of a run in a loop. calibrated: text of the last scene."""

    def __init__(self, scene: Scene, samples: List[Any], series: Optional[Any], calibrated: str) -> None:
        self.scene, self.samples, self.series, self.calibrated = scene, samples, series, calibrated

    def data(self) -> Any:
        """Samples for a calibration."""
        require(bool(self.samples), "no sample was recorded; call record_sample or run_calibration first, or name data sets")
        return self.scene._measured(self.samples, self.series)

    def _title(self) -> str:
        return f"{RECORDED}{self.scene.name}, {time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())}"

    def table(self) -> str:
        """A data set of tag corners, as CSV."""
        return self.scene._sample_table(self.samples, self._title())

    def series_table(self) -> Tuple[int, str]:
        """Rows and text of a data set of the series, as CSV; its times are those of the table."""
        return (0, "") if self.series is None else self.series.table(self._title())


class Recorder:
    """Listens to what is measured of an arm, tells whether it stands still and whether measurements are fresh, and holds the
    samples. From any thread.

    Ages and windows go by the stamps of messages and ROS time; where ROS time stands still, by a steady clock.
    """

    def __init__(self, scene: Scene, rules: Any) -> None:
        self._lock = threading.Lock()
        self._scene, self._rules = scene, rules
        self._clock = MovingClock()
        self._watch = _core.SettleWatch(scene.actuators, rules)
        self._watch.wait_for_rest(scene)
        self._vision: Optional[VisionStatus] = None  # the last one
        self._foreign = FaultCount()
        self._samples: List[Any] = []
        self._calibrated = ""  # text of the scene that was calibrated last
        self._series: Optional[Any] = None
        self._records_series = False
        pressures = [
            listen(topic, PressureArray, 100, functools.partial(self._on_pressures, topic=topic, hand=hand))
            for topic, hand in (("pressure_measured", self._watch.measured), ("pressure_command", self._watch.command))]
        self._subscribers = (
            *pressures, listen("tag_detections", TagDetections, 100, self._on_detections),
            listen("body_poses", BodyPoses, 100, self._on_bodies),
            listen("measured", ArmShape, 100, self._on_shape), listen("vision_status", VisionStatus, 100, self._on_vision))

    def tick(self) -> None:
        """Called periodically."""
        with self._lock:
            self._clock.now()

    def observe(self) -> Tuple[float, bool, Any]:
        """The time [s], whether ROS time stands still, and the state of the arm."""
        with self._lock:
            now = self._clock.now()
            return now, self._clock.stands, self._settling_at(now)

    def record(self) -> Any:
        """Adds the median of the pictures of the window and returns it. Raises ValueError where the arm does not stand still or is
        not measured, and where the last sample is of these pictures."""
        with self._lock:
            state = self._settling_at(self._clock.now())
            require(state.state == "settled", f"not recorded: {state.reason}")
            pictures = self._watch.samples()
            again = self._samples and pictures[0].time <= self._samples[-1].time <= pictures[-1].time
            require(not again, "not recorded: the last sample is of these pictures; wait for "
                               f"{self._rules.window:g} s (~window_s)")
            self._samples.append(_core._median_of(pictures))
            return self._samples[-1]

    def add(self, sample: Any) -> None:
        with self._lock:
            self._samples.append(sample)

    def count(self) -> int:
        with self._lock:
            return len(self._samples)

    def keep(self, calibrated: str) -> None:
        """The text of the scene that was calibrated last."""
        with self._lock:
            self._calibrated = calibrated

    def clear(self) -> int:
        """Forgets samples, series and calibrated scene. How many samples there were."""
        with self._lock:
            count = len(self._samples)
            self._samples, self._series, self._calibrated, self._records_series = [], None, "", False
            return count

    def start_series(self) -> None:
        """Records a series of pressures and tips, until it is stopped; forgets the one before."""
        with self._lock:
            self._series, self._records_series = _core.SeriesRecord(len(self._scene.actuators)), True

    def stop_series(self) -> None:
        with self._lock:
            self._records_series = False

    def scene(self) -> Scene:
        with self._lock:
            return self._scene

    def recording(self) -> Recording:
        with self._lock:
            return Recording(self._scene, list(self._samples), self._series, self._calibrated)

    def adopt(self, scene: Scene) -> None:
        """Replaces the scene; the samples stay, the calibrated one does not."""
        with self._lock:
            self._scene, self._calibrated = scene, ""
            self._watch.wait_for_rest(scene)

    def _on_detections(self, message: TagDetections) -> None:
        tags = [(tag.id, tag.corners) for tag in message.tags if not tag.repeated]
        with self._lock:
            if not self._scene._has_bodies:
                self._watch.seen(self._scene, message.header.stamp.to_sec(), tags)

    def _on_bodies(self, message: BodyPoses) -> None:
        bodies = [(name, [pose.position.x, pose.position.y, pose.position.z, pose.orientation.x, pose.orientation.y,
                          pose.orientation.z, pose.orientation.w]) for name, pose in zip(message.name, message.pose)]
        with self._lock:
            if self._scene._has_bodies:
                self._watch.seen_bodies(self._scene, message.header.stamp.to_sec(), bodies)

    def _on_pressures(self, message: PressureArray, topic: str, hand: Callable[[float, np.ndarray], None]) -> None:
        """Hands them to the watch; warns where they are not of the scene."""
        time_s = message.header.stamp.to_sec()
        with self._lock:
            try:
                pressure = self._scene._reading(message.name, message.pressure)
            except ValueError as refusal:
                if self._foreign.add():
                    log.warning(f"{topic} does not match scene {self._scene.name}: {refusal} ({self._foreign.total} times so far)")
                return
            hand(time_s, pressure)
            if self._records_series and topic == "pressure_measured":
                self._series.measured(time_s, pressure)

    def _on_shape(self, message: ArmShape) -> None:
        tip = message.tip.position
        with self._lock:
            if self._records_series:
                self._series.seen(message.header.stamp.to_sec(), [tip.x, tip.y, tip.z])

    def _on_vision(self, message: VisionStatus) -> None:
        self._vision = message

    def _settling_at(self, now: float) -> Any:
        out = self._watch.at(now)
        # If no tags are seen, vision_status knows the cause.
        vision = self._vision if out.stale or out.state == "no_tags" else None
        if vision is not None and vision.state != VisionStatus.MEASURED:
            out.reason += f"; vision says: {quoted(vision.message, LONGEST_MESSAGE)}"
        return out
