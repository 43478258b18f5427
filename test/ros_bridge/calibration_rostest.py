#!/usr/bin/env python3
"""A whole calibration of a rig that is not what its scene says, and how one ends in trouble. Time is three times as fast."""
import os
import signal
import sys

import rospy
import rostest
import yaml
from actionlib_msgs.msg import GoalStatus
from std_srvs.srv import Trigger

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from calibration_rig import CalibrationRig  # noqa: E402
from helix_arm.msg import ModelError, RunCalibrationActionResult, SafetyState, TargetStatus  # noqa: E402
from helix_arm.srv import Reload  # noqa: E402

PLAN = [3e5, 0, 0, 0, 3e5, 0, 3e5, 3e5, 0, 0, 0, 3e5]  # whose pressures are high


def read(path):
    with open(path) as file:
        return yaml.safe_load(file)


class WholeCalibration(CalibrationRig):
    # Its arm is one that the fit can describe; its camera and tags are displaced.
    RIG = {"arm": {"K_gamma_scale": 0.6, "K_kappa_scale": 1.2, "length_scale": 1.01},
           "mounts": {"camera_translation_m": 0.004, "camera_rotation_deg": 0.5, "tag_translation_m": 0.001,
                      "tag_rotation_deg": 1, "seed": 11}}

    def run_plan(self, steps):
        """Runs through the plan, told step by step. The result, and the scene that it leaves."""
        first, out = len(self.targets), self.path("calibrated.yaml")
        self.send(out=out, fit=["stiffness", "length_scale", "placement"])
        result = self.assert_ends(GoalStatus.SUCCEEDED, deadline=100)
        self.assertTrue(result.success)
        self.assertEqual(result.out, out)
        self.assert_rest(first)
        last = self.progress[-1]
        self.assertEqual((last.step, last.steps, last.samples), (steps, steps, steps))
        self.assertEqual(last.state, "fitting")
        return result, read(out)

    def seen_tip_error(self):
        self.free_the_arm()
        moved = rospy.Time.now()
        # The calibration holds the arm for safety.commander_timeout_s after its last target.
        self.assert_wait(lambda: self.send_pressures([3.5e5, 0, 1e5]).outcome == TargetStatus.REACHED)
        error = self.errors.next(lambda error: (error.header.stamp - moved).to_sec() > 3)
        self.assertTrue(error)
        return error.tip_error

    def test_runs_through_its_plan_and_leaves_a_scene_that_predicts_better(self):
        self.errors = self.inbox("model_error", ModelError)
        result, calibrated = self.run_plan(12)
        # How much better it predicts is measured in accuracy/.
        self.assertTrue(result.message.startswith("tip error "), result.message)
        self.assertGreater(result.tip_error_before, 0.005)
        self.assertLess(result.tip_error_after, 0.5 * result.tip_error_before)
        self.assertEqual(calibrated["calibration"]["data"][0]["captures"], 12)
        self.assertEqual(len(result.names), len(result.values))
        k = result.names.index("length_scale")
        self.assertTrue(result.identifiable[k])
        self.assertLess(abs(result.values[k] - 1.01), 3 * result.standard_errors[k])
        self.save("saved.yaml")
        self.assertEqual(read(self.path("saved.yaml"))["arm"], calibrated["arm"])
        # The nodes go on with the new file, and their model is where the camera sees the arm.
        before = self.seen_tip_error()
        for name in ("pressure_command", "vision", "calibration"):
            answer = self.call("/%s/reload" % name, Reload, scene=self.path("saved.yaml"))
            self.assertTrue(answer.success, answer.message)
        self.assertLessEqual(self.seen_tip_error(), before / 2)


class CalibrationFaults(CalibrationRig):
    def start_run(self):
        """One that is well under way. Returns the number of targets before it."""
        self.free_the_arm()
        first = len(self.targets)
        self.send(fit=["K_kappa"], plan=PLAN)
        self.assertTrue(self.command.next(lambda command: command.pressure[0] > 2.9e5), self.calibration.output())
        return first

    def test_whatever_ends_a_run_leaves_the_arm_at_rest_and_says_why(self):
        def ask_for_rest():  # the stream of the run's targets does not undo it
            self.assertTrue(self.call("/pressure_command/rest", Trigger).success)

        for act, state, words, ramps in ((self.client.cancel_goal, GoalStatus.PREEMPTED, "cancelled", True),
                                         (ask_for_rest, GoalStatus.ABORTED, "brought the arm to rest", True),
                                         (lambda: self.rig.signal(signal.SIGINT), GoalStatus.ABORTED, "was not read", False)):
            first = self.start_run()
            act()
            self.assert_ends(state, words)
            self.assert_rest(first if ramps else None)

    def test_killed_it_leaves_an_arm_that_vents(self):
        self.start_run()
        self.calibration.signal(signal.SIGKILL)
        self.assertEqual(self.calibration.code(), -signal.SIGKILL)
        self.assert_wait(lambda: (self.safety[-1].state, self.safety[-1].cause) == (SafetyState.VENTED, "stale_target"))
        self.assert_rest()

    def test_without_the_node_that_asked_for_it_a_run_ends(self):
        """The client is another process, and killed."""
        results = self.inbox("calibration/run_calibration/result", RunCalibrationActionResult)
        self.free_the_arm()
        first = len(self.targets)
        client = self.run_node("", "pub", "/calibration/run_calibration/goal", "helix_arm/RunCalibrationActionGoal",
                               "{goal: {fit: [K_kappa], plan: %s}}" % PLAN, command=["rostopic"])
        self.assertTrue(self.command.next(lambda command: command.pressure[0] > 2.9e5), client.output())
        client.signal(signal.SIGKILL)
        self.assert_wait(lambda: results)
        self.assertEqual(results[-1].status.status, GoalStatus.ABORTED)
        self.assertIn("is gone or does not answer", results[-1].result.message)
        self.assert_rest(first)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "calibration", "__main__", sys.argv)
