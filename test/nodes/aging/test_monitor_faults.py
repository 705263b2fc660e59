# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A sudden fault in the stored features: verdict, diagnostics, and what the twin keeps of it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import DurabilityPolicy, QoSProfile
from valve_twin_msgs.msg import Verdict

from test.nodes.aging.test_node import aging_valve, record_of
from test.nodes.conftest import NS
from valve_twin.core.aging.assess import Assessment
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.verdict import decide
from valve_twin.core.diagnosis.changes.finding import FRESH, Diagnosis, Finding, Stale
from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.diagnosis.table import with_floor
from valve_twin.core.faults.kinds import FAULT_KINDS
from valve_twin.core.faults.lifetime import FaultBook, Moment, Status
from valve_twin.core.simulation import SimulatedValve, to_frames
from valve_twin.core.types import Cycle, Estimate, EstimateStatus, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.press_cartridge.diagnosis.features import NAMES, RELATIVE
from valve_twin.core.valves.registry import complete_options
from valve_twin.io.history.store import History
from valve_twin.nodes.aging.node import AgingMonitorNode
from valve_twin.nodes.twin.node import TwinNode

CYCLES, ONSET = 40, 36
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OPTIONS = {"options.estimators": ["output_error", ESTIMATOR]}


def features():
    """Yield the features of 40 cycles, the sensor 1e-3 off from cycle 36 on."""
    valve = SimulatedValve(MODEL.simulation(), 3)
    cycle = Cycle(1, 0.03, to_frames(valve.advance(850)))
    start = MODEL.feature_set.vector(MODEL.features(cycle, complete_options(MODEL, {})))
    table = MODEL.signatures()
    covariance = with_floor(np.array(table.covariance), np.array(table.floor))
    random = np.random.default_rng(4)
    noise = random.multivariate_normal(np.zeros(len(NAMES)), covariance, CYCLES)
    for n, vector in enumerate(start + noise, 1):
        vector[NAMES.index("rest_level")] += 1e-3 * (n >= ONSET)
        yield tuple(
            ParameterValue(name, float(np.exp(v) if name in RELATIVE else v))
            for name, v in zip(NAMES, vector, strict=True)
        )


@pytest.fixture
def history(tmp_path):
    url = f"sqlite:///{tmp_path}/history.sqlite"
    with History(url) as made:
        for estimate, shown in zip(aging_valve(CYCLES, 0.0), features(), strict=True):
            beside = Estimate(
                model="press_cartridge",
                estimator=ESTIMATOR,
                cycle=estimate.cycle,
                start_ns=estimate.start_ns,
                end_ns=estimate.end_ns,
                parameters=shown,
                status=EstimateStatus.ACCEPTED,
                reason="13 of 13 features of faults are shown",
            )
            made.store(NS, record_of(estimate), [estimate, beside])
    return {"history_url": url}


def test_a_sensor_fault_is_told_stored_and_in_the_diagnostics(graph, history):
    graph.host(TwinNode, **history, **OPTIONS)
    graph.host(AgingMonitorNode, page=15, **OPTIONS)
    verdicts = graph.record(f"{NS}/aging_monitor/verdict", Verdict, LATCHED)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    graph.spin_until(lambda: verdicts, what="a verdict")
    assert verdicts[-1].text == "sensor"
    assert verdicts[-1].verdict == Verdict.SENSOR
    assert verdicts[-1].fault == "sensor_offset"
    assert (
        "offset of the position sensor, share of the travel, size 0.001" in verdicts[-1].evidence
    )
    assert f"since cycle {ONSET}" in verdicts[-1].evidence

    def told():
        return [
            status
            for array in diagnostics
            for status in array.status
            if status.name.endswith(f"aging of {NS}") and "offset" in status.message
        ]

    graph.spin_until(told, what="the fault in the diagnostics")
    assert told()[-1].level == DiagnosticStatus.WARN
    assert any("diagnosis.sensor" in pair.key + pair.value for pair in told()[-1].values)

    def stored():
        with History(history["history_url"], read_only=True) as kept:
            return kept.verdicts(NS)

    graph.spin_until(stored, what="the stored verdict")
    assert stored()[-1].evidence == verdicts[-1].evidence
    assert stored()[-1].fault == verdicts[-1].fault
    assert stored()[-1].cycle == CYCLES


class Book:
    """The faults of a node without the node."""

    def __init__(self):
        self._book = FaultBook(FAULT_KINDS)
        self.faults = self._book.faults

    def report(self, code, evidence, *, valve, subject=""):
        self._book.report(code, evidence, Moment(0.0, 0), unit=valve, subject=subject)

    def passed(self, code, *, valve, subject=""):
        self._book.passed(code, Moment(0.0, 0), unit=valve, subject=subject)


def look_at(book: Book, assessment: Assessment) -> None:
    valve: Any = SimpleNamespace(assessment=assessment, name=assessment.verdict.valve)
    node: Any = SimpleNamespace(faults=book)
    AgingMonitorNode._look_at_faults(node, valve)


@pytest.mark.parametrize(
    ("fault", "since", "raised"),
    [("sensor_offset", 0, True), ("sensor_offset", 32, False), ("clock", 0, False)],
)
def test_diagnostics_raise_a_part_where_the_verdict_names_it(fault, since, raised):
    found = Finding(fault, (), "sensor", 3e-4, 20.0, 1, 20)
    stale = Stale("why", unusable=True, since=since) if since else FRESH
    verdict = decide([], AgingConfig(), valve=NS, stamp_ns=0, cycle=40, fault=found, stale=stale)
    assessment = Assessment((), verdict, (), Diagnosis((found,), 40, ready=True))
    book = Book()
    look_at(book, assessment)
    assert [f.key for f in book.faults(NS)] == [f"diagnosis.sensor.{fault}"] * raised


def test_a_fault_that_gets_another_name_is_healed_under_the_one_before():
    book = Book()
    for name in ("sticking", "no_motion"):
        found = Finding(name, (), "valve", float("nan"), 20.0, 1, 20)
        verdict = decide([], AgingConfig(), valve=NS, stamp_ns=0, cycle=40, fault=found)
        look_at(book, Assessment((), verdict, (), Diagnosis((found,), 40, ready=True)))
    filed = {f.subject: f for f in book.faults(NS)}
    assert filed["sticking"].status is Status.HEALED
    assert filed["no_motion"].is_active
    states = {name: (f.kind.ne107.letter, f.kind.severity.name) for name, f in filed.items()}
    assert states == {"sticking": ("M", "WARN"), "no_motion": ("F", "ERROR")}
    assert filed["no_motion"].kind.remedy.startswith("spool and its command: stop")
