# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Publish /diagnostics once a second on the steady clock."""

from __future__ import annotations

import resource
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from valve_twin.core.faults.lifetime import Severity
from valve_twin.nodes.runtime.fault_reporter import key_values
from valve_twin.nodes.runtime.node import STEADY, ValveNode
from valve_twin.nodes.runtime.safety import node_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from valve_twin.core.faults.lifetime import Fault

PERIOD_S = 1.0
CLOCK, SEVERAL = "/clock", 2
OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
_GRAVITY = {OK: 0, WARN: 1, STALE: 2, ERROR: 3}
_LEVEL = {Severity.WARN: WARN, Severity.ERROR: ERROR, Severity.STALE: STALE}


@dataclass(slots=True)
class Report:
    """Condition of one thing that is watched.

    Attributes
    ----------
    name, hardware_id : str
        What is watched, and the valve.
    values : dict
        Figures by name.
    figures : callable, optional
        Makes more of them; asked where somebody reads the diagnostics.
    """

    name: str
    hardware_id: str
    values: dict[str, object] = field(default_factory=dict)
    level: bytes = OK
    message: str = "ok"
    figures: Callable[[], dict[str, object]] | None = None

    def raise_to(self, level: bytes, message: str) -> None:
        """Report a problem; the gravest gives the level, all stand in the message."""
        self.message = message if self.level == OK else f"{self.message}; {message}"
        if _GRAVITY[level] > _GRAVITY[self.level]:
            self.level = level

    def add_faults(self, faults: list[Fault]) -> None:
        """Take the level and the words of what is confirmed, the key-values of all faults."""
        for fault in faults:
            if fault.is_active:
                self.raise_to(_LEVEL[fault.kind.severity], fault.evidence)
        self.values |= key_values(faults)


class Load:
    """CPU share and memory of this process since the last look."""

    def __init__(self) -> None:
        self._cpu, self._wall = time.process_time(), time.monotonic()

    def look(self) -> dict[str, object]:
        """Return CPU share [%] and peak memory [MB]."""
        cpu, wall = time.process_time(), time.monotonic()
        share = 100.0 * (cpu - self._cpu) / max(wall - self._wall, 1e-9)
        self._cpu, self._wall = cpu, wall
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        return {"cpu [%]": f"{share:.1f}", "peak memory [MB]": f"{peak:.0f}"}


def clock_sources(node: ValveNode) -> str:
    """Return in one line which nodes publish /clock; empty up to one, and where it is not used."""
    uses = node.get_parameter("use_sim_time").value
    if not uses and all(p.topic_name != CLOCK for p in node.publishers):
        return ""
    found = node.get_publishers_info_by_topic(CLOCK)
    if len(found) < SEVERAL:
        return ""
    names = ", ".join(sorted(node_name(p) for p in found))
    return (
        f"{len(found)} publishers of {CLOCK}: {names}: time jumps between them; set clock to "
        "false at all but one, or give them different ROS_DOMAIN_ID"
    )


class Diagnostics:
    """Timer and publisher of a node's diagnostics.

    Parameters
    ----------
    node : ValveNode
        The node.
    reports : callable
        Makes the reports of the valves and files their faults; called once a second.
    """

    def __init__(self, node: ValveNode, reports: Callable[[], Iterable[Report]]) -> None:
        self._node = node
        self._reports = reports
        self._load = Load()
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = node.create_timer(PERIOD_S, self.publish, clock=STEADY)
        self._ended = False

    def destroy(self) -> None:
        """Stop."""
        self._ended = True
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    def publish(self) -> None:
        """Publish now; not behind `destroy`: the timer may have been due before."""
        if self._ended:
            return
        reports, load = self._all_reports(), self._load.look()
        if not self._publisher.get_subscription_count():
            return  # faults are looked for all the same
        for report in reports:
            report.add_faults(self._node.faults.faults(report.hardware_id))
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        own = self._node.get_fully_qualified_name()
        for report in reports:
            more = report.figures() if report.figures is not None else {}
            figures = {**more, **report.values, **load}
            message.status.append(
                DiagnosticStatus(
                    level=report.level,
                    name=f"{own}: {report.name}",
                    message=report.message,
                    hardware_id=report.hardware_id,
                    values=[KeyValue(key=k, value=str(v)) for k, v in figures.items()],
                )
            )
        self._publisher.publish(message)

    def _all_reports(self) -> Iterable[Report]:
        """Return a report of every valve, then one of the node; faults are filed."""
        reports = list(self._reports())
        self._node.faults.look("clock.sources", clock_sources(self._node))
        self._node.faults.step()
        own = Report("node", "", {"state": self._node.state})
        return (*reports, own)
