# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The verdict of a stored history names the part that has the fault, its size and its onset."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig, Commissioning
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import SimulatedValve, to_frames
from valve_twin.core.types import Cycle, Maintenance
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.registry import complete_options
from valve_twin.io.history.tables import estimate_row, row_estimate

OPTIONS = complete_options(MODEL, {"estimators": ["output_error", "features"]})
BEFORE = 30


def run_on(valve, cycles, history, memory):
    """Return history and memory after further cycles, as stored and read again."""
    for _ in range(cycles):
        frames = to_frames(valve.advance(850))
        cycle = Cycle(valve.cycle, 0.03, frames)
        estimates, memory = estimate_cycle(MODEL, OPTIONS, cycle, memory)
        history = [*history, *(row_estimate(estimate_row(1, 0, e)) for e in estimates)]
    return history, memory


@pytest.fixture(scope="module")
def healthy():
    valve = SimulatedValve(MODEL.simulation(), 5)
    history, memory = run_on(valve, BEFORE, [], Memory.empty())
    return valve, history, memory


def assess_fault(healthy, kind, severity, cycles=4, **options):
    start, history, memory = healthy
    valve = deepcopy(start)
    valve.set_fault(kind, severity)
    history, _ = run_on(valve, cycles, history, memory)
    events = options.get("maintenance", ())
    return assess(
        history, events, options.get("config", AgingConfig()), parameters=MODEL.parameters
    )


@pytest.mark.no_cover
def test_a_healthy_valve_is_ok(healthy):
    said = assess(healthy[1], (), AgingConfig(), parameters=MODEL.parameters)
    assert said.verdict.kind is VerdictKind.OK
    assert not said.verdict.fault
    assert said.diagnosis.ready
    assert said.diagnosis.present is None


def commissioned(history, known=7):
    """Return rules with a record of every followed parameter, of the first cycles."""
    first = [e for e in history if e.used_by_trend][:known]
    records = [
        Commissioning(p.name, float(np.mean([e.value(p.name) for e in first])))
        for p in MODEL.parameters
        if p.trend
    ]
    return AgingConfig(commissioning=tuple(records))


def test_with_a_record_of_every_parameter_a_healthy_valve_is_ok_as_when_new(healthy):
    rules = commissioned(healthy[1], BEFORE)
    said = assess(healthy[1], (), rules, parameters=MODEL.parameters)
    assert {t.reference_source for t in said.trends} == {"commissioning"}
    assert said.verdict.kind is VerdictKind.OK
    assert "no claim" not in said.verdict.evidence


@pytest.mark.no_cover
@pytest.mark.parametrize(("kind", "severity"), [("coil_resistance", 0.1), ("leak", 3e-4)])
def test_a_record_of_the_parameters_is_none_of_the_features(kind, severity):
    """A fault since cycle 8 is not "ok" while nothing can show it."""
    valve = SimulatedValve(MODEL.simulation(), 5)
    history, memory = run_on(valve, 7, [], Memory.empty())
    rules = commissioned(history)
    valve.set_fault(kind, severity)
    for _ in range(8, 20):
        history, memory = run_on(valve, 1, history, memory)
        said = assess(history, (), rules, parameters=MODEL.parameters)
        assert said.verdict.kind is not VerdictKind.OK, said.verdict.evidence


@pytest.mark.parametrize(
    ("kind", "severity", "verdict", "fault", "evidence"),
    [
        ("leak", 3e-4, VerdictKind.VALVE, "leak", "leak of the chamber, size 0.0003"),
        ("dead_band", 0.01, VerdictKind.VALVE, "dead_band", "grown dead band, size 0.0"),
        (
            "sensor_offset",
            -1e-3,
            VerdictKind.SENSOR,
            "sensor_offset",
            "offset of the position sensor, share of the travel, size -0.00",
        ),
        (
            "sensor_freeze",
            0.0,
            VerdictKind.SENSOR,
            "sensor_freeze",
            "freezing position sensor, size 1",
        ),
        (
            "command_loss",
            0.1,
            VerdictKind.COMMAND,
            "command_loss",
            "command that does not reach the valve",
        ),
        ("command_loss", 1.0, VerdictKind.VALVE, "no_motion", "no command reaches it"),
        ("stuck", 0.0, VerdictKind.VALVE, "no_motion", "the spool is stuck"),
        (
            "supply_drop",
            0.1,
            VerdictKind.SUPPLY,
            "supply_drop",
            "the data fit as well: gain of the position",
        ),
    ],
)
def test_the_part_with_the_fault_is_named(healthy, kind, severity, verdict, fault, evidence):
    said = assess_fault(healthy, kind, severity).verdict
    assert said.kind is verdict, said.evidence
    assert said.fault == fault
    assert evidence in said.evidence
    assert f"since cycle {BEFORE + 1}" in said.evidence or kind in {"stuck", "command_loss"}
    assert "\n" not in said.evidence


def test_lost_samples_are_no_fault_of_the_valve(healthy):
    assert assess_fault(healthy, "lost_samples", 0.2).diagnosis.findings == ()


def test_maintenance_takes_the_fault_back(healthy):
    event = Maintenance(0, BEFORE + 4, "sensor adjusted")
    said = assess_fault(healthy, "sensor_offset", 1e-3, maintenance=(event,))
    assert said.verdict.kind is not VerdictKind.SENSOR
    assert [f.end for f in said.diagnosis.findings] == [BEFORE + 4]


def test_cycles_that_differ_by_label_give_no_fault(healthy):
    said = assess_fault(healthy, "leak", 3e-4, config=AgingConfig(label="by load"))
    assert said.verdict.kind is VerdictKind.NOT_ENOUGH_DATA
    assert said.diagnosis.findings == ()


def test_a_history_without_features_has_the_verdict_of_its_trends(healthy):
    history = [e for e in healthy[1] if e.used_by_trend]
    said = assess(history, (), AgingConfig(), parameters=MODEL.parameters)
    assert said.verdict.kind is VerdictKind.OK
    assert not said.diagnosis.ready


def test_ok_waits_for_one_more_cycle_where_the_newest_departs(healthy):
    first = assess_fault(healthy, "coil_resistance", 0.1, cycles=1).verdict
    assert (first.kind, first.fault) == (VerdictKind.NOT_ENOUGH_DATA, "")
    assert first.held_back
    assert first.evidence.startswith(f"not yet judged: cycle {BEFORE + 1} lies ")
    later = assess_fault(healthy, "coil_resistance", 0.1, cycles=3).verdict
    assert (later.kind, later.held_back) == (VerdictKind.VALVE, False)


def test_what_is_not_yet_judged_is_told_of_the_cycle_that_departs(healthy):
    start, history, memory = healthy
    valve = deepcopy(start)
    valve.set_fault("coil_resistance", 0.1)
    history, memory = run_on(valve, 1, history, memory)
    frames = to_frames(valve.advance(850))
    lost = replace(frames, valid=np.arange(len(frames)) % 8 != 0)
    refused, _ = estimate_cycle(MODEL, OPTIONS, Cycle(valve.cycle, 0.03, lost), memory)
    history = [*history, *(row_estimate(estimate_row(1, 0, e)) for e in refused)]
    said = assess(history, (), AgingConfig(), parameters=MODEL.parameters).verdict
    assert said.cycle == BEFORE + 2
    assert said.evidence.startswith(f"not yet judged: cycle {BEFORE + 1} lies ")
