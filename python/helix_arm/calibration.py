"""The node calibration: records the arm where it stands still, and calibrates its scene."""
from __future__ import annotations

import contextlib
import math
import os
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Sequence

import numpy as np
import rospy

from helix_arm import _core
from helix_arm.arguments import integer, require
from helix_arm.calibration_run import ABORTED, COMPLETED, PREEMPTED, SETTLING, CalibrationRun, RunRules
from helix_arm.client_watch import ClientWatch
from helix_arm.contact_proof import ProofAction
from helix_arm.file_access import FileAccess, quoted
from helix_arm.jobs import ActionServer, JobSlot, answer, serve, text_of
from helix_arm.msg import (PressureArray, RunCalibrationAction, RunCalibrationFeedback, RunCalibrationGoal, RunCalibrationResult,
                           TargetStatus)
from helix_arm.node import LONGEST_MESSAGE, FaultCount, Node, Parameters, end, listen, log, run
from helix_arm.recorder import Recorder
from helix_arm.reload import SCENES, ReloadServer
from helix_arm.rest_request import CommandTrace, request_rest
from helix_arm.scene import REST_OFFSET, Scene
from helix_arm.srv import Calibrate, ClearSamples, FitContraction, RecordSample, Save

FEEDBACK_PERIOD = 0.2  # [s]
USUAL_CAPTURES = 3  # per pressure
BETWEEN_LOOKS = 0.005  # [s]
KINDS, BRANCHES = ("quintic", "table"), ("both", "rising", "falling")
SCENE_NOISES = (0.0, 0.0, 0.0, 0.0, REST_OFFSET)
# Faults that a walk does not find.
NO_FIT: Dict[str, Any] = {"held_out_error": None, "tip_error_before_m": None, "tip_error_after_m": None, "parameters": (),
                          "response_rms_m": None, "rms": None, "next_pressures_pa": None}

# Jobs of JobSlot, as another one is refused.
RUN = "run_calibration is running; wait for it, or cancel it first"
FIT = "a fit is running; wait for it"


def fill(out: Any, found: Dict[str, Any], path: str) -> None:
    """Fills the response of the service or the result of the action. path: of the calibrated scene."""
    def known(value: Optional[float]) -> float:
        return math.nan if value is None else value

    out.success, out.message, out.warnings = found["success"], found["message"], found["warnings"]
    out.held_out_error = known(found["held_out_error"])
    out.tip_error_before, out.tip_error_after = known(found["tip_error_before_m"]), known(found["tip_error_after_m"])
    out.out = path if found["success"] and found["scene_text"] else ""
    for field, key, kind in (("names", "name", str), ("units", "unit", str), ("initial", "initial", float), ("values", "value", float),
                             ("standard_errors", "standard_error", known), ("identifiable", "identifiable", bool)):
        setattr(out, field, [kind(one[key]) for one in found["parameters"]])
    if found["response_rms_m"] is not None:
        out.rms, out.error_unit = found["response_rms_m"], "m"
    if found["rms"] is not None:
        out.rms, out.error_unit = found["rms"], found["error_unit"]
    out.next_pressures = np.ravel(found["next_pressures_pa"] or []).tolist()


