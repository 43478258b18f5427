"""Steps an arm through a plan of pressures and decides when to capture it. Without ROS; time is an argument."""
from __future__ import annotations

import dataclasses
import math
from typing import Any, Optional

import numpy as np

from helix_arm.arguments import require

SAME_PRESSURE = 1.0  # commands are rounded in messages [Pa]
LONGEST_STEP = 0.1  # after a pause of the caller, a ramp continues without a jump [s]
MOST_CAPTURES = 5

RAMPING = "ramping"  # to the pressures of the step
SETTLING = "settling"  # waiting until they and the shape are at rest, then taking captures
RETURNING = "returning"  # down to rest
ENDED = "ended"

COMPLETED = "completed"  # all captures were taken
PREEMPTED = "preempted"  # it was asked to end
ABORTED = "aborted"  # a fault occurred


@dataclasses.dataclass
class RunRules:
    """Rules of a calibration run."""

    captures: int = 3  #: pictures of the arm at rest at each pressure, 1 to MOST_CAPTURES
    ramp: float = 1e5  #: maximum rate of change of a pressure, > 0 [Pa/s]
    patience: float = 30.0  #: longest wait for each capture, and for pictures on a ramp, > 0 [s]

    def validate(self) -> None:
        """Raises ValueError naming the value and its rule."""
        require(1 <= self.captures <= MOST_CAPTURES,
                f"a calibration run: captures is {self.captures}; expected 1 to {MOST_CAPTURES} per pressure")
        for name in ("ramp", "patience"):
            value = getattr(self, name)
            require(0 < value < math.inf, f"a calibration run: {name} is {value:g}; expected a finite value > 0")


@dataclasses.dataclass
class Order:
    """The next step."""

    pressure: np.ndarray  #: (n) to command [Pa]
    capture: Optional[Any] = None  #: the settling's last sample, to keep
    step_done: bool = False  #: it is the last one of its step


class CalibrationRun:
    """While pictures are missing, the pressures stand still; the run aborts after its patience. It ramps the pressures down to rest
    before it ends, except after yield_arm().

    plan: (steps, n) [Pa], at least one step. start: (n) the command in force [Pa]. rest: (n) final pressures [Pa]. Raises
    ValueError naming the value and its rule.
    """

    def __init__(self, plan: np.ndarray, start: np.ndarray, rest: np.ndarray, rules: RunRules) -> None:
        rules.validate()
        require(len(plan) > 0, "a calibration run without steps; expected at least one")
        require(plan.shape[1] == len(start) == len(rest), f"a plan of {plan.shape[1]} actuators, from {len(start)} pressures to "
                f"{len(rest)}; expected those of one arm")
        require(all(np.isfinite(pressures).all() for pressures in (plan, start, rest)),
                "a calibration run with pressures that are not finite")
        self._plan, self._pressure, self._rest, self._rules = plan, start, rest, rules
        self.phase = RAMPING
        self.verdict, self.reason = COMPLETED, ""  # valid once it is returning or has ended
        self.step, self.steps = 0, len(plan)  # the step is counted from 0
        self._captures = 0  # of this step, so far
        self._last_capture = -math.inf  # stamp of its picture
        self._last_time: Optional[float] = None
        self._settling_since = 0.0
        self._unseen_since: Optional[float] = None  # while ramping or settling
        self._returned_at: Optional[float] = None  # time when the ramp down was over

    @property
    def ended(self) -> bool:
        return self.phase == ENDED

    @property
    def waits_for_pictures(self) -> bool:
        return self._unseen_since is not None

    def advance(self, now: float, settling: Any) -> Order:
        """now: monotonic time, on the clock of the stamps [s]. settling: state of the arm; stale pressures abort the run."""
        if self._last_time is not None and now < self._last_time:
            self.end(ABORTED, f"time went back by {self._last_time - now:f} s; was a clock set, or the node that publishes /clock "
                              "restarted?")
        step = min(max(now - self._last_time, 0.0), LONGEST_STEP) if self._last_time is not None else 0.0
        self._last_time = now
        if settling.state == "stale":
            self.end(ABORTED, settling.reason)
        self._watch_pictures(now, settling)
        order = Order(self._pressure)
        if self.phase == RAMPING:
            if not self.waits_for_pictures and self._ramp_to(self._plan[self.step], step):
                self.phase, self._settling_since = SETTLING, now
        elif self.phase == SETTLING:
            self._look_at(now, settling, order)
        elif self.phase == RETURNING and self._ramp_to(self._rest, step):
            # A run ends once the command is at rest, since the next one starts from the command.
            if self._returned_at is None:
                self._returned_at = now
            at_rest = settling.state == "stale" or settling.set_point is None or self._obeys(settling)
            if at_rest or now - self._returned_at > self._rules.patience:
                self.phase = ENDED
        order.pressure = self._pressure
        return order

    def end(self, verdict: str, reason: str) -> None:
        """Ramps down and ends. The first of several reasons is kept, except completion."""
        if self.phase == ENDED or (self.phase == RETURNING and self.verdict != COMPLETED):
            return
        self.phase, self.verdict, self.reason = RETURNING, verdict, reason

    def yield_arm(self, reason: str) -> None:
        """Ends without ramping, because another commander has the arm."""
        if self.phase in (RAMPING, SETTLING):
            self.verdict, self.reason = ABORTED, reason
        self.phase = ENDED

    def _ramp_to(self, target: np.ndarray, step: float) -> bool:
        most = self._rules.ramp * step
        self._pressure = self._pressure + np.clip(target - self._pressure, -most, most)
        return bool((self._pressure == target).all())

    def _obeys(self, settling: Any) -> bool:
        return settling.set_point is not None and np.abs(settling.set_point - self._pressure).max() < SAME_PRESSURE

    def _watch_pictures(self, now: float, settling: Any) -> None:
        if self.phase not in (RAMPING, SETTLING) or settling.state != "unseen":
            self._unseen_since = None
            return
        if self._unseen_since is None:
            self._unseen_since = now
        if self.phase == SETTLING or now - self._unseen_since <= self._rules.patience:
            return
        self._unseen_since = None
        self.end(ABORTED, f"step {self.step + 1} has waited for pictures for {self._rules.patience:g} s (~patience_s): "
                          f"{settling.reason}")

    def _look_at(self, now: float, settling: Any, order: Order) -> None:
        obeyed = self._obeys(settling)
        if obeyed and settling.state == "settled" and settling.last.time > self._last_capture:
            self._last_capture, self._settling_since = settling.last.time, now
            self._captures += 1
            order.capture, order.step_done = settling.last, self._captures == self._rules.captures
        elif now - self._settling_since > self._rules.patience:
            why = settling.reason if obeyed else "pressure_command does not follow pressure_target"
            self.end(ABORTED, f"step {self.step + 1} has not settled within {self._rules.patience:g} s: {why}")
        if not order.step_done:
            return
        self._captures = 0
        if self.step + 1 == self.steps:
            self.end(COMPLETED, "")
        else:
            self.step, self.phase = self.step + 1, RAMPING
