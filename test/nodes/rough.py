# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A twin in a process of its own and what a viewer sees of it, for the tests of bad conditions."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from valve_twin_msgs.msg import CycleSummary, Estimate, Fault, Faults, Prediction

from test.nodes.conftest import NS
from test.nodes.feeding import REARM

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TREND_ESTIMATOR = "output_error"


class Watched:
    """A twin process and everything that it says."""

    def __init__(self, graph, folder, **parameters) -> None:
        self.graph = graph
        self.predictions = graph.record(f"{NS}/twin/prediction", Prediction)
        self.estimates = graph.record(f"{NS}/twin/estimate", Estimate, LATCHED)
        self.cycles = graph.record(f"{NS}/twin/cycle", CycleSummary, LATCHED)
        self.told = graph.record(f"{NS}/twin/faults", Faults, LATCHED)
        self.diagnostics = graph.record("/diagnostics", DiagnosticArray)
        database = {"history_url": f"sqlite:///{folder}/history.sqlite"}
        self.process = graph.start("twin", **{**REARM, **database, **parameters})
        graph.spin_until(
            lambda: graph.connected(f"{NS}/twin/prediction", f"{NS}/twin/estimate"),
            120.0,
            "the twin's publishers",
        )
        graph.be_heard(f"{NS}/twin")

    def faults(self) -> dict[tuple[str, str], Fault]:
        """All faults that were told last, by code and subject."""
        return {(f.code, f.subject): f for f in self.told[-1].faults} if self.told else {}

    def wait_for(self, code: str, subject: str = "", status: int = Fault.CONFIRMED) -> Fault:
        """Wait until a fault has a status."""
        return self.graph.spin_until(
            lambda: (f := self.faults().get((code, subject))) and f.status == status and f,
            120.0,
            f"{code} {subject} with status {status}; told: {self.faults()}",
        )

    def wait_for_events(self, code: str, subject: str, events: int) -> Fault:
        """Wait until a fault is told with so many events: a look may fall between them."""
        return self.graph.spin_until(
            lambda: (f := self.wait_for(code, subject)).events >= events and f,
            120.0,
            f"{events} events of {code} {subject}; told: {self.faults()}",
        )

    @property
    def status(self):
        """The newest diagnostics of the valve."""
        found = [s for a in self.diagnostics for s in a.status if s.hardware_id == NS]
        return found[-1] if found else None

    def figure(self, key: str) -> str:
        """A figure of the newest diagnostics."""
        return next((v.value for v in self.status.values if v.key == key), "")

    def counts(self, topic: str) -> tuple[int, int, int]:
        """Messages received, lost and unreadable of a topic, by the newest diagnostics."""
        received, lost, broken = self.figure(f"{topic} received/lost/unreadable").split("/")
        return int(received), int(lost), int(broken)

    def fresh(self) -> None:
        """Wait for diagnostics that were made after now."""
        seen = len(self.diagnostics)
        self.graph.spin_until(lambda: len(self.diagnostics) > seen + 2, what="new diagnostics")

    def stamps(self) -> list[int]:
        """Stamps of all predictions [ns]."""
        return [p.header.stamp.sec * 10**9 + p.header.stamp.nanosec for p in self.predictions]

    def estimated(self) -> dict[int, Estimate]:
        """Estimates for the trend by cycle."""
        return {m.cycle: m for m in self.estimates if m.estimator == TREND_ESTIMATOR}
