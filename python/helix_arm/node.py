"""Parts that the nodes in Python share: their parameters, their log, and how they end. As src/ros_bridge/common of those in C++."""
from __future__ import annotations

import functools
import math
import os
import queue
import re
import signal
import socket
import sys
import threading
import time
from typing import Any, Callable, List, Set

import rosgraph
import rospy
import rospy.impl.masterslave

from helix_arm import _core
from helix_arm.client_watch import proxy_of
from helix_arm.file_access import FileAccess, ros_home

DONE, FAILED, BAD_CONFIGURATION = 0, 1, 2  # exit codes
LONGEST_MESSAGE = 1000  # of another node that is repeated in the log [characters]
WARNING_PERIOD = 5.0  # of each kind of fault [s]
MASTER_PERIOD, MASTER_MISSES = 1.0, 3  # [s]
END_PATIENCE, LOST_PATIENCE = 5.0, 1.0  # until a node that cannot end in order exits at once [s]
COULD_NOT_END = (b"this node could not end in time and exits at once: the ROS master does not answer (run rosnode cleanup once it "
                 b"does), a callback does not return, or the log is blocked\n")


class Log:
    """Lines in ROS's log. A thread writes them: a terminal that is stopped, or a pipe that nobody reads, delays no target.

    Control characters are escaped, and a text of several lines is logged line by line: text from outside passes for no other
    line of the log and does not act on the terminal.
    """

    def __init__(self) -> None:
        self._lines: "queue.Queue[Any]" = queue.Queue(200)
        self._lost = 0

    def start(self) -> None:
        threading.Thread(target=self._write, daemon=True).start()

    def flush(self, longest: float) -> None:
        """Waits until all lines are written, at most this long [s]."""
        with self._lines.all_tasks_done:
            self._lines.all_tasks_done.wait_for(lambda: self._lines.unfinished_tasks == 0, longest)

    def _hand(self, write: Callable[[str], None], text: str) -> None:
        for line in _core._printable(text.encode("utf-8", "surrogateescape")).splitlines():
            try:
                self._lines.put_nowait((write, line))
            except queue.Full:
                self._lost += 1

    info = functools.partialmethod(_hand, rospy.loginfo)
    warning = functools.partialmethod(_hand, rospy.logwarn)
    error = functools.partialmethod(_hand, rospy.logerr)
    fatal = functools.partialmethod(_hand, rospy.logfatal)

    def _write(self) -> None:
        while True:
            write, line = self._lines.get()
            write(line)
            if self._lost > 0:
                rospy.logwarn(f"{self._lost} lines are missing here: the log was blocked")
                self._lost = 0
            self._lines.task_done()


log = Log()


class FaultCount:
    """Counts faults of one kind and decides when to warn: at the first, then once per period."""

    def __init__(self) -> None:
        self.total = 0
        self._last_warning = -math.inf

    def add(self) -> bool:
        """Counts a fault; whether a warning is due."""
        self.total += 1
        due = time.monotonic() - self._last_warning >= WARNING_PERIOD
        if due:
            self._last_warning = time.monotonic()
        return due


class End:
    """The request to end this node. It does not shut ROS down: the node can finish its work first."""

    def __init__(self) -> None:
        self._requests = 0

    def ask(self, *_: Any) -> None:
        """By Ctrl-C, SIGTERM or rosnode kill."""
        self._requests += 1

    def make(self) -> None:
        """From within, or where there is no work to finish."""
        self._requests += 2

    def made(self) -> bool:
        return self._requests > 0

    def is_urgent(self) -> bool:
        """Whether the node should not finish its work first: it was asked twice, or from within."""
        return self._requests >= 2


end = End()


class Node:
    """A node. Its constructor is its set-up, and raises ValueError with every fault of its parameters and files."""

    period = 0.1  # between two turns [s]
    _verdict = DONE

    def turn(self) -> None:
        """Called every period."""

    def may_end(self) -> bool:
        """Whether it has no work to finish before it ends."""
        return True

    def finish(self) -> int:
        """Its exit code. May take time if it does not use the ROS master."""
        return self._verdict


