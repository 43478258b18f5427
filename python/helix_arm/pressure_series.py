"""The node pressure_series: plays a table of pressures to pressure_command, row by row."""
from __future__ import annotations

import math
import threading
import time
from typing import Any

import numpy as np
import rospy

from helix_arm.arguments import require
from helix_arm.file_access import quoted
from helix_arm.msg import PressureArray, TargetStatus
from helix_arm.node import DONE, FAILED, LONGEST_MESSAGE, FaultCount, Node, Parameters, end, listen, log, run
from helix_arm.rest_request import PATIENCE, CommandTrace, request_rest
from helix_arm.scene import Scene

# Refusals, and commands of another arm, end the series only after this number of consecutive messages over this time.
LEAST_TROUBLE, LONGEST_TROUBLE = 10, 2.0  # [s]
LONGEST_STEP = 0.1  # after a pause of the node, the series does not jump [s]
# Refusals that do not depend on the values of the target: the arm is not enabled, or was brought to rest by somebody else;
# messages are late, or clocks differ.
PASSING = ("not_enabled", "rested", "stale")


class SeriesPlayer:
    """Plays rows of pressures: ramps to each and holds it. Time advances by steps.

    rows: (rows, n) [Pa]. ramp, hold: duration of the ramp between rows, and at each row [s]. loop: restart after the last row.
    Raises ValueError naming the value and its rule.
    """

    def __init__(self, rows: np.ndarray, ramp: float, hold: float, loop: bool) -> None:
        require(len(rows) > 0, "a series without rows; expected at least one")
        require(ramp >= 0 and hold >= 0 and 0 < ramp + hold < math.inf,
                f"a series with a ramp of {ramp:f} s and a hold of {hold:f} s; expected finite values >= 0, not both 0")
        self.rows, self._ramp, self._hold, self._loop = rows, ramp, hold, loop
        self.row = 0  # that is reached or held
        self.finished = False  # after the hold of the last row
        self.resume(rows[0])

    def resume(self, start: np.ndarray) -> None:
        """Begins the ramp to the current row anew, from pressures (n) that another commander has set."""
        self._from, self._time = start, 0.0

    def advance(self, step: float) -> None:
        """Advances time by step >= 0 [s]."""
        self._time += step
        while not self.finished and self._time >= self._ramp + self._hold:
            last = self.row + 1 == len(self.rows)
            if last and not self._loop:
                self.finished = True
                return
            self._from = self.rows[self.row]
            self.row = 0 if last else self.row + 1
            self._time -= self._ramp + self._hold

    def pressure(self) -> np.ndarray:
        """(n) [Pa] at the current time; after the end, the last row."""
        to = self.rows[self.row]
        if self.finished or self._time >= self._ramp:
            return to
        return self._from + self._time / self._ramp * (to - self._from)


class Trouble:
    """Consecutive messages that indicate that the series is not for this arm."""

    def __init__(self) -> None:
        self.messages, self.warnings, self._since = 0, FaultCount(), 0.0

    def goes_on(self) -> bool:
        """Counts one more; true once they are more than one or two stray messages."""
        now = time.monotonic()
        if self.messages == 0:
            self._since = now
        self.messages += 1
        return self.messages >= LEAST_TROUBLE and now - self._since >= LONGEST_TROUBLE


