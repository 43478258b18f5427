"""The node follow_path: sends a path file as a goal to visual_servo, and ends with it."""
from __future__ import annotations

import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import time
from typing import Any, Callable, List, Optional

import actionlib.action_client
import numpy as np
import rospy
from geometry_msgs.msg import Quaternion, Transform, Vector3
from trajectory_msgs.msg import MultiDOFJointTrajectoryPoint

from helix_arm import _core, run_record
from helix_arm.file_access import RECORDED_RUN, FileAccess, quoted
from helix_arm.jobs import PatientClient
from helix_arm.msg import ArmShape, FollowTipPathAction, FollowTipPathFeedback, FollowTipPathGoal, PressureArray
from helix_arm.node import DONE, FAILED, LONGEST_MESSAGE, FaultCount, Node, Parameters, end, listen, log, run

MOST_ACTUATORS = 100
LONGEST_NAME = 40  # of an actuator, a frame or a state
LONGEST_OUTCOME = 300
LAST_WORDS = 1.0  # of the topics that are recorded, after the end [s]
WORD_PERIOD = 1.0  # between two lines of the log [s]


def _plain(text: str, longest: int = LONGEST_NAME) -> str:
    """A name without what would end a cell or a line of a table."""
    return quoted(text, longest).replace(",", ";")


def _position_of(pose: Any) -> np.ndarray:
    return np.array([pose.position.x, pose.position.y, pose.position.z])


def _draw(report: Any, path: str) -> None:
    """Draws a report of a run to a PNG file."""
    beside = pathlib.Path(sys.argv[0]).resolve().parent / "plot_report"  # where it is installed
    script = beside if beside.exists() else pathlib.Path(_core._shipped("scripts", "")[0], "plot_report")
    with tempfile.TemporaryDirectory(prefix="helix_arm_report_") as folder:
        source, picture = pathlib.Path(folder, "report.json"), pathlib.Path(folder, "report.png")
        source.write_text(json.dumps(report))
        if subprocess.run([script, source, picture]).returncode != 0:
            raise RuntimeError(f"{picture} could not be drawn by {script}; install python3-matplotlib, or leave out ~figure")
        _core._write(path, picture.read_bytes())