class _Watch:
    """Threads that see to it that the node ends: where the master is lost, and where it cannot end in order."""

    def __init__(self) -> None:
        self.turns = 0  # of the main thread
        self.waits = False  # for work that takes time and needs no master
        self.patience = END_PATIENCE
        self.lost = False  # the master
        for watch in (self._watch_master, self._watch_end):
            threading.Thread(target=watch, daemon=True).start()

    def _watch_end(self) -> None:
        idle, seen = 0.0, -1
        while idle < self.patience:
            time.sleep(0.1)
            goes_on = self.turns != seen or self.waits or not end.made()
            seen = self.turns
            idle = 0.0 if goes_on else idle + 0.1
        os.write(2, COULD_NOT_END)
        os._exit(FAILED)

    def _watch_master(self) -> None:
        name, uri = rospy.get_name(), rosgraph.get_master_uri()
        master = proxy_of(uri)
        missed = 0
        while missed < MASTER_MISSES:
            time.sleep(MASTER_PERIOD)
            missed += 1
            try:
                if master.lookupNode(name, name)[0] == 1:
                    missed = 0
                # After a restart, the master answers but does not know this node, which nobody can then find.
                why = "was restarted and does not know this node"
            except socket.timeout:
                why = "does not answer: it hangs, or is cut off"
            except Exception:
                why = "is gone"
        self.lost = True
        end.make()
        log.fatal(f"the ROS master at {uri} {why}: this node exits")


def listen(topic: str, message: Any, queue_size: int, callback: Callable[[Any], None]) -> rospy.Subscriber:
    """Subscribes with TCP_NODELAY. What the callback raises is logged and ends nothing."""
    faults = FaultCount()

    def guarded(content: Any) -> None:
        try:
            callback(content)
        except Exception as fault:
            if faults.add():
                sender = content._connection_header.get("callerid", "")
                log.warning(f"a message on {rospy.resolve_name(topic)} from {sender} was dropped ({faults.total} so far): {fault}")

    return rospy.Subscriber(topic, message, guarded, queue_size=queue_size, tcp_nodelay=True)


def _guarded(body: Callable[[], int]) -> int:
    """The exit code of a body, whose exceptions are printed."""
    try:
        return body()
    except Exception as fault:
        log.fatal(str(fault))
        return BAD_CONFIGURATION if isinstance(fault, ValueError) else FAILED


def _set_parameters() -> None:
    """Parameters of the command line, with the types that nodes in C++ give them: rospy reads YAML."""
    for word in sys.argv[1:]:
        name, given, text = word.partition(":=")
        if not given or not name.startswith("_") or name.startswith("__"):
            continue
        value: Any = text
        if text.lower() in ("true", "false"):
            value = text.lower() == "true"
        elif re.fullmatch(r"[+-]?\d{1,9}", text):
            value = int(text)
        else:
            try:
                value = float(text)
            except ValueError:
                pass
        rospy.set_param("~" + name[1:], value)


def _spin(node: Node, watch: _Watch) -> int:
    due = time.monotonic()
    while not (end.is_urgent() or (end.made() and node.may_end()) or rospy.is_shutdown()):
        watch.turns += 1
        node.turn()
        due = max(due + node.period, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))
    return DONE


def run(name: str, make: Callable[[], Node]) -> None:
    """The program of a node: makes it, takes turns until it must end, exits with its code."""
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    rospy.impl.masterslave.ROSHandler.shutdown = lambda *_: end.ask() or (1, "", 0)
    try:
        rospy.init_node(name, disable_signals=True)
    except KeyboardInterrupt:
        os._exit(DONE)  # while it waited for the master
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end.ask)
    _set_parameters()
    log.start()
    watch = _Watch()

    def live() -> int:
        node = make()
        thrown = _guarded(lambda: _spin(node, watch))
        end.make()
        watch.waits = True
        verdict = node.finish()
        return FAILED if thrown != DONE or watch.lost else verdict

    code = _guarded(live)
    end.make()
    watch.patience = LOST_PATIENCE if watch.lost else END_PATIENCE
    watch.waits = False
    log.flush(1.0)
    rospy.signal_shutdown("the node has ended")
    sys.stdout.flush()
    os._exit(code)


