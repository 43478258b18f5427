#!/usr/bin/env python3
"""How a calibration ends in trouble: with a reason, down a ramp, at rest. Time is three times as fast."""
import os
import signal
import sys

import rostest
from actionlib_msgs.msg import GoalStatus
from std_srvs.srv import Trigger

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from calibration_rig import CalibrationRig  # noqa: E402
from helix_arm.msg import RunCalibrationActionResult, SafetyState  # noqa: E402
from test_size import full_size_only  # noqa: E402

PLAN = [3e5, 0, 0, 0, 3e5, 0, 3e5, 3e5, 0, 0, 0, 3e5]  # whose pressures are high


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

    @full_size_only
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
    rostest.rosrun("helix_arm", "calibration_faults", CalibrationFaults, sys.argv)