class Calibrator:
    """Reads data sets, fits the file of the node's scene, and writes the calibrated scene, which the recorder keeps. Nothing is
    fitted under a lock that a callback takes.

    data_folder, out_folder: data sets are read below both; scenes and samples are written below the second. They are made where
    they are missing. rules: when the arm of a recording stands still. reload: knows the file of the node's scene.
    """

    def __init__(self, data_folder: str, out_folder: str, rules: Any, recorder: Recorder, reload: ReloadServer) -> None:
        self._data = FileAccess({"~data_folder": data_folder, "~out_folder": out_folder})
        self._out = FileAccess({"~out_folder": out_folder})
        self._rules, self._recorder, self._reload = rules, recorder, reload
        for folder in (data_folder, out_folder):
            try:
                os.makedirs(folder, exist_ok=True)
            except OSError as fault:
                log.warning(f"the folder {folder} does not exist and cannot be created ({fault.strerror}): services cannot use "
                            "files in it")

    def table_path(self, data: str) -> str:
        """Path of a data set to read (.csv)."""
        return self._data.to_read("data", data, ".csv")

    def scene_path(self, out: str) -> str:
        """Where a calibrated scene goes; empty stays empty."""
        return out and self._out.to_write("out", out, ".yaml")

    def save_path(self, path: str) -> str:
        """Path of a scene or of samples to write."""
        return self._out.to_write("path", path, ".yaml", ".csv")

    def load(self, paths: Sequence[str]) -> Any:
        """Reads data sets of all kinds, recordings included."""
        allowed = [self._data.to_read("data", path, ".csv", ".bag") for path in paths]
        return self._recorder.scene()._load(allowed, self._rules)

    def check(self, fit: Sequence[str]) -> None:
        """Raises ValueError where the words are none of a request, or the scene has faults."""
        with self._reload.lock:
            scene = self._reload.scene
        # An unknown word raises; missing data does not.
        scene._calibrate(_core.CalibrationData(), fit, "", SCENE_NOISES, True)

    def calibrate(self, data: Any, out: str, cancelled: Callable[[], bool], fit: Sequence[str],
                  noises: Sequence[float] = SCENE_NOISES, contraction: str = "", **more: Any) -> Dict[str, Any]:
        """Fits, and writes the scene when there is a path and nobody has cancelled it meanwhile.

        out: as scene_path() returned it; checked again before the scene is written. cancelled: asked once, after the fit. more:
        as of Scene._calibrate().
        """
        scene = self._unchanged_scene()
        return self._keep(scene._calibrate(data, fit, contraction, noises, True, **more), out, cancelled)

    def commission(self, data: Any, out: str, cancelled: Callable[[], bool]) -> Dict[str, Any]:
        """Judges the captures of a walk; with a path, writes the scene without the leading mistake, as calibrate() does."""
        return self._keep({**NO_FIT, **self._unchanged_scene()._commission(data, bool(out))}, out, cancelled)

    def _unchanged_scene(self) -> Scene:
        """Raises ValueError where its file changed since it was loaded."""
        with self._reload.lock:
            scene = self._reload.scene
        require(_core._sha256(scene.path) == scene._sha256, f"{scene.path} changed on disk since it was loaded; call reload first")
        return scene

    def _keep(self, found: Dict[str, Any], out: str, cancelled: Callable[[], bool]) -> Dict[str, Any]:
        if not found["success"] or not found["scene_text"]:
            return found
        if cancelled():
            found["success"], found["message"] = False, "cancelled"
            return found
        self._recorder.keep(found["scene_text"])
        if out:
            try:
                _core._write(self.scene_path(out), found["scene_text"].encode())
            except Exception as fault:
                found["success"] = False
                found["message"] += f", but it is not saved: {fault}; call save with another path"
        return found


