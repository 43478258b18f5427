"""The run of a calibration: when it captures, what it waits for, and how it ends."""
import math
import unittest
from types import SimpleNamespace

import numpy as np
from helix_arm.calibration_run import ABORTED, COMPLETED, PREEMPTED, RAMPING, RETURNING, SETTLING, CalibrationRun, RunRules

TICK = 0.02
REST = np.zeros(2)
PLAN = np.array([[1e5, 0], [0, 2e5]])
RULES = RunRules(3, 1e5, 5.0)
PATIENCE_TICKS, RAMP_TICKS = 250, 50  # 5 s; 1 s for the first step


def state_of(state, set_point, reason="", last=None):
    """What is said of an arm that is at this set point."""
    return SimpleNamespace(state=state, set_point=set_point, reason=reason, last=last)


def sample(time, pressure):
    return SimpleNamespace(time=time, pressure=pressure)


class Arm:
    """At once where it is commanded to, and still so long after. Its camera is out from tick to tick, each included, counted from
    0."""

    def __init__(self, settling_time=0.5, unseen=(0, -1)):
        self.settling_time, self.unseen, self.pressure, self.tick = settling_time, unseen, None, -1

    def __call__(self, now, pressure):
        self.tick += 1
        if self.pressure is None or (self.pressure != pressure).any():
            self.since, self.pressure = now, pressure
        if self.unseen[0] <= self.tick <= self.unseen[1]:
            return state_of("unseen", pressure, "tag detections: the last are stamped 2.00 s before now")
        if now - self.since < self.settling_time:
            return state_of("moving", pressure, "it sways")
        return state_of("settled", pressure, last=sample(math.floor(10 * now) / 10, pressure))  # 10 Hz


class Play:
    """A run, and what it has commanded, with any arm."""

    def __init__(self, rules=RULES):
        self.run = CalibrationRun(PLAN, REST, REST, rules)
        self.now, self.commands, self.captures, self.steps_done = 100.0, [REST], [], 0

    @property
    def command(self):
        return self.commands[-1]

    def tick(self, state):
        """One tick in which the arm has this state."""
        self.now += TICK
        order = self.run.advance(self.now, state)
        self.commands.append(order.pressure)
        self.captures += [order.capture] if order.capture else []
        self.steps_done += order.step_done

    def go(self, arm, most_ticks=100000):
        """To the end, or for so many ticks. arm: its state, by time and command."""
        for _ in range(most_ticks):
            if self.run.ended:
                return
            self.tick(arm(self.now + TICK, self.command))


