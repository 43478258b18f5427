"""Services and actions of a node: one long job at a time, and answers that hold what went wrong."""
from __future__ import annotations

import contextlib
import threading
import time
from typing import Any, Callable, Iterator

import actionlib
import rospy

from helix_arm import _core
from helix_arm.arguments import require
from helix_arm.client_watch import ClientWatch
from helix_arm.node import log

LINK_PATIENCE = 5.0  # after which all links to an action are asked for again, then after twice as long, and so on [s]


def text_of(fault: Exception) -> str:
    return _core._printable(str(fault).encode("utf-8", "surrogateescape"))


def answer(service: str, response: Any, body: Callable[[], None]) -> Any:
    """Runs what fills the response of a service, or the result of an action; what it raises is the answer."""
    try:
        body()
    except Exception as fault:
        response.success, response.message = False, text_of(fault)
    (log.info if response.success else log.warning)(f"{service}: {response.message}")
    return response


def serve(name: str, kind: Any, body: Callable[[Any, Any], None], lock: Any = contextlib.nullcontext(),
          **fallbacks: Any) -> rospy.Service:
    """The private service of this name. body: fills the response to a request, while the lock is held."""
    def handle(request: Any) -> Any:
        response = kind._response_class(**fallbacks)
        with lock:
            return answer(name, response, lambda: body(request, response))

    return rospy.Service(f"~{name}", kind, handle)


class ActionServer(actionlib.SimpleActionServer):
    """The private action of this name, whose goals run in a thread of their own. is_busy: from a goal's begin until its result is
    sent."""

    def __init__(self, name: str, kind: Any, on_goal: Callable[[Any], None]) -> None:
        def carry_out(goal: Any) -> None:
            self.is_busy = True
            try:
                on_goal(goal)
            finally:
                self.is_busy = False

        self.is_busy = False
        super().__init__(rospy.resolve_name(f"~{name}"), kind, carry_out, auto_start=False)
        self.start()
        # The thread of actionlib's own timer ends where time goes back.
        actions = self.action_server
        if actions.status_timer is not None:
            actions.status_timer.shutdown()
            period = rospy.Duration(1.0 / actions.status_frequency)
            actions.status_timer = rospy.Timer(period, actions.publish_status_async, reset=True)

    def conclude(self, result: Any, preempted: bool) -> None:
        """Sends the result of the present goal."""
        if not rospy.is_shutdown():
            send = self.set_succeeded if result.success else self.set_preempted if preempted else self.set_aborted
            send(result, result.message)

    def watch_sender(self) -> ClientWatch:
        """Watch over the sender of the present goal."""
        return ClientWatch(self.current_goal.status_tracker.goal._connection_header.get("callerid", ""))


class PatientClient(actionlib.ActionClient):
    """Client of an action by its resolved name. A SimpleActionClient loses an answer that comes before its send_goal() returns."""

    def __init__(self, action: str, kind: Any, patience: float = LINK_PATIENCE) -> None:
        self._asked, self._patience = time.monotonic(), patience
        super().__init__(action, kind)

    def is_connected(self) -> bool:
        """Whether its server is there and gets its goals: unlike wait_for_server(), where it has ended since."""
        if self.last_status_msg is None:
            return False
        server = self.last_status_msg._connection_header["callerid"]
        return (all(publisher.impl.has_connection(server) for publisher in (self.pub_goal, self.pub_cancel)) and
                all(any(one.callerid_pub == server and one.socket is not None for one in subscriber.impl.connections)
                    for subscriber in (self.result_sub, self.feedback_sub)))

    def ask_again(self) -> None:
        """Before a goal, often: asks anew for links that have not come, since ROS does not repeat a word that was lost."""
        if time.monotonic() - self._asked > self._patience:
            self.stop()
            self.__init__(self.ns, self.ActionSpec, 2 * self._patience)


class JobSlot:
    """The one long job that the node does at a time: a run of its action, or the fit of a service. While a job holds the slot, no
    other starts, and neither samples nor scene are changed from outside. From any thread.

    Its lock is taken after that of ReloadServer, and before that of Recorder.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.job = ""  # that holds the slot

    @contextlib.contextmanager
    def claim(self, job: str) -> Iterator[None]:
        """Raises ValueError naming the job that is under way."""
        with self.idle():
            self.job = job
        try:
            yield
        finally:
            with self._lock:
                self.job = ""

    @contextlib.contextmanager
    def idle(self) -> Iterator[None]:
        """For what is short: no job starts meanwhile. Raises ValueError naming the job that is under way."""
        with self._lock:
            require(not self.job, self.job)
            yield
