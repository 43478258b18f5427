"""The node experiment: measures a running arm (docs/experiments.md)."""
from __future__ import annotations

import glob
import json
import math
import os
import time
from pathlib import Path
from typing import List

from helix_arm.arguments import require
from helix_arm.calibration import require_pneumatic
from helix_arm.client_watch import ClientWatch
from helix_arm.experiments import EXPERIMENTS, Options, Progress, Result, measure
from helix_arm.experiments.run import ALL, estimate_s, measure_all
from helix_arm.file_access import FileAccess, quoted
from helix_arm.jobs import ActionServer, JobSlot, answer
from helix_arm.live_rig import LiveRig
from helix_arm.msg import RunExperimentAction, RunExperimentFeedback, RunExperimentGoal, RunExperimentResult
from helix_arm.node import Node, Parameters, run
from helix_arm.reload import SCENES, ReloadServer
from helix_arm.scene import Scene

FEEDBACK_PERIOD = 0.2  # [s]


class Experiment(Node):
    """Serves ~run_experiment. A goal drives the arm as long as the node that sent it is there. Where it is cancelled, or the arm
    cannot go on, the arm is vented, what was recorded is kept, and the next goal for the same folder goes on there."""

    period = 0.01

    def __init__(self) -> None:
        reader = Parameters()
        path = reader.file("scene", SCENES, ".yaml")  # as pressure_command's
        scene_folder, self._out = reader.folder("scene_folder"), reader.folder("out_folder")
        rate = reader.number("picture_rate", 15.0, 0.1, 1000.0)  # at which `measured` comes [Hz]
        reader.finish()
        self._jobs, self._told = JobSlot(), -math.inf
        self._reload = ReloadServer(path, scene_folder, self._adopt)
        self._rig = LiveRig(require_pneumatic(self._reload.scene), rate)
        self._server = ActionServer("run_experiment", RunExperimentAction, self._on_goal)

    def turn(self) -> None:
        self._rig.turn()

    def may_end(self) -> bool:
        return not self._server.is_busy

    def _adopt(self, scene: Scene) -> None:
        with self._jobs.idle():
            self._rig.adopt(require_pneumatic(scene))

    def _on_goal(self, goal: RunExperimentGoal) -> None:
        result, client = RunExperimentResult(), self._server.watch_sender()

        def body() -> None:
            with self._jobs.claim("run_experiment is running; wait for it, or cancel it first"):
                try:
                    self._measure(goal, result, client)
                finally:
                    self._rig.release()

        answer("run_experiment", result, body)
        client.release()
        self._server.conclude(result, self._server.is_preempt_requested())

    def _measure(self, goal: RunExperimentGoal, result: RunExperimentResult, client: ClientWatch) -> None:
        scene, rig = self._reload.scene, self._rig
        names = [*EXPERIMENTS] if goal.name == ALL else [goal.name]
        require(set(names) <= set(EXPERIMENTS), f"name is '{quoted(goal.name)}'; expected {', '.join(EXPERIMENTS)} or {ALL}")
        for one in goal.actuators:
            require(one in scene.actuators, f"actuators has '{quoted(one)}'; expected some of {', '.join(scene.actuators)}")
        require(goal.repeats != 1, "repeats is 1; expected a number >= 2, or 0 for the protocol's")
        require(goal.hold_s == 0 or 0.5 <= goal.hold_s <= 3600, f"hold_s is {goal.hold_s:g}; expected 0.5 to 3600 s, or 0")
        options = Options([scene.actuators.index(one) for one in goal.actuators or scene.actuators], goal.repeats or None,
                          goal.hold_s or None)
        result.out, rig.ignore_contacts = self._folder_of(goal, scene), goal.ignore_contacts
        times = [estimate_s([one], scene, rig, options) for one in names]

        def stop() -> str:
            return "cancelled" if self._server.is_preempt_requested() else client.why_gone() if client.is_gone() else ""

        def tell(progress: Progress) -> None:
            if time.monotonic() - self._told < FEEDBACK_PERIOD:
                return
            self._told = time.monotonic()
            done = sum(times[:names.index(progress.experiment)]) + progress.done_s
            self._server.publish_feedback(RunExperimentFeedback(f"{progress.experiment} {progress.trial}", done / sum(times),
                                                                sum(times) - done))

        if goal.name == ALL:
            results = measure_all(scene, rig, Path(result.out), options, stop, tell)
        else:
            results = [measure(goal.name, scene, rig, result.out, options, stop=stop, tell=tell)]
        _fill(result, results, goal.name)

    def _folder_of(self, goal: RunExperimentGoal, scene: Scene) -> str:
        if goal.out:
            return FileAccess({"~out_folder": self._out}).folder("out", goal.out)
        start = os.path.join(self._out, f"experiment_{goal.name}_{scene._sha256[:8]}_")
        last = max(glob.glob(glob.escape(start) + "*"), default="")
        document = Path(last, f"{goal.name}.json")
        goes_on = last and not (document.exists() and not json.loads(document.read_text())["ended"])
        return last if goes_on else start + time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())


def _fill(out: RunExperimentResult, results: List[Result], name: str) -> None:
    figures = [(result.experiment, one) for result in results for one in result.figures]
    out.names = [one.name if name != ALL else f"{experiment} {one.name}" for experiment, one in figures]
    out.symbols, out.units = [one.symbol for _, one in figures], [one.unit for _, one in figures]
    out.values = [math.nan if one.value is None else one.value for _, one in figures]
    out.standard_errors = [math.nan if one.standard_error is None else one.standard_error for _, one in figures]
    out.sheet, ended = os.path.join(out.out, f"{name}.pdf"), results[-1].ended
    out.success = not ended
    out.message = f"{ended}; what was recorded is in {out.out}" if ended else f"{len(figures)} figures of {name}"


def main() -> None:
    run("experiment", Experiment)
