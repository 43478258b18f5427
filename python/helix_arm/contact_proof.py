"""The action ~prove_contact: which score motion alone reaches on an arm that nobody touches, and what follows for the scene."""
from __future__ import annotations

import math
import time
from typing import Any, Callable

import actionlib
import rospy
from geometry_msgs.msg import Quaternion, Transform, Twist, Vector3
from trajectory_msgs.msg import MultiDOFJointTrajectoryPoint

from helix_arm import _core
from helix_arm.arguments import require
from helix_arm.client_watch import ClientWatch
from helix_arm.file_access import quoted
from helix_arm.jobs import ActionServer, JobSlot, PatientClient, answer
from helix_arm.msg import (FollowTipPathAction, FollowTipPathFeedback, FollowTipPathGoal, FollowTipPathResult,
                           ProveContactAction, ProveContactFeedback, ProveContactGoal, ProveContactResult)
from helix_arm.node import LONGEST_MESSAGE, end
from helix_arm.reload import ReloadServer
from helix_arm.scene import Scene

USUAL_TIME, LONGEST_TIME = 400.0, 3600.0  # [s]
TOLERANCE = 0.05  # of an arm that is not calibrated [m]
PATIENCE = 5.0  # longest wait for the action that moves the arm [s]
BETWEEN_LOOKS = 0.02  # [s]
PROOF = "prove_contact is running; wait for it, or cancel it first"


def quiet_goal(scene: Scene, seconds: float, seed: int) -> FollowTipPathGoal:
    """Moves and rests over the workspace, without contacts."""
    goal = FollowTipPathGoal(mode=FollowTipPathGoal.POSITION, path_tolerance=TOLERANCE, goal_tolerance=TOLERANCE,
                             require_vision=True, ignore_contacts=True, hold_s=0.1)
    for row in scene._quiet_path(seconds, seed).tolist():
        place, motion = Transform(Vector3(*row[1:4]), Quaternion(0.0, 0.0, 0.0, 1.0)), Twist(linear=Vector3(*row[4:7]))
        goal.path.points.append(MultiDOFJointTrajectoryPoint(
            transforms=[place], velocities=[motion], time_from_start=rospy.Duration(0, round(1e9 * row[0]))))
    return goal


class ProofAction:
    """Serves ~prove_contact in a thread of its own: visual_servo moves the arm. Where the goal is cancelled, its sender is gone or
    this node is to end, the path is cancelled, and visual_servo brings the arm to rest.

    follow: name of the action that moves the arm. scene_path: of a scene to write, or raises ValueError.
    """

    def __init__(self, follow: str, jobs: JobSlot, reload: ReloadServer, scene_path: Callable[[str], str]) -> None:
        self._follow, self._jobs, self._reload, self._scene_path = follow, jobs, reload, scene_path
        self._client = PatientClient(follow, FollowTipPathAction)
        self.action = ActionServer("prove_contact", ProveContactAction, self._on_goal)

    def _on_goal(self, goal: ProveContactGoal) -> None:
        result = ProveContactResult(found_force=math.nan)
        answer("prove_contact", result, lambda: self._prove(goal, result))
        self.action.conclude(result, self.action.is_preempt_requested())

    def _prove(self, goal: ProveContactGoal, result: ProveContactResult) -> None:
        seconds = goal.seconds or USUAL_TIME
        require(0 < seconds <= LONGEST_TIME, f"seconds is {seconds:g}; expected more than 0, at most {LONGEST_TIME:g} s")
        self._scene_path(goal.out)  # otherwise refused only after a long run
        with self._reload.lock:
            scene = self._reload.scene
        require(scene._has_vision, f"scene {scene.name} has neither `camera` and `tags` nor `bodies`; expected them, as the loop needs "
                "them")
        with self._jobs.claim(PROOF):
            found = self._move(quiet_goal(scene, seconds, goal.seed))
        require(_core._sha256(scene.path) == scene._sha256, f"{scene.path} changed on disk since it was loaded; call reload first")
        proof = scene._contact_proof(found.quiet_score, found.quiet_s, found.quiet_unit_force)
        if goal.out:
            result.out = self._scene_path(goal.out)  # again: something else may be there by now
            _core._write(result.out, proof["scene_text"].encode())
        result.highest_score, result.watched_s = found.quiet_score, found.quiet_s
        result.contact_limit, result.on_contact, result.doubt = proof["contact_limit"], proof["on_contact"], proof["doubt"]
        result.found_force, result.normalised = proof["found_force"], proof["normalised"]
        result.success, result.message = True, (
            f"the highest score was {found.quiet_score:.1f}: contact_limit {result.contact_limit:g}, on_contact "
            f"{result.on_contact}" + (f", since {result.doubt}" if result.doubt else ""))

    def _move(self, path: FollowTipPathGoal) -> FollowTipPathResult:
        """Raises ValueError with the reason where the path was not followed to its end."""
        start = time.monotonic()
        while not self._client.is_connected():
            require(time.monotonic() - start < PATIENCE and not end.made(),
                    f"no action {self._follow}; is visual_servo up (closed_loop:=true of arm.launch)?")
            self._client.ask_again()
            time.sleep(BETWEEN_LOOKS)
        seconds = path.path.points[-1].time_from_start.to_sec()

        def tell(_: Any, feedback: FollowTipPathFeedback) -> None:
            self.action.publish_feedback(ProveContactFeedback(feedback.time_from_start.to_sec(), seconds, feedback.state))

        sender, mover = self.action.watch_sender(), ClientWatch(self._client.last_status_msg._connection_header["callerid"])
        moves = self._client.send_goal(path, feedback_cb=tell)
        why_not = ""
        try:
            while moves.get_comm_state() != actionlib.CommState.DONE:
                require(not mover.is_gone(), f"the node of {self._follow} has ended before the path")
                why = (sender.why_gone() if sender.is_gone() else "cancelled" if self.action.is_preempt_requested() else
                       "the node is shutting down" if end.made() else "")
                if why and not why_not:
                    why_not = why
                    moves.cancel()
                time.sleep(BETWEEN_LOOKS)
        finally:
            sender.release()
            mover.release()
        result = moves.get_result()
        succeeded = moves.get_goal_status() == actionlib.GoalStatus.SUCCEEDED
        require(succeeded and not why_not, why_not or "the arm did not follow the path of the proof: " +
                quoted(result.error_string, LONGEST_MESSAGE))
        return result
