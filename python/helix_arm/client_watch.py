"""Whether another node is still there. As src/ros_bridge/common/client_watch.hpp of the nodes in C++."""
from __future__ import annotations

import http.client
import threading
import time
import xmlrpc.client
from typing import Any, Optional

import rosgraph
import rospy

from helix_arm.file_access import quoted

ANSWER_PATIENCE = 2.0  # longest wait for the master or a node [s]
PERIOD, MISSES = 0.25, 3  # from an answer to the next question [s]
LONGEST_SILENCE = 7.0  # [s]


class _Transport(xmlrpc.client.Transport):
    def make_connection(self, host: Any) -> Any:
        connection = super().make_connection(host)
        connection.timeout = ANSWER_PATIENCE
        return connection


def proxy_of(uri: str) -> Any:
    """Calls the XML-RPC interface of the master or of a node, and waits for at most ANSWER_PATIENCE."""
    return xmlrpc.client.ServerProxy(uri, transport=_Transport())


class ClientWatch:
    """Whether the node that sent a goal is still there: an arm that it set in motion has a living commander.

    Asks the node itself (getPid of its XML-RPC interface) from a thread of its own, PERIOD after each answer. It is gone after
    MISSES questions in a row without an answer, which is within 1 s after its process has ended, since nobody listens on its port;
    and LONGEST_SILENCE after its last answer, where it was stopped, or its machine or the network was cut off.

    node: its name; empty: gone.
    """

    def __init__(self, node: str) -> None:
        self._node = node
        self._released = threading.Event()
        self._gone = not node
        self._last_answer = time.monotonic()
        self._node_itself: Optional[Any] = None
        threading.Thread(target=self._watch, daemon=True).start()

    def release(self) -> None:
        self._released.set()

    def is_gone(self) -> bool:
        # The silence counts here, too: a name that cannot be resolved may hold up the thread.
        return self._gone or time.monotonic() - self._last_answer > LONGEST_SILENCE

    def why_gone(self) -> str:
        """The fault, and the remedy."""
        name = f", {quoted(self._node)}," if self._node else ""
        return f"the node that sent the goal{name} is gone or does not answer; keep it running until the goal has ended"

    def _watch(self) -> None:
        misses = 0
        while not (self._gone or self._released.wait(PERIOD)):
            try:
                answers = self._answers()
            except Exception:
                answers = False
            misses = 0 if answers else misses + 1
            if answers:
                self._last_answer = time.monotonic()
            self._gone = misses >= MISSES

    def _answers(self) -> bool:
        """Its address is looked up once: a node that was restarted has another one, and knows no goal of the one before it.

        A master that does not answer tells nothing of the node.
        """
        if self._node_itself is None:
            try:
                code, _, uri = proxy_of(rosgraph.get_master_uri()).lookupNode(rospy.get_name(), self._node)
            except (OSError, http.client.HTTPException):
                return True
            if code != 1:
                return False
            self._node_itself = proxy_of(uri)
        return self._node_itself.getPid(rospy.get_name())[0] == 1
