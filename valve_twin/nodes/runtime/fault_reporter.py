# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The one place where a node reports faults: log, latched topic, service and diagnostics.

`~/faults` (valve_twin_msgs/Faults, latched) carries all faults when one is confirmed or healed;
`~/clear_faults` forgets them; /diagnostics has them as key-values `fault.CODE[.SUBJECT].FIELD`.
"""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING, Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from valve_twin_msgs import msg, srv

from valve_twin.core.faults.kinds import FAULT_KINDS
from valve_twin.core.faults.lifetime import (
    Fault,
    FaultBook,
    FaultKind,
    Moment,
    Severity,
    Status,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

SHARED_S = 0.005
"""What is filed within this time has one stamp [s]."""

MOST_TOLD = 3
"""Lines of one code at a time; a line counts those beyond [1]."""

_LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
_STATUS = {
    Status.PENDING: msg.Fault.PENDING,
    Status.CONFIRMED: msg.Fault.CONFIRMED,
    Status.HEALED: msg.Fault.HEALED,
}


class FaultReporter:
    """Takes the fault reports of a node, on the node's own thread.

    Parameters
    ----------
    node : Node
        The node.
    later : callable
        Runs an action after the callback that runs now: what many valves report together is told
        and published together.
    """

    def __init__(self, node: Node, later: Callable[[Callable[[], None]], None]) -> None:
        self._node, self._later = node, later
        self._changes: list[Fault] = []
        self._book = FaultBook(FAULT_KINDS)
        self._moment = Moment(-1.0, 0)
        self._published_events = 0
        self._publisher = node.create_publisher(msg.Faults, "~/faults", _LATCHED)
        node.create_service(srv.ClearFaults, "~/clear_faults", self._clear)

    def report(
        self,
        code: str | FaultKind,
        evidence: str,
        *,
        valve: str = "",
        subject: str = "",
        events: int = 1,
    ) -> None:
        """Report that a condition lasts, or that events have happened.

        Parameters
        ----------
        code : str or FaultKind
            Code of the fault, see core/faults/kinds.py; a kind says more of this fault.
        evidence : str
            One line with figures; it stands in log and diagnostics.
        valve, subject : str
            Whose it is; the topic or signal that has it, or which fault of the valve it is.
        events : int
            How many events [1].
        """
        self._book.report(code, evidence, self._now(), unit=valve, subject=subject, events=events)
        changes = self._book.changes()
        if changes and not self._changes:
            self._later(self.tell)
        self._changes += changes

    def passed(self, code: str, *, valve: str = "", subject: str = "") -> None:
        """Say that a condition was looked at and is absent.

        Parameters
        ----------
        code : str
            Code of the fault, see core/faults/kinds.py.
        valve, subject : str
            Whose it would be; the topic or signal that was looked at.
        """
        self._book.passed(code, self._now(), unit=valve, subject=subject)

    def look(self, code: str, evidence: str, *, valve: str = "", subject: str = "") -> None:
        """Report a condition where there is evidence of it, else say that it is absent.

        Parameters
        ----------
        code : str
            Code of the fault, see core/faults/kinds.py.
        evidence : str
            One line with figures; empty = the condition is absent.
        valve, subject : str
            Whose it is; the topic or signal that was looked at.
        """
        if evidence:
            self.report(code, evidence, valve=valve, subject=subject)
        else:
            self.passed(code, valve=valve, subject=subject)

    def step(self) -> None:
        """Let time pass; called once a second."""
        self._book.step(self._now())
        self._changes += self._book.changes()
        self.tell()
        if self._events() != self._published_events:
            self._publish()

    def faults(self, valve: str | None = None) -> list[Fault]:
        """Return all faults, or those of one valve ("" = of the node itself)."""
        return self._book.faults(valve)

    def _now(self) -> Moment:
        """Return the time; one look at many conditions shares it."""
        steady_s = time.monotonic()
        if not 0.0 <= steady_s - self._moment.steady_s < SHARED_S:
            self._moment = Moment(steady_s, self._node.get_clock().now().nanoseconds)
        return self._moment

    def tell(self) -> None:
        """Log and publish what was confirmed or healed since the last time."""
        changes, self._changes = self._changes, []
        told: Counter[tuple[str, bool]] = Counter()
        for fault in changes:
            kind = fault.kind.code, fault.is_active
            told[kind] += 1
            if told[kind] <= MOST_TOLD:
                self._log(fault)
        logger = self._node.get_logger()
        for (code, active), count in told.items():
            if count <= MOST_TOLD:
                continue
            if active:
                logger.warning(f"{count - MOST_TOLD} more of [{code}]: ~/faults has them all")
            else:
                logger.info(f"{count - MOST_TOLD} more of {code} are healed")
        if changes:
            self._publish()

    def _log(self, fault: Fault) -> None:
        place = f"{fault.unit}: " if fault.unit else ""
        logger = self._node.get_logger()
        if not fault.is_active:
            logger.info(f"{place}{fault.key} is healed")
        elif fault.kind.severity is Severity.ERROR:
            logger.error(f"{place}{fault.evidence} [{fault.kind.code}]")
        else:
            logger.warning(f"{place}{fault.evidence} [{fault.kind.code}]")

    def _publish(self) -> None:
        message = msg.Faults(node=self._node.get_fully_qualified_name())
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.faults = [_message(f) for f in self._book.faults()]
        self._publisher.publish(message)
        self._published_events = self._events()

    def _events(self) -> int:
        """Return how many events all faults had: those of a lasting fault count, too."""
        return sum(f.events for f in self._book.faults())

    def _clear(self, request: Any, response: Any) -> Any:
        response.cleared = self._book.clear(unit=request.valve, code=request.code)
        response.success = bool(response.cleared) or not (request.valve or request.code)
        response.message = (
            f"{response.cleared} faults forgotten; what lasts is counted anew"
            if response.success
            else f"no fault of valve '{request.valve}' and code '{request.code}' is known; "
            "write what ~/faults says, or nothing for all"
        )
        self._publish()
        return response


def key_values(faults: list[Fault]) -> dict[str, object]:
    """Return the key-values of /diagnostics for some faults.

    Parameters
    ----------
    faults : list of Fault
        Pending, confirmed and healed ones.
    """
    found: dict[str, object] = {}
    for fault in faults:
        fields = {
            "status": fault.status.value,
            "severity": fault.kind.severity.name,
            "NE 107": fault.kind.ne107.value,
            "count": fault.count,
            "events": fault.events,
            "first [s]": f"{1e-9 * fault.first_ns:.3f}",
            "last [s]": f"{1e-9 * fault.last_ns:.3f}",
            "evidence": fault.evidence,
            "remedy": fault.kind.remedy,
        }
        if fault.kind.failure_mode:
            fields["failure mode (ISO 14224)"] = fault.kind.failure_mode
            fields["cause"] = fault.kind.cause
        found |= {f"fault.{fault.key}.{name}": value for name, value in fields.items()}
    return found


def _message(fault: Fault) -> msg.Fault:
    made = msg.Fault(
        valve=fault.unit,
        code=fault.kind.code,
        subject=fault.subject,
        severity=int(fault.kind.severity),
        status=_STATUS[fault.status],
        evidence=fault.evidence,
        remedy=fault.kind.remedy,
        count=fault.count,
        events=fault.events,
    )
    made.first.sec, made.first.nanosec = divmod(fault.first_ns, 10**9)
    made.last.sec, made.last.nanosec = divmod(fault.last_ns, 10**9)
    return made