class RunRecorder:
    """Records a goal: a row for each picture that the loop used. Subscribes to model, pressure_command and pressure_measured.

    table, figure: paths to write at the end; empty: none. path: file of the path, named in the record. end_time: time of its
    last point [s]. lock: held by whoever calls a method.
    """

    def __init__(self, table: str, figure: str, path: str, end_time: float, lock: Any) -> None:
        self._table, self._figure, self._path, self._end, self._lock = table, figure, path, end_time, lock
        self._frame = ""  # of the tips, by the first feedback
        self._names: List[str] = []  # of the actuators, by the first pressures
        self._record = run_record.TipRecord()
        self._foreign = FaultCount()
        self._subscribers = (
            listen("model", ArmShape, 1000, self._on_model),
            listen("pressure_command", PressureArray, 1000, lambda message: self._on_pressures(self._record.command, message)),
            listen("pressure_measured", PressureArray, 1000, lambda message: self._on_pressures(self._record.pressure, message)))

    def add(self, feedback: FollowTipPathFeedback) -> None:
        """Adds a row, unless a number in it is not finite."""
        # Without a prediction its pose is as empty as a new message's.
        q = feedback.predicted.orientation
        predicted = _position_of(feedback.predicted) if any((q.x, q.y, q.z, q.w)) else None
        row = run_record.Row(feedback.header.stamp.to_sec(), feedback.time_from_start.to_sec(), _position_of(feedback.desired),
                             _position_of(feedback.measured), predicted, feedback.sd, _plain(feedback.state))
        positions = [row.wanted, row.measured] + ([] if predicted is None else [predicted])
        if np.isfinite(positions).all() and math.isfinite(row.sd):
            self._frame = self._frame or _plain(feedback.header.frame_id)
            self._record.add(row)

    def is_complete(self) -> bool:
        """Whether all rows have got what other topics say of their times."""
        return self._record.is_complete()

    def write(self, outcome: str) -> None:
        """Writes the files. outcome: how the goal ended, in a line. Raises what prevents it."""
        rows = self._record.finish()
        if not rows:
            raise RuntimeError("nothing was recorded: the loop used no picture; look at vision_status and at the diagnostics of "
                               "visual_servo")
        if self._record.left_out > 0:
            log.warning(f"the last {self._record.left_out} pictures are not recorded: a record has at most {run_record.MOST_ROWS}")
        # Checked again: something else may be there by now.
        if self._table:
            table = self._comment(_plain(outcome, LONGEST_OUTCOME)) + run_record.csv_of(rows, len(self._names))
            _core._write(FileAccess({}).to_write("~record", self._table, ".csv"), table.encode())
            log.info(f"{len(rows)} pictures are recorded in {self._table}")
        if self._figure:
            name = quoted(os.path.basename(self._path))
            _draw(run_record.report_of(rows, name, self._names, self._end), FileAccess({}).to_write("~figure", self._figure, ".png"))
            log.info(f"they are drawn in {self._figure}")

    def _comment(self, outcome: str) -> str:
        now = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        return (f"# {RECORDED_RUN}{_plain(self._path, LONGEST_OUTCOME)}, {now}: {outcome}\n"
                f"# One row per picture that the loop used, at the picture's time. Tips seen from {self._frame}. time_s: since "
                "the start of the path;\n# model: by the scene alone; predicted: by the corrected model; command: in force; pressure: "
                f"measured. Actuators:{''.join(' ' + name for name in self._names)}.\n")

    def _on_model(self, model: ArmShape) -> None:
        tip = _position_of(model.tip)
        if np.isfinite(tip).all():
            with self._lock:
                self._record.model.add(model.header.stamp.to_sec(), tip)
                self._record.update()

    def _on_pressures(self, series: run_record.TimeSeries, message: PressureArray) -> None:
        count = len(message.pressure)
        names = [_plain(message.name[i]) if i < len(message.name) else str(i + 1) for i in range(min(count, MOST_ACTUATORS))]
        with self._lock:
            self._names = self._names or names
            if 0 < count <= MOST_ACTUATORS and names == self._names and np.isfinite(message.pressure).all():
                series.add(message.header.stamp.to_sec(), np.array(message.pressure))
                self._record.update()
            elif self._foreign.add():
                log.warning(f"pressures are not recorded ({self._foreign.total} so far): expected finite ones of "
                            f"{len(self._names)} actuators, in the order of the first message")