class Parameters:
    """Reads a node's private parameters and collects their faults: `~name value rule`.

    Each method returns the fallback if the parameter is absent or breaks its rule.
    """

    def __init__(self) -> None:
        self._known: Set[str] = set()
        self._faults: List[str] = []

    def text(self, name: str, fallback: str = "") -> str:
        return self._checked(name, fallback, "text", lambda value: isinstance(value, str))

    def flag(self, name: str, fallback: bool) -> bool:
        return self._checked(name, fallback, "true or false", lambda value: isinstance(value, bool))

    def number(self, name: str, fallback: float, lower: float, upper: float) -> float:
        return float(self._checked(name, fallback, f"a number from {lower:g} to {upper:g}",
                                   lambda value: type(value) in (int, float) and lower <= value <= upper))

    def count(self, name: str, fallback: int, lower: int, upper: int) -> int:
        return self._checked(name, fallback, f"a whole number from {lower} to {upper}",
                             lambda value: type(value) is int and lower <= value <= upper)

    def frame(self, name: str) -> str:
        """Name of a tf frame; may be empty."""
        given = self.text(name)
        if given.startswith("/"):
            self._fault(name, given, "a tf2 frame: not empty, no leading slash")
            return ""
        return given

    def file(self, name: str, folder: str, extension: str, required: bool = True) -> str:
        """Path of a file, or the bare name of one that the package ships in `folder`; empty where it is absent.

        Here and below the result is absolute; a relative path begins in the working directory of the node.
        """
        before = len(self._faults)
        given = self.text(name)
        if not given:
            if required and len(self._faults) == before:
                self._faults.append(f"~{name} is missing; expected a path, or the name of a file in {folder} of the package")
            return ""
        shipped, names = _core._shipped(folder, extension)
        if "/" in given or "." in given:
            stem, ending = os.path.splitext(os.path.basename(given))
            if ending != extension or stem not in names or os.path.exists(given):
                return self._absolute(name, given)
            self._fault(name, given, f"a file that is there, or {stem}, which is shipped")
        elif given in names:
            return os.path.join(shipped, given + extension)
        else:
            self._fault(name, given, f"a path, or the name of a file in {folder} of the package: {', '.join(names)}")
        return ""

    def folder(self, name: str) -> str:
        """Path of a folder; where services read by default, if the parameter is absent or empty."""
        given = self.text(name)
        return self._absolute(name, given) if given else str(ros_home() / "helix_arm")

    def file_to_write(self, name: str, ending: str) -> str:
        """Path of a file that may be written; empty where it is absent or empty."""
        given = self.text(name)
        if not given:
            return ""
        try:
            return FileAccess({}).to_write(f"~{name}", os.path.join(os.getcwd(), given), ending)
        except ValueError as refusal:
            self._faults.append(str(refusal))
            return ""

    def finish(self) -> None:
        """Warns of parameters that nobody read. Raises ValueError with every fault."""
        mine = rospy.get_name() + "/"
        for name in rospy.get_param_names():
            if name.startswith(mine) and name not in self._known:
                log.warning(f"the node does not know the parameter {name}; check its spelling")
        if self._faults:
            raise ValueError("\n".join(self._faults))

    def _checked(self, name: str, fallback: Any, rule: str, holds: Callable[[Any], bool]) -> Any:
        self._known.add(rospy.resolve_name("~" + name))
        value = rospy.get_param("~" + name, None)
        if value is None or holds(value):
            return fallback if value is None else value
        self._fault(name, value, rule)
        return fallback

    def _fault(self, name: str, value: Any, rule: str) -> None:
        shown = f"{value:.16g}" if isinstance(value, (bool, int, float)) else value
        self._faults.append(f"~{name} is {shown}; expected {rule}")

    def _absolute(self, name: str, given: str) -> str:
        """The same path, absolute; a relative one must lead to what is there."""
        path = os.path.join(os.getcwd(), given)
        if path != given:
            rospy.set_param("~" + name, path)  # the cockpit reads it, too
            if not os.path.exists(path):
                self._fault(name, path, f"what is there; {given} was taken from the working directory of the node, which is "
                                        f"~/.ros with roslaunch: give an absolute path, such as $PWD/{given}")
        return path
