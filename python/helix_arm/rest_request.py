"""How a commander ends without a fault: it waits until its last target is answered, since one that comes later would cancel the
request, and asks pressure_command to bring the arm to rest. As src/ros_bridge/common/rest_request.hpp of the nodes in C++."""
from __future__ import annotations

import math
import time
from typing import Any

import rospy
from std_srvs.srv import Trigger

from helix_arm.msg import TargetStatus
from helix_arm.file_access import quoted
from helix_arm.node import LONGEST_MESSAGE, end, log

PATIENCE = 1.0  # longest wait for the answer to a target [s]


class CommandTrace:
    """Follows this node's targets and the answers to them. For one thread, or behind one lock."""

    def __init__(self) -> None:
        self._stamp, self._sent = rospy.Time(), -math.inf
        self._waits = self._heard = self._accepted = self._rested = False

    def send(self, publisher: rospy.Publisher, target: Any) -> None:
        """Publishes a target of this moment."""
        target.header.stamp = rospy.get_rostime()
        self._stamp, self._sent, self._waits = target.header.stamp, time.monotonic(), True
        publisher.publish(target)

    def answered(self, status: TargetStatus) -> None:
        """Notes an answer on target_status, to whomever."""
        accepted = status.outcome != TargetStatus.DROPPED
        if status.commander != rospy.get_name():
            self._accepted, self._rested = self._accepted and not accepted, self._rested and not accepted
            return
        self._accepted, self._heard, self._rested = accepted, True, status.fault == "rested"
        if status.target_stamp == self._stamp:
            self._waits = False

    def commands(self) -> bool:
        """Whether the arm follows this node."""
        return self._accepted and (not self._waits or self.awaits_answer())

    def awaits_answer(self) -> bool:
        """Whether the last target may still be answered."""
        return self._waits and time.monotonic() - self._sent <= PATIENCE

    def is_unheard(self) -> bool:
        """Whether targets were sent of which none was answered."""
        return self._waits and not self._heard

    def was_rested(self) -> bool:
        """Whether the newest answer refused a target since somebody else had asked for rest, and no target of another was accepted
        since. Once no target of this node is under way, request_rest() tells pressure_command that it knows: its next target
        counts."""
        return self._rested


def request_rest() -> None:
    """Calls pressure_command/rest and logs the answer. Without such a service it only warns. Not to be called with a lock held."""
    service = rospy.resolve_name("pressure_command/rest")
    try:
        log.info(f"{service}: {quoted(rospy.ServiceProxy(service, Trigger)().message, LONGEST_MESSAGE)}")
    except rospy.ServiceException:
        # Nodes that are shut down together may miss each other.
        write = log.info if end.made() else log.warning
        write(f"{service} does not exist or does not answer: the arm vents once no target has come for "
              "safety.target_timeout_s, as after a fault")