class FollowPath(Node):
    """A client of ~follow_tip_path. Logs the error of the tip once a second, and the result.

    Where the node is to end, it cancels the goal first. With ~record or ~figure it leaves what a RunRecorder writes, however the
    goal ends; a file that is there is replaced only if this package wrote it.

    Ends with 0 if the path was followed, or when asked to; 1 if it was refused or given up, there is no such action, the record
    cannot be written, or the ROS master is lost; 2 on a bad parameter or path file.
    """

    def __init__(self) -> None:
        reader = Parameters()
        self._path = reader.file("path", "config/paths", ".csv")
        self._action = rospy.resolve_name(reader.text("action", "visual_servo/follow_tip_path"))
        self._goal = FollowTipPathGoal(mode=FollowTipPathGoal.POSITION)
        self._goal.path.header.frame_id = reader.frame("frame")  # in which the path is seen; "": the arm's base
        self._goal.path_tolerance = 1e-3 * reader.number("path_tolerance_mm", 0.0, 0.0, 1000.0)  # 0: any distance [m]
        self._goal.goal_tolerance = 1e-3 * reader.number("goal_tolerance_mm", 0.0, 0.0, 1000.0)  # 0: 2 mm [m]
        self._goal.require_vision = reader.flag("require_vision", False)  # abort where the arm is not seen
        self._goal.hold_s = reader.number("hold_s", 0.0, 0.0, 86400.0)  # 0: the loop's own [s]
        self._patience = reader.number("patience_s", 30.0, 0.0, 3600.0)  # longest wait for the action [s]
        table, figure = reader.file_to_write("record", ".csv"), reader.file_to_write("figure", ".png")
        reader.finish()
        points = _core._tip_path(self._path)
        for point in points:
            place = Transform(Vector3(*point[1:].tolist()), Quaternion(0.0, 0.0, 0.0, 1.0))
            self._goal.path.points.append(MultiDOFJointTrajectoryPoint(
                transforms=[place], time_from_start=rospy.Duration(0, round(1e9 * point[0]))))
        self._seconds = points[-1][0]
        self._lock = threading.RLock()
        self._sent = self._done = self._cancelled = False
        self._outcome = "it was not ended"  # of the goal, for the record
        self._start, self._done_since, self._last_word = time.monotonic(), math.inf, -math.inf
        self._recorder: Optional[RunRecorder] = None
        if table or figure:
            self._recorder = RunRecorder(table, figure, self._path, self._seconds, self._lock)
        self._client = PatientClient(self._action, FollowTipPathAction)
        self._sent_goal: Optional[actionlib.ClientGoalHandle] = None

    def finish(self) -> int:
        with self._lock:
            if self._recorder is None or not self._sent:
                return self._verdict
            try:
                self._recorder.write(self._outcome)
            except Exception as fault:
                log.fatal(str(fault))
                return FAILED
            return self._verdict

    def may_end(self) -> bool:
        return not self._sent or self._done

    def turn(self) -> None:
        with self._lock:
            call = self._take_turn()
        # Without the lock: actionlib holds its own while it calls back.
        if call is not None:
            call()

    def _take_turn(self) -> Optional[Callable[[], None]]:
        connected = self._client.is_connected()
        if not self.may_end() and not connected:
            log.fatal(f"{self._action} has ended before the path")
            self._end_with(FAILED, "the action has ended before the path")
        if self._done:
            self._end_once_recorded()
        elif self._sent and not self._cancelled and end.made():
            self._cancelled = True
            return self._sent_goal.cancel
        elif not self._sent and connected:
            return self._send
        elif not self._sent and time.monotonic() - self._start > self._patience:
            log.fatal(f"no action {self._action} for {self._patience:g} s; is visual_servo up (closed_loop:=true of arm.launch)?")
            self._verdict = FAILED
            end.make()
        elif not self._sent:
            self._client.ask_again()
        return None

    def _send(self) -> None:
        self._sent = True
        log.info(f"{self._path}: {len(self._goal.path.points)} points, {self._seconds:.1f} s")
        self._sent_goal = self._client.send_goal(self._goal, self._on_transition, lambda _, feedback: self._on_feedback(feedback))

    def _on_feedback(self, feedback: FollowTipPathFeedback) -> None:
        with self._lock:
            if self._recorder is not None:
                self._recorder.add(feedback)
            if time.monotonic() - self._last_word < WORD_PERIOD:
                return
            self._last_word = time.monotonic()
            log.info(f"{feedback.time_from_start.to_sec():.1f} s: the tip is {1e3 * feedback.error:.2f} mm off, the loop "
                     f"{quoted(feedback.state)}")

    def _on_transition(self, goal: actionlib.ClientGoalHandle) -> None:
        if goal.get_comm_state() != actionlib.CommState.DONE:
            return
        state, result = goal.get_goal_status(), goal.get_result()
        with self._lock:
            if result is None:
                log.fatal("the goal has ended without a result; is visual_servo still running?")
                self._end_with(FAILED, "the goal has ended without a result")
                return
            message = quoted(result.error_string, LONGEST_MESSAGE)
            succeeded = state == actionlib.GoalStatus.SUCCEEDED
            if succeeded:
                log.info(f"the path was followed: {1e3 * result.rms_m:.2f} mm RMS, at most {1e3 * result.max_m:.2f} mm, in "
                         f"{result.pictures} pictures; {message}")
            elif self._cancelled:
                log.info(message)
            else:
                word = actionlib.action_client.get_name_of_constant(actionlib.GoalStatus, state)
                log.error(f"the path was not followed ({word}, error_code {result.error_code}): {message}")
            self._end_with(DONE if succeeded or self._cancelled else FAILED, message)

    def _end_with(self, verdict: int, outcome: str) -> None:
        self._done, self._done_since = True, time.monotonic()
        self._verdict, self._outcome = verdict, outcome
        self._end_once_recorded()

    def _end_once_recorded(self) -> None:
        """Readings that the last pictures wait for come within moments."""
        waits = self._recorder is not None and not self._recorder.is_complete()
        if not waits or time.monotonic() - self._done_since >= LAST_WORDS:
            end.make()


def main() -> None:
    run("follow_path", FollowPath)