class PressureSeries(Node):
    """Subscribes
    - pressure_command (PressureArray): start of the first ramp; nothing is sent before it arrives
    - target_status (TargetStatus): shows that another commander has the arm, or wants it

    Publishes
    - pressure_target (PressureArray): all actuators, gauge [Pa]; those without a column stay at 0, with a warning at the start

    Calls pressure_command/rest after the last row and when asked to end, if the arm follows it: the arm ramps down and rests.
    Without that service it ends all the same.

    While the arm is not enabled, or targets arrive late (or clocks differ), it sends the arm's own pressures as target, and
    continues from there once these are accepted.

    Ends with 0 after the last row or when asked to, 1 if the ROS master is lost, or if for two seconds all commands are of
    another arm, or all targets are refused for their values; 2 on a bad parameter, scene or data set, or if a row is outside
    the limits of the scene. No single message ends it.
    """

    def __init__(self) -> None:
        reader = Parameters()
        scene = reader.file("scene", "config/scenes", ".yaml")  # as pressure_command's
        data = reader.file("data", "config/series", ".csv", required=False)  # none: a tour
        ramp, hold = reader.number("ramp_s", 1.0, 0.0, 3600.0), reader.number("hold_s", 1.0, 0.0, 3600.0)
        loop = reader.flag("loop", False)
        self.period = 1.0 / reader.number("rate", 50.0, 1.0, 1000.0)  # of the targets [s]
        self._yields = reader.flag("yields", False)  # pause while another commander wants the arm
        self._resume_after = reader.number("resume_after_s", 3.0, 0.1, 3600.0)  # silence of the others that ends the pause [s]
        reader.finish()
        self._scene = Scene.load(scene)
        self._player = SeriesPlayer(self._rows_of(data), ramp, hold, loop)
        self._command: Any = None  # (n) last one in force, inside the limits [Pa]
        self._trace = CommandTrace()
        self._over = False  # the last row was played
        self._told_row = -1
        self._yielding = self._held_back = False  # to others; by refusals whatever the values
        self._waits = FaultCount()
        self._foreign, self._refused = Trouble(), Trouble()  # commands of another arm; targets refused for their values
        self._last_of_others = self._last_turn = self._end_began = -math.inf
        self._lock = threading.RLock()
        self._publisher = rospy.Publisher("pressure_target", PressureArray, queue_size=10, tcp_nodelay=True)
        self._subscribers = (listen("pressure_command", PressureArray, 10, self._on_command),
                             listen("target_status", TargetStatus, 100, self._on_status))

    def may_end(self) -> bool:
        """Not while the arm follows the series, or is about to: it is to be brought to rest first."""
        with self._lock:
            begun = self._end_began > -math.inf
            return not self._trace.commands() and not self._trace.awaits_answer() and (begun or not self._may_be_unheard())

    def turn(self) -> None:
        with self._lock:
            self._take_turn()

    def _rows_of(self, data: str) -> np.ndarray:
        if not data:
            return self._scene._tour()
        rows, without, faults = self._scene._series(data)
        if without:
            log.warning(f"{data} has no column for {', '.join(without)}: they stay at 0; is it for another arm?")
        require(not faults, faults)
        return rows

    def _on_command(self, message: PressureArray) -> None:
        with self._lock:
            try:
                command = np.clip(self._scene._reading(message.name, message.pressure), *self._scene.limits_pa.T)
            except ValueError as refusal:
                self._suffer(self._foreign, f"pressure_command does not match scene {self._scene.name}: {refusal}")
                return
            self._foreign.messages = 0
            if self._command is None:
                self._player.resume(command)
            self._command = command

    def _on_status(self, status: TargetStatus) -> None:
        with self._lock:
            self._trace.answered(status)
            mine = status.commander == rospy.get_name()
            dropped = status.outcome == TargetStatus.DROPPED
            message = quoted(status.message, LONGEST_MESSAGE)
            if mine and status.fault in PASSING:
                self._refused.messages = 0
                if self._waits.add():
                    log.warning(f"the series waits: {message}")
                self._held_back = True
                return
            if mine and self._held_back and not dropped:
                log.info("targets are accepted again: the series continues")
                self._held_back = False
                if self._command is not None:
                    self._player.resume(self._command)
            waits = self._yields and (status.fault == "other_commander" or not (mine or dropped))
            if mine and dropped and not waits:
                self._suffer(self._refused, f"the series was refused: {message}")
            elif mine:
                self._refused.messages = 0
            if not waits:
                return
            if not self._yielding:
                log.info("another commander sends targets: the series waits")
            self._yielding, self._last_of_others = True, time.monotonic()

    def _take_turn(self) -> None:
        now = time.monotonic()
        step = min(now - self._last_turn, LONGEST_STEP) if self._last_turn > -math.inf else 0.0
        self._last_turn = now
        if self._over or end.made():
            self._end_series()
            return
        if self._command is None or self._publisher.get_num_connections() == 0:
            return
        if self._yielding:
            if now - self._last_of_others < self._resume_after:
                return
            log.info("the series continues")
            self._yielding = False
            self._player.resume(self._command)
        elif not self._held_back:
            self._player.advance(step)
        row, rows = self._player.row, self._player.rows
        if row != self._told_row:
            self._told_row = row
            log.info(f"row {row + 1} of {len(rows)}: {' '.join(f'{1e-3 * one:.4g}' for one in rows[row])} kPa")
        self._publish_target()
        self._over = self._player.finished
        if self._over:
            log.info("the series has ended")

    def _publish_target(self) -> None:
        target = PressureArray(name=self._scene.actuators, pressure=self._command if self._held_back else self._player.pressure())
        self._trace.send(self._publisher, target)

    def _end_series(self) -> None:
        """Once no target is on its way any more, asks for rest where the arm follows; ends the node.

        Where no target was answered yet, repeats the last one, for PATIENCE at most. Ends after twice that time at the latest.
        """
        if end.is_urgent():
            return  # without a master, the call would block
        if self._end_began == -math.inf:
            self._end_began = time.monotonic()
        # The arm may follow a target whose answer came before target_status was connected.
        if self._may_be_unheard() and time.monotonic() - self._end_began < PATIENCE:
            self._publish_target()
            return
        if self._trace.awaits_answer():
            return
        if self._trace.commands():
            request_rest()
        end.make()

    def _may_be_unheard(self) -> bool:
        """Targets were sent and none was answered, neither to this node nor to another that it gives way to."""
        return self._trace.is_unheard() and not self._yielding

    def _suffer(self, trouble: Trouble, what: str) -> None:
        """Warns, and ends the node if the trouble persists."""
        if trouble.warnings.add():
            log.warning(what)
        if not trouble.goes_on() or self._verdict != DONE:
            return
        log.fatal(f"{what}, and nothing else for {LONGEST_TROUBLE:g} s")
        self._verdict = FAILED
        end.make()


def main() -> None:
    run("pressure_series", PressureSeries)
