#!/usr/bin/env python3
"""Experiments on a running arm: what they leave, that they go on, and that nothing stands where they end."""
import csv
import glob
import os
import signal
import sys

import actionlib
import numpy as np
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from std_srvs.srv import SetBool, Trigger

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import (ArmShape, ExternalLoad, LoopStatus, PressureArray, RunExperimentAction,  # noqa: E402
                           RunExperimentGoal, SafetyState)
from ros_case import Inbox, RosCase, wait_for  # noqa: E402
from test_size import full_size_only  # noqa: E402


def rows_of(path):
    with open(path) as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


class Experiments(RosCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.safety, cls.command = Inbox("safety_state", SafetyState), Inbox("pressure_command", PressureArray)
        cls.measured = Inbox("measured", ArmShape)

    def setUp(self):
        self.feedback, self.done = [], False
        self.vision = self.run_node("vision", "_scene:=demo", "_source:=image/compressed")
        self.node = self.run_node("experiment", "_scene:=demo", f"_out_folder:={self.path('')}", f"_scene_folder:={self.path('')}")
        self.client = actionlib.SimpleActionClient("experiment/run_experiment", RunExperimentAction)
        self.assertTrue(self.client.wait_for_server(rospy.Duration(30)), self.node.output())
        first = len(self.measured)
        self.assert_wait(lambda: len(self.measured) > first)
        rospy.wait_for_service("pressure_command/enable", 60)
        self.enable()

    def why(self):
        return self.node.output(), self.safety[-1:], self.feedback[-1:]

    def state(self):
        return self.safety[-1].state if self.safety else ""

    def enable(self):
        """Refused while pressure remains."""
        call = rospy.ServiceProxy("pressure_command/enable", Trigger)
        self.assert_wait(lambda: wait_for(lambda: self.state() == SafetyState.ENABLED, 0.2) or not call())

    def send(self, **fields):
        self.feedback = []
        self.client.send_goal(RunExperimentGoal(name="step", repeats=2, hold_s=0.5, **fields), feedback_cb=self.feedback.append)

    def ended(self, deadline=60):
        self.assert_wait(lambda: self.client.gh.get_comm_state() == actionlib.CommState.DONE, deadline)
        return self.client.get_state(), self.client.get_result()

    def under_way(self, trial, **fields):
        """A goal of which this trial is being recorded, with pressure on."""
        self.send(**fields)
        self.assert_wait(lambda: self.feedback and self.feedback[-1].doing == f"step {trial}" and
                         max(self.command[-1].pressure) > 1e5 and glob.glob(self.path(f"*/raw/step-{trial}.part.csv")), 40)

    def assert_vented(self):
        self.assert_wait(lambda: max(self.command[-1].pressure) == 0 and self.state() != SafetyState.ENABLED)

    def test_a_run_that_was_stopped_goes_on_and_leaves_figures_and_a_sheet(self):
        both = ["muscle_1", "muscle_3"]
        self.under_way("muscle_3", actuators=both)
        self.client.cancel_goal()
        state, stopped = self.ended()
        self.assertEqual((state, stopped.success), (GoalStatus.PREEMPTED, False))
        self.assertIn("muscle_3: cancelled", stopped.message)
        self.assert_vented()
        self.assertEqual(self.state(), SafetyState.VENTED)
        self.assertGreater(len(rows_of(os.path.join(stopped.out, "raw", "step-muscle_3.part.csv"))), 50)
        self.enable()
        self.send(actuators=both)
        state, result = self.ended()
        self.assertEqual((state, result.out), (GoalStatus.SUCCEEDED, stopped.out), result.message)
        self.assertEqual({one.doing for one in self.feedback}, {"step muscle_3"}, "the first is not measured again")
        figures = dict(zip(result.names, result.values))
        self.assertTrue(any("muscle_3" in name and 0 < value < 5 for name, value in figures.items()), figures)
        rows = rows_of(os.path.join(result.out, "raw", "step-muscle_1.csv"))
        # The readings follow the command, row by row.
        self.assertGreater(np.corrcoef(*([float(row[f"{what}_1_kpa"]) for row in rows] for what in ("commanded", "pressure")))[0, 1], 0.9)
        # At its end the arm goes to rest, without a fault.
        self.assert_wait(lambda: self.state() == SafetyState.DISABLED)
        self.assertEqual(self.safety[-1].cause, "none")

    def test_what_happens_to_the_arm_ends_the_run_and_vents(self):
        stop = rospy.ServiceProxy("pressure_command/emergency_stop", SetBool)
        self.under_way("muscle_1")
        self.assertTrue(stop(True).success)
        state, result = self.ended()
        self.assertEqual(state, GoalStatus.ABORTED)
        self.assertIn("emergency", result.message)
        self.assertTrue(stop(False).success)
        self.send()
        self.assertIn("enable", self.ended()[1].message)

    @full_size_only
    def test_contact_a_leak_and_loss_of_sight_end_the_run(self):
        load = rospy.Publisher("external_load", ExternalLoad, queue_size=1, latch=True)
        self.under_way("muscle_1")
        load.publish(ExternalLoad(state=ExternalLoad.CONTACT, message="contact with the arm; clear it"))
        self.assertIn("contact with the arm", self.ended()[1].message)
        self.assert_vented()
        load.publish(ExternalLoad(state=ExternalLoad.NONE))
        loop = rospy.Publisher("loop_status", LoopStatus, queue_size=1, latch=True)
        self.enable()
        self.under_way("muscle_1")
        loop.publish(LoopStatus(message="suspect 1: pressure_gain (muscle_1) explains 90 %: it leaks; the loop has no target"))
        self.assertIn("it leaks", self.ended()[1].message)
        loop.publish(LoopStatus(message="the loop has no target"))
        self.enable()
        self.under_way("muscle_1")
        self.vision.__exit__()
        self.assertIn("was not seen for 2 s", self.ended()[1].message)
        self.assert_vented()

    def test_killed_at_any_moment_no_pressure_stands_and_the_rows_are_there(self):
        self.under_way("muscle_1")
        part, = glob.glob(self.path("*/raw/*.part.csv"))
        self.assert_wait(lambda: len(rows_of(part)) > 20)
        self.node.signal(signal.SIGKILL)
        self.assert_vented()
        self.assertEqual(self.safety[-1].cause, "stale_target")
        self.assertGreater(len(rows_of(part)), 20)


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "experiment", Experiments, sys.argv)