class RunAction:
    """Serves the action ~run_calibration in a thread of its own: forgets what was recorded, steps the arm through a plan of
    pressures and records it at each, ramps down, asks pressure_command to rest, if the arm follows it and no other goal waits, and
    calibrates. Where the node that sent the goal is gone, it ramps down at once.

    Publishes pressure_target during a run alone. Its lock is taken before that of Recorder. It orders the targets, too: none is
    published once another commander has the arm.
    """

    def __init__(self, rules: RunRules, rate: float, jobs: JobSlot, recorder: Recorder, calibrator: Calibrator) -> None:
        self._rules, self._period, self._jobs, self._recorder, self._calibrator = rules, 1.0 / rate, jobs, recorder, calibrator
        self._lock = threading.Lock()
        self._run: Optional[CalibrationRun] = None  # from the begin of a run to its result
        self._names: List[str] = []  # of the actuators of its arm
        self._waited = False  # for pictures, in its last turn
        self._trace = CommandTrace()
        self._stale_targets, self._faults = FaultCount(), FaultCount()
        self._client: Optional[ClientWatch] = None  # of the present run
        self._publisher = rospy.Publisher("pressure_target", PressureArray, queue_size=10, tcp_nodelay=True)
        self._subscriber = listen("target_status", TargetStatus, 100, self._on_status)
        self.action = ActionServer("run_calibration", RunCalibrationAction, self._on_goal)

    def _on_status(self, status: TargetStatus) -> None:
        with self._lock:
            self._trace.answered(status)
            if self._run is None or status.commander != rospy.get_name() or status.outcome != TargetStatus.DROPPED:
                return
            message = quoted(status.message, LONGEST_MESSAGE)
            if status.fault == "other_commander":
                self._run.yield_arm(message)
            elif status.fault != "stale":
                self._run.end(ABORTED, f"pressure_command refused a target: {message}")
            elif self._stale_targets.add():
                # The next target may be in time. If none is, the arm vents, and that ends the run.
                log.warning(message)

    # Thread of the action.

    def _on_goal(self, goal: RunCalibrationGoal) -> None:
        result, preempted = RunCalibrationResult(held_out_error=math.nan), False
        try:
            with contextlib.ExitStack() as job:
                def begin() -> None:
                    job.enter_context(self._jobs.claim(RUN))
                    self._begin(goal)
                    result.success, result.message = True, "begins"

                if answer("run_calibration", result, begin).success:
                    result.success = False
                    preempted = self._live(goal, result)
        except Exception as fault:
            result.success, result.message = False, text_of(fault)
            if self._faults.add():
                log.warning(f"a goal of run_calibration was dropped ({self._faults.total} so far): {result.message}")
        finally:
            with self._lock:
                self._run = None
        self.action.conclude(result, preempted)

    def _begin(self, goal: RunCalibrationGoal) -> None:
        """Raises ValueError with the reason where the run cannot begin."""
        self._calibrator.check(goal.fit)
        self._calibrator.scene_path(goal.out)  # otherwise refused only after a long run
        scene = self._recorder.scene()
        rules = RunRules(goal.captures_per_pressure or USUAL_CAPTURES, self._rules.ramp, self._rules.patience + scene._rest_time_s)
        rules.validate()
        integer(goal.apply_suspect, "apply_suspect", 0, 5)
        require(goal.loop or not _core._fits_response(goal.fit),
                "response is fitted to a series that only a run with loop records; set loop: true")
        require(self._publisher.get_num_connections() > 0, "pressure_target has no subscriber; is pressure_command running?")
        require(not end.made(), "the node is shutting down")
        require(scene._has_vision, f"scene {scene.name} has neither `camera` and `tags` nor `bodies`, so nothing can be recorded; add "
                "them to it")
        require(not goal.walk or not (goal.fit or goal.plan or goal.loop or goal.apply_suspect),
                "walk has a plan of its own and fits nothing; leave out fit, plan, loop and apply_suspect")
        plan = scene._walk_plan() if goal.walk else scene._plan(goal.plan, goal.loop)
        _, _, state = self._recorder.observe()
        require(not state.stale, state.reason)
        require(state.set_point is not None, "no pressure_command was received yet; is its node running?")
        with self._lock:
            lower, upper = scene.limits_pa.T
            self._names = scene.actuators
            self._run, self._waited = CalibrationRun(plan, np.clip(state.set_point, lower, upper), lower, rules), False
            self._trace = CommandTrace()
            self._recorder.clear()
            if goal.loop:
                self._recorder.start_series()

    def _live(self, goal: RunCalibrationGoal, result: RunCalibrationResult) -> bool:
        """Fills the result. Whether the goal was preempted."""
        self._client = self.action.watch_sender()
        try:
            self._play()
        finally:
            self._client.release()
            self._recorder.stop_series()
        if rospy.is_shutdown():
            return False
        self._rest()
        return self._conclude(goal, result)

    def _play(self) -> None:
        """Moves the arm until the run has ended, or ROS is shut down."""
        captures: List[Any] = []  # of this step
        due, told = time.monotonic(), -math.inf
        while not rospy.is_shutdown():
            feedback = self._turn(captures)
            if feedback is None:
                return
            now = time.monotonic()
            if now - told > FEEDBACK_PERIOD:
                told = now
                self.action.publish_feedback(feedback)
            due = max(due + self._period, now)
            time.sleep(max(0.0, due - time.monotonic()))

    def _turn(self, captures: List[Any]) -> Optional[RunCalibrationFeedback]:
        """captures: of this step so far; goes on. None if the run has ended, so that nothing was commanded."""
        with self._lock:
            run = self._run
            now, time_stands, state = self._recorder.observe()
            if self.action.is_preempt_requested():
                run.end(PREEMPTED, "cancelled")
            if end.made():
                run.end(ABORTED, "the node is shutting down")
            if self._client.is_gone():
                run.end(ABORTED, self._client.why_gone())
            if time_stands:
                run.end(ABORTED, "ROS time does not advance; is the node that publishes /clock running?")
            if run.ended:
                return None
            order = run.advance(now, state)
            target = PressureArray(name=self._names, pressure=order.pressure.tolist())
            self._trace.send(self._publisher, target)
            if order.capture is not None:
                captures.append(order.capture)
            if order.step_done:
                self._recorder.add(_core._median_of(captures))
                captures.clear()
            waits, told = run.waits_for_pictures, run.phase
            if waits or (run.phase == SETTLING and state.state != "settled"):
                told += f": {state.reason}"
            if waits and not self._waited:
                log.warning(f"run_calibration waits for pictures, at most {self._rules.patience:g} s (~patience_s): {state.reason}")
            self._waited = waits
            return RunCalibrationFeedback(step=run.step + 1, steps=run.steps, state=told, pressure=target.pressure,
                                          samples=self._recorder.count())

    def _rest(self) -> None:
        """Brings the arm to rest after a run, if it is still the run's and no other goal waits for it."""
        waits = True
        while waits:
            # Without a master, the call would block.
            if end.is_urgent() or rospy.is_shutdown():
                return
            with self._lock:
                if self.action.is_new_goal_available():
                    return
                waits = self._trace.awaits_answer()
                if not waits and not self._trace.commands() and not self._trace.was_rested():
                    return
            time.sleep(BETWEEN_LOOKS)
        request_rest()

    def _conclude(self, goal: RunCalibrationGoal, result: RunCalibrationResult) -> bool:
        """Calibrates where the run was completed. Whether the goal was preempted."""
        run = self._run
        result.message = run.reason
        if run.verdict != COMPLETED:
            log.warning(f"run_calibration: {result.message}")
            return run.verdict == PREEMPTED

        def fit() -> None:
            recording = self._recorder.recording()
            data = recording.data()
            self.action.publish_feedback(RunCalibrationFeedback(step=run.steps, steps=run.steps, state="fitting",
                                                                 samples=len(recording.samples)))
            out = self._calibrator.scene_path(goal.out)
            cancelled = self.action.is_preempt_requested
            fill(result, self._calibrator.commission(data, out, cancelled) if goal.walk else
                 self._calibrator.calibrate(data, out, cancelled, goal.fit, force=goal.force, apply_suspect=goal.apply_suspect), out)

        answer("run_calibration", result, fit)
        return self.action.is_preempt_requested()