class CalibrationRunTest(unittest.TestCase):
    def assert_ends(self, play, verdict, reason):
        """It has ended at rest, without a jump."""
        self.assertTrue(play.run.ended)
        self.assertEqual(play.run.verdict, verdict)
        self.assertTrue(reason in play.run.reason if reason else not play.run.reason, play.run.reason)
        self.assertEqual(play.command.tolist(), REST.tolist())
        self.assertLessEqual(np.abs(np.diff(play.commands, axis=0)).max(), RULES.ramp * TICK * (1 + 1e-6))

    def test_captures_at_every_step_and_ends_at_rest(self):
        play = Play()
        play.go(Arm())
        self.assert_ends(play, COMPLETED, "")
        self.assertEqual(play.steps_done, 2)
        np.testing.assert_array_equal([one.pressure for one in play.captures], np.repeat(PLAN, 3, axis=0))
        self.assertGreater(np.diff([one.time for one in play.captures]).min(), 0, "same picture")

    def test_does_not_capture_before_the_command_is_in_force(self):
        play = Play()
        play.go(lambda now, _: state_of("settled", REST, last=sample(now, REST)))  # at the old set point
        self.assertEqual(play.captures, [])
        self.assert_ends(play, ABORTED, "does not follow")

    def test_a_step_that_does_not_settle_aborts_with_its_reason_and_ramps_down(self):
        play = Play()
        play.go(Arm(1e9))
        self.assert_ends(play, ABORTED, "step 1 has not settled within 5 s: it sways")
        self.assertAlmostEqual(TICK * len(play.commands), 7.0, delta=0.2)  # 1 s up, 5 s of patience, 1 s down

    def test_it_waits_for_a_camera_that_is_out_wherever_it_is(self):
        for begin in (0, RAMP_TICKS // 2, RAMP_TICKS + 5, RAMP_TICKS + 40):
            play = Play()
            play.go(Arm(unseen=(begin, begin + 150)))
            self.assert_ends(play, COMPLETED, "")
            self.assertEqual((len(play.captures), play.steps_done), (6, 2))

    def test_while_nothing_is_seen_the_pressures_stand_still(self):
        play, begin = Play(), RAMP_TICKS // 2
        play.go(Arm(unseen=(begin, begin + 100)), begin + 101)
        self.assertEqual(play.run.phase, RAMPING)
        self.assertTrue(play.run.waits_for_pictures)
        self.assertGreater(play.commands[begin].max(), 0)
        self.assertFalse(np.ptp(play.commands[begin:], axis=0).any())

    def test_a_camera_that_stays_out_ends_it_after_its_patience(self):
        for begin, words in ((RAMP_TICKS // 2, "has waited for pictures for 5 s"), (RAMP_TICKS + 5, "has not settled within 5 s")):
            play, arm = Play(), Arm(unseen=(begin, math.inf))
            play.go(arm, begin + PATIENCE_TICKS - 10)
            self.assertIn(play.run.phase, (RAMPING, SETTLING))
            before = len(play.commands)
            play.go(arm)
            self.assert_ends(play, ABORTED, "step 1 " + words)
            self.assertIn("tag detections: the last are", play.run.reason)
            self.assertLess(len(play.commands) - before, 100)  # 10 ticks of patience, and the ramp down of at most 1 s

    def test_its_return_does_not_wait_for_pictures_but_for_the_command(self):
        play = Play()
        play.run.end(PREEMPTED, "cancelled")
        for _ in range(20):
            play.tick(state_of("unseen", np.array([5e4, 0])))
        self.assertFalse(play.run.ended, "the command has not followed")
        play.tick(state_of("unseen", REST))
        self.assertTrue(play.run.ended)

    def test_stale_pressures_abort_at_once_and_ramp_down(self):
        play, reason = Play(), "measured pressures: the last are stamped 2.00 s before now"
        play.go(Arm(), 60)
        self.assertEqual(play.run.phase, SETTLING)
        play.go(lambda *_: state_of("stale", None, reason))
        self.assert_ends(play, ABORTED, reason)

    def test_preempted_it_ramps_down_from_wherever_it_is(self):
        for ticks in (10, 60, 140):
            play, arm = Play(), Arm()
            play.go(arm, ticks)
            captured = len(play.captures)
            play.run.end(PREEMPTED, "asked to")
            play.run.end(ABORTED, "later")
            play.go(arm)
            self.assert_ends(play, PREEMPTED, "asked to")
            self.assertEqual(len(play.captures), captured)

    def test_leaves_the_arm_to_another_commander(self):
        play = Play()
        play.go(Arm(), 60)
        play.run.yield_arm("the series commands the arm")
        self.assertEqual((play.run.ended, play.run.verdict, play.run.reason), (True, ABORTED, "the series commands the arm"))

    def test_where_time_goes_back_it_ends_and_ramps_down(self):
        for ticks in (5, 80):  # ramping, settling
            play = Play(RunRules(3, 1e5, 1e4))

            def restless(_, pressure):
                return state_of("moving", pressure)

            play.go(restless, ticks)
            self.assertGreater(play.command.max(), 0)
            play.now = 3.0
            play.go(restless, 1000)
            self.assert_ends(play, ABORTED, "time went back")

    def play_to_return(self, play, arm):
        """Until the last step is done."""
        while play.run.phase != RETURNING:
            self.assertLess(play.now, 200)
            play.go(arm, 1)

    def test_it_ends_once_the_command_has_followed_it_to_rest(self):
        """The next run begins where the command is, so it must not be above the rest any more."""
        play, arm, late = Play(), Arm(), np.array([5e4, 0])
        self.play_to_return(play, arm)

        def stays_late(now, _):
            return arm(now, late)

        while play.command.any():
            self.assertLess(play.now, 300)
            play.go(stays_late, 1)
        play.go(stays_late, 20)
        self.assertFalse(play.run.ended)
        play.go(arm, 1)
        self.assertTrue(play.run.ended)
        # A command that never follows holds it up for its patience only.
        stuck = Play()
        stuck.run.end(PREEMPTED, "cancelled")
        stuck.go(stays_late, PATIENCE_TICKS)
        self.assertFalse(stuck.run.ended)
        stuck.go(stays_late, 5)
        self.assertTrue(stuck.run.ended)


if __name__ == "__main__":
    unittest.main()
