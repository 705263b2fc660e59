# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The aging monitor node: follows the parameters of one or many valves over months."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from valve_twin.core.aging.verdict import TrendStatus
from valve_twin.core.diagnosis.changes.finding import describe_finding
from valve_twin.core.faults.advice import DIAGNOSED, advise
from valve_twin.core.faults.kinds import diagnosed
from valve_twin.core.faults.lifetime import Severity
from valve_twin.io.config.node_parameters import AgingMonitorParameters
from valve_twin.nodes.aging.keeping import Keeper
from valve_twin.nodes.aging.monitored_valve import MonitoredValve
from valve_twin.nodes.runtime.diagnostics import ERROR, WARN, Diagnostics, Report
from valve_twin.nodes.runtime.node import STEADY, ValveNode
from valve_twin.nodes.runtime.worker import WorkerThread
from valve_twin.nodes.twin.valve_parameters import read_valves

if TYPE_CHECKING:
    from collections.abc import Iterable

FLUSH_S = 0.3


class AgingMonitorNode(ValveNode):
    """Lifecycle node of the aging monitor; it may run anywhere and be down at any time."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("aging_monitor", **kwargs)
        self._valves: list[MonitoredValve] = []
        self._worker: WorkerThread | None = None
        self._diagnostics: Diagnostics | None = None
        self._timer: Any = None

    def configure(self) -> None:
        """Read the parameters."""
        configs = read_valves(self)
        self._worker = WorkerThread("assessment")
        given = self.parameters.read(AgingMonitorParameters)
        self._valves = [
            MonitoredValve(
                self,
                config,
                worker=self._worker,
                page=given.page,
                keeper=Keeper(given.state_folder, config),
            )
            for config in configs
        ]
        self._diagnostics = Diagnostics(self, self._reports)

    def activate(self) -> None:
        """Follow the twins; what was missed is asked for first."""
        for valve in self._valves:
            valve.listen()
        retry_s = self.parameters.read(AgingMonitorParameters).retry_s
        self._timer = self.create_timer(retry_s, self._ask, clock=STEADY)

    def deactivate(self) -> None:
        """Stop following."""
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None
        for valve in self._valves:
            valve.silence()

    def cleanup(self) -> None:
        """Let go of everything."""
        if self._worker is not None:
            self._worker.close(FLUSH_S)
        for valve in self._valves:
            valve.close()
        if self._diagnostics is not None:
            self._diagnostics.destroy()
        self._valves, self._worker, self._diagnostics = [], None, None

    def _ask(self) -> None:
        for valve in self._valves:
            valve.look()

    def _reports(self) -> Iterable[Report]:
        for valve in self._valves:
            yield self._report(valve)

    def _report(self, valve: MonitoredValve) -> Report:
        report = Report(f"aging of {valve.name}", valve.name, {"estimates": valve.cycles})
        report.values |= {
            "last cycle": valve.last_cycle,
            "last assessment [s]": f"{valve.assess_s:.3f}",
        }
        absent = (
            ""
            if valve.twin_answers
            else f"service {valve.name}/twin/get_history is not there: start the twin of this "
            "valve"
        )
        self.faults.look("twin.absent", absent, valve=valve.name)
        self.faults.look("assessment.failed", valve.failure, valve=valve.name)
        found = valve.assessment
        self._look_at_faults(valve)
        if found is not None:
            report.values["verdict"] = found.verdict.text
            advice = advise(found.verdict, found.trends)
            report.values["NE 107"] = advice.ne107.value
            report.values["failure mode (ISO 14224)"] = advice.failure_mode
            report.values["action"] = advice.sentence
            for trend in found.trends:
                report.values[f"{trend.parameter} drift [%]"] = f"{trend.drift_reference:.2f}"
                if trend.status is TrendStatus.BEYOND_THRESHOLD:
                    report.raise_to(ERROR, f"{trend.parameter}: {trend.reason}")
            if found.verdict.kind.asks_for_help:
                level = ERROR if advice.severity is Severity.ERROR else WARN
                report.raise_to(level, found.verdict.evidence)
        return report

    def _look_at_faults(self, valve: MonitoredValve) -> None:
        """Report the fault that the verdict names under the part that has it, and no other."""
        found = valve.assessment
        named = found.named if found is not None else None
        told = (DIAGNOSED[named.part], named.fault) if named is not None else ("", "")
        for fault in self.faults.faults(valve.name):
            filed = fault.kind.code, fault.subject
            if fault.kind.code in DIAGNOSED.values() and filed != told:
                self.faults.passed(fault.kind.code, valve=valve.name, subject=fault.subject)
        if found is not None and named is not None:
            kind = diagnosed(named.part, advise(found.verdict, found.trends))
            evidence = describe_finding(named)
            self.faults.report(kind, evidence, valve=valve.name, subject=named.fault)