def require_pneumatic(scene: Scene) -> Scene:
    faults = "".join(f"\n{name} is a tendon; expected muscles and bellows only" for name in scene._tendons)
    require(not faults, f"scene {scene.name} cannot be driven by pressure:{faults}")
    return scene


def word_of(what: str, given: str, words: Sequence[str]) -> str:
    """One of the words; the first where none is given."""
    require(not given or given in words, f"{what} is '{quoted(given)}'; expected {' or '.join(words)}")
    return given or words[0]


class Calibration(Node):
    """Records the arm where it stands still, and calibrates the scene with what was recorded or with data sets (docs/nodes.md).

    Preempted, without fresh measurements, where the arm does not settle, and when the node is to end, ~run_calibration ramps down
    and ends without a calibration; what was recorded stays. When another commander has the arm, it ends and leaves the arm to it.
    Ages and windows go by the stamps of messages and ROS time, so that simulated time may run fast. Where ROS time stands still the
    run ends, and ramps down by a steady clock.

    One service or ~reload is handled at a time, behind the lock of ReloadServer; run_calibration in a thread of its own. Locks in
    their order: ReloadServer, JobSlot or RunAction, Recorder.
    """

    def __init__(self) -> None:
        reader = Parameters()
        path = reader.file("scene", SCENES, ".yaml")  # as pressure_command's
        settle = _core.SettleRules()  # when the arm stands still, and when measurements are stale
        rules = RunRules()  # of run_calibration, except the captures
        rate = reader.number("rate", 50.0, 5, 1000)  # of targets in run_calibration [Hz]
        scene_folder = reader.folder("scene_folder")
        data_folder, out_folder = reader.folder("data_folder"), reader.folder("out_folder")
        settle.pressure_tolerance = 1e3 * reader.number("pressure_tolerance_kpa", 1e-3 * settle.pressure_tolerance, 0.01, 100)
        settle.corner_tolerance = reader.number("corner_tolerance_px", settle.corner_tolerance, 0.01, 100)
        settle.body_tolerance = 1e-3 * reader.number("body_tolerance_mm", 1e3 * settle.body_tolerance, 0.001, 100)
        settle.window = reader.number("window_s", settle.window, 0.05, 60)
        settle.max_age = reader.number("max_age_s", settle.max_age, 0.05, 60)
        rules.ramp = 1e3 * reader.number("ramp_kpa_s", 1e-3 * rules.ramp, 0.1, 10000)
        rules.patience = reader.number("patience_s", rules.patience, 0.1, 3600)
        follow = rospy.resolve_name(reader.text("follow_action", "visual_servo/follow_tip_path"))  # of prove_contact
        reader.finish()
        self._jobs = JobSlot()
        with self._jobs.claim("the node is starting; call again"):
            self._reload = ReloadServer(path, scene_folder, self._adopt)
            scene = require_pneumatic(self._reload.scene)
            self._recorder = Recorder(scene, settle)
            self._calibrator = Calibrator(data_folder, out_folder, settle, self._recorder, self._reload)
        self._run = RunAction(rules, rate, self._jobs, self._recorder, self._calibrator)
        self._proof = ProofAction(follow, self._jobs, self._reload, self._calibrator.scene_path)
        lock = self._reload.lock  # while run_calibration is under way, each is refused
        self._services = (
            serve("calibrate", Calibrate, self._calibrate, lock, held_out_error=math.nan), serve("save", Save, self._save, lock),
            serve("fit_contraction", FitContraction, self._fit_contraction, lock, hysteresis=math.nan),
            serve("record_sample", RecordSample, self._record, lock), serve("clear_samples", ClearSamples, self._clear, lock))
        log.info(f"{scene.name}: " + ("ready to record and to calibrate" if scene._has_vision else
                                      "ready to calibrate from data sets; its scene lacks `camera` and `tags`, or `bodies`, so nothing "
                                      "can be recorded"))

    def turn(self) -> None:
        self._recorder.tick()

    def may_end(self) -> bool:
        """Not while run_calibration is under way: the arm is to be ramped down first. Nor before a job is answered."""
        return not (self._run.action.is_busy or self._proof.action.is_busy or self._jobs.job)

    def _calibrate(self, request: Any, response: Any) -> None:
        out = self._calibrator.scene_path(request.out)
        noises = (request.curvature_noise_rad, request.corner_noise_px, request.position_noise_m, request.rotation_noise_rad,
                  max(request.rest_offset_m, 0.0) if request.rest_offset_m else REST_OFFSET)
        with self._jobs.claim(FIT):
            data = self._calibrator.load(request.data) if request.data else self._recorder.recording().data()
            fill(response, self._calibrator.calibrate(data, out, lambda: False, request.fit, noises, force=request.force,
                                                      apply_suspect=request.apply_suspect), out)

    def _fit_contraction(self, request: Any, response: Any) -> None:
        kind, branch = word_of("kind", request.kind, KINDS), word_of("branch", request.branch, BRANCHES)
        path, out = self._calibrator.table_path(request.data), self._calibrator.scene_path(request.out)
        with self._jobs.claim(FIT):
            data = self._calibrator.load([path])
            require(data.has_lengths, f"{path} holds no free lengths; expected the columns pressure_kpa and length_m")
            found = self._calibrator.calibrate(data, out, lambda: False, ["contraction"], contraction=request.contraction,
                                               curve=kind, branch=branch)
        response.success, response.message = found["success"], found["message"]
        response.out = out if found["success"] else ""
        for curve in found["contractions"][:1]:
            if not curve["found"]:
                continue
            response.rms, response.constrained = curve["rms_m"], curve["constrained"]
            if curve["hysteresis_m"] is not None:
                response.hysteresis = curve["hysteresis_m"]
            if curve["is_quintic"]:
                response.coefficients, response.reference_pressure = curve["coefficients_m"], curve["reference_pressure_pa"]
            else:
                response.pressures, response.lengths = curve["pressures_pa"], curve["lengths_m"]

    def _record(self, _: Any, response: Any) -> None:
        response.samples = self._recorder.count()
        with self._jobs.idle():
            sample = self._recorder.record()
            response.samples = self._recorder.count()
        response.tags, response.pressure = sample.tags, sample.pressure.tolist()
        response.success, response.message = True, f"sample {response.samples} with {response.tags} tags"

    def _clear(self, _: Any, response: Any) -> None:
        with self._jobs.idle():
            response.cleared = self._recorder.clear()
        response.success, response.message = True, f"{response.cleared} samples cleared"

    def _save(self, request: Any, response: Any) -> None:
        path = self._calibrator.save_path(request.path)
        with self._jobs.idle():
            recording = self._recorder.recording()
        if path.endswith(".csv"):
            require(bool(recording.samples), "no sample was recorded; call record_sample first")
            text = recording.table()
            message = f"{len(recording.samples)} samples in {path}"
            rows, series = recording.series_table()
            if rows > 0:
                beside = self._calibrator.save_path(path[:-len(".csv")] + "_series.csv")
                _core._write(beside, series.encode())
                message += f" and a series of {rows} rows in {beside}"
        else:
            require(bool(recording.calibrated), "nothing was calibrated; call calibrate first")
            text, message = recording.calibrated, f"the last calibration of {recording.scene.name} in {path}"
        _core._write(path, text.encode())
        response.success, response.message = True, message

    def _adopt(self, scene: Scene) -> None:
        with self._jobs.idle():
            self._recorder.adopt(require_pneumatic(scene))


def main() -> None:
    run("calibration", Calibration)
