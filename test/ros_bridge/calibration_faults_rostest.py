#!/usr/bin/env python3
"""What a calibration refuses, and how it ends in trouble: with a reason, down a ramp, at rest. Time is three times as fast."""
import os
import signal
import sys

import numpy as np
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from calibration_rig import CalibrationRig  # noqa: E402
from helix_arm.msg import RunCalibrationActionResult, SafetyState, TargetStatus  # noqa: E402
from helix_arm.srv import Calibrate, ClearSamples, FitContraction, RecordSample, Save  # noqa: E402
from processes import SOURCE, wait_for  # noqa: E402
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

    def assert_refused(self, response, words):
        self.assertFalse(response.success, words)
        self.assertIn(words, response.message)
        self.assertNotIn("root:", response.message)

    def test_invalid_requests_are_answered_with_the_fault(self):
        self.assert_refused(self.call("calibrate", Calibrate), "no sample was recorded")
        series, no_bag = self.path("series.csv"), self.path("no.bag")
        for path, text in ((series, "pressure_1_kpa,pressure_2_kpa,pressure_3_kpa\n0,0,0\n"), (no_bag, "pressure_kpa,length_m\n0,0.4\n")):
            with open(path, "w") as file:
                file.write(text)
        for file, words in ((series, series), ("relative.csv", "absolute path"), ("/no/such.csv", "/no/such.csv"),
                            ("/no/such.bag", "/no/such.bag"), (no_bag, no_bag)):
            self.assert_refused(self.call("calibrate", Calibrate, data=[file]), words)
        for path, words in (("/tmp/samples.csv", "no sample was recorded"), ("/tmp/scene.yaml", "nothing was calibrated"),
                            ("scene.yaml", "absolute path")):
            self.assert_refused(self.call("save", Save, path=path), words)
        for kind, words in (("", "/no/such.csv"), ("cubic", "quintic or table")):
            self.assert_refused(self.call("fit_contraction", FitContraction, data="/no/such.csv", kind=kind), words)
        for words, fields in (("everything", {"fit": ["everything"]}), ("captures is 6", {"captures_per_pressure": 6}),
                              ("set loop: true", {"fit": ["response"]}), ("4 pressures for 3 actuators", {"plan": [1, 2, 3, 4]}),
                              ("step 2 of the plan", {"plan": [0, 0, 0, 9e5, 0, 0]}), ("one pressure", {"plan": [1e5, 0, 0]}),
                              ("/no/such/folder", {"out": "/no/such/folder/scene.yaml"}), ("apply_suspect is 6", {"apply_suspect": 6})):
            self.send(**dict({"fit": ["stiffness"], "captures_per_pressure": 1}, **fields))
            self.assert_refused(self.assert_ends(GoalStatus.ABORTED), words)
        self.assertFalse(any(self.command[-1].pressure))

    @full_size_only
    def test_files_are_read_and_written_in_their_folders_alone(self):
        """Any network peer can name paths. Which of them are taken is a law of FileAccess; here every service and the action goes
        by it, and no message contains a line of a file."""
        link, foreign = self.path("link.csv"), self.path("scene.yaml")  # another's: it was never calibrated
        os.symlink("/etc/passwd", link)
        with open(SOURCE + "/config/scenes/demo.yaml") as demo, open(foreign, "w") as file:
            text = demo.read()
            file.write(text)
        self.assert_refused(self.call("calibrate", Calibrate, data=[link]), "data is '")
        self.assert_refused(self.call("fit_contraction", FitContraction, data=link), "data is '")
        self.assert_refused(self.call("calibrate", Calibrate, out=foreign), "out is '")
        self.assert_refused(self.call("save", Save, path=foreign), "path is '")
        self.send(out=foreign)
        self.assert_refused(self.assert_ends(GoalStatus.ABORTED), "out is '")
        with open(foreign) as file:
            self.assertEqual(file.read(), text)
        # What the node itself wrote may be written again.
        self.record_when_settled(RecordSample)
        for _ in range(2):
            self.save("samples.csv")

    @full_size_only
    def test_a_sample_of_an_arm_that_moves_or_of_the_same_pictures_is_refused(self):
        self.record_when_settled(RecordSample)
        again = self.call("record_sample", RecordSample)
        self.assert_refused(again, "of these pictures")
        self.assertEqual(again.samples, 1)
        self.assertEqual(self.send_pressures([3e5, 0, 0]).outcome, TargetStatus.REACHED)
        self.assertTrue(self.measured.next(lambda measured: measured.pressure[0] > 2e5))
        moving = self.call("record_sample", RecordSample)
        self.assert_refused(moving, "not recorded: ")
        self.assertEqual(moving.samples, 1)
        settled = self.record_when_settled(RecordSample)
        self.assertEqual((settled.samples, len(settled.pressure)), (2, 3))
        self.assertGreaterEqual(settled.tags, 5)
        self.assertLess(abs(settled.pressure[0] - 3e5), 5e3)
        for cleared in (2, 0):
            self.assertEqual(self.call("clear_samples", ClearSamples).cleared, cleared)

    @full_size_only
    def test_a_sample_of_stale_measurements_is_refused(self):
        self.record_when_settled(RecordSample)
        clock = self.inbox("/clock", Clock)
        self.assert_wait(lambda: clock)
        self.rig.signal(signal.SIGSTOP)
        wait_for(lambda: False, 0.5)  # stopped for longer than a step may take
        stopped = len(clock)
        self.rig.signal(signal.SIGCONT)  # its time goes on where it stopped
        self.assert_wait(lambda: len(clock) > stopped + 10)
        self.assertLess(np.diff([message.clock.to_sec() for message in clock]).max(), 0.1)
        self.rig.signal(signal.SIGINT)
        self.assertEqual(self.rig.code(), 0)
        self.assert_wait(lambda: "the last are stamped" in self.call("record_sample", RecordSample).message)
        self.send()
        self.assert_ends(GoalStatus.ABORTED, "the last are stamped")

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

    @full_size_only
    def test_a_second_goal_replaces_the_first_after_rest(self):
        first = self.start_run()
        self.send(plan=[0, 0, 0, 0, 0, 1e5], captures_per_pressure=1, fit=["K_kappa"])
        self.assert_wait(self.client.get_result, 45)
        self.assert_rest(first)

    @full_size_only
    def test_asked_to_end_it_ramps_down_first(self):
        first = self.start_run()
        self.calibration.signal(signal.SIGINT)
        self.assertEqual(self.calibration.code(), 0, self.calibration.output())
        self.assert_rest(first)

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

    @full_size_only
    def test_to_another_commander_it_leaves_the_arm(self):
        self.assertEqual(self.send_pressures([0, 0, 1e5]).outcome, TargetStatus.REACHED)
        self.send()

        def is_left():
            answer = self.send_pressures([0, 0, 1e5])
            # Or the answer to the run's own target, which came first.
            self.assertTrue(answer.outcome == TargetStatus.REACHED or answer.commander != rospy.get_name(), answer)
            return self.is_done()

        self.assert_wait(is_left)
        self.assert_ends(GoalStatus.ABORTED, "commands the arm")
        self.assertEqual(self.send_pressures([0, 0, 0]).outcome, TargetStatus.REACHED)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "calibration_faults", CalibrationFaults, sys.argv)
