#!/usr/bin/env python3
"""The series node: plays its rows in order, ends without a fault, and gives way to others."""
import itertools
import os
import sys

import rospy
import rostest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "support"))
from helix_arm.msg import PressureArray, SafetyState, TargetStatus  # noqa: E402
from processes import SOURCE  # noqa: E402
from ros_case import RosCase  # noqa: E402

BRISK = SOURCE + "/test/ros_bridge/scenes/brisk.yaml"
THREE_ROWS = ("_data:=" + SOURCE + "/test/ros_bridge/series.csv", "_ramp_s:=0.2", "_hold_s:=0.5")


class Series(RosCase):
    def test_plays_its_rows_in_order_and_ends(self):
        """No target of this test would be a command, too, and hold the lease against the series."""
        commands = self.inbox("/replay/pressure_command", PressureArray)
        self.assert_wait(lambda: commands)
        series = self.run_node("pressure_series", "__ns:=replay", "_scene:=" + BRISK, *THREE_ROWS)
        self.assertEqual(series.code(), 0, series.output())
        for words in ("row 3 of 3", "no column for muscle_4, muscle_5, muscle_6, muscle_7"):
            self.assertIn(words, series.output())
        rows = [[1e5, 0, 5e4] + 4 * [0], [0, 2e5, 5e4] + 4 * [0], 3 * [3e4] + 4 * [0]]
        played = [list(command.pressure) for command in commands]
        self.assertEqual([row for row, _ in itertools.groupby(row for row in played if row in rows)], rows)

    def test_yields_to_another_commander_and_continues_afterwards(self):
        answers = self.inbox("/yield/target_status", TargetStatus)
        publisher = rospy.Publisher("/yield/pressure_target", PressureArray, queue_size=10)

        def is_of_series(answer):
            return answer.commander == "/yield/pressure_series" and answer.outcome == TargetStatus.REACHED

        self.assertTrue(answers.next(is_of_series))
        target = PressureArray(pressure=7 * [1e5])
        self.assert_wait(lambda: answers.answer_to(publisher, target, 0.2).outcome == TargetStatus.REACHED)
        self.assertTrue(answers.next(is_of_series))


class SeriesEnd(RosCase):
    def test_after_its_last_row_the_arm_rests_without_a_fault(self):
        """An arm of its own, whose commander may be silent for so long that only what the series says at its end brings it to
        rest."""
        scene = "_scene:=" + self.scene_with(BRISK, {"safety.target_timeout_s": 100, "safety.slew_kpa_s": 500})
        safety, measured = self.inbox("/end/safety_state", SafetyState), self.inbox("/end/pressure_measured", PressureArray)
        arm = self.run_node("pressure_command", "__ns:=end", scene, "_frame_prefix:=end_")
        self.assert_wait(lambda: safety and measured)
        series = self.run_node("pressure_series", "__ns:=end", scene, *THREE_ROWS)
        self.assertEqual(series.code(), 0, series.output())
        self.assert_wait(lambda: any("disabled: at rest" in state.reason for state in safety))
        self.assertEqual({state.cause for state in safety}, {"none"})
        self.assertIn("enabled: ramps down to rest", [state.reason for state in safety])
        self.assertNotRegex(arm.output(), "WARN|ERROR|FATAL")


if __name__ == "__main__":
    rostest.rosrun("helix_arm", "series", "__main__", sys.argv)
