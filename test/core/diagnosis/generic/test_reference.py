# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Features on the way of every cycle: the reference that stays, and the verdict they give."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.diagnosis.features import ESTIMATOR, NOISE
from valve_twin.core.diagnosis.generic.features import MOVE_NOISE, NAMES
from valve_twin.core.diagnosis.generic.motion import numbers_of
from valve_twin.core.diagnosis.generic.reference import (
    REFERENCE_CYCLES,
    has_reference,
    published,
    reference_of,
)
from valve_twin.core.estimation.cycle.memory import Memory, memory_from_history
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.past.columns import past_of
from valve_twin.core.simulation.block import to_frames
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.types import Cycle, Estimate
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation

MODEL = get_model("first_order")
OPTIONS = complete_options(MODEL, {"estimators": ["output_error", "features"]})
ONSET, CYCLES = 34, 40


def run(fault=""):
    """Return the history of a valve with a fault from cycle ONSET on, and its last memory."""
    config = get_simulation("first_order")
    valve, memory = SimulatedValve(config, 7), Memory.empty()
    history: list[Estimate] = []
    for number in range(1, CYCLES + 1):
        if fault and number == ONSET:
            valve.set_fault(fault, 0.004)
        frames = to_frames(valve.advance(config.cycle_samples))
        cycle = Cycle(number, config.period_s, frames)
        done, memory = estimate_cycle(MODEL, OPTIONS, cycle, memory)
        history += done
    return history, memory


@pytest.fixture(scope="module")
def faulty():
    return run("sensor_offset")


def features(history):
    return [e for e in history if e.estimator == ESTIMATOR]


def test_every_cycle_has_features_and_those_of_the_first_have_no_reference(faulty):
    shown = features(faulty[0])
    assert [e.cycle for e in shown] == list(range(1, CYCLES + 1))
    against = has_reference(past_of(shown[:7]).features)
    assert against.tolist() == [False] * REFERENCE_CYCLES + [True, True]
    assert "no reference model before 5 accepted cycles" in shown[0].reason


def test_the_reference_stays_though_the_estimates_follow_the_valve(faulty):
    shown = features(faulty[0])
    kept = {e.value("reference.time_constant") for e in shown[REFERENCE_CYCLES:]}
    assert len(kept) == 1
    assert kept.pop() == pytest.approx(0.4, rel=0.02)


def test_a_restart_from_the_history_goes_on_with_the_same_reference(faulty):
    history, memory = faulty
    again = memory_from_history(history)
    assert reference_of(MODEL, again.estimates) == reference_of(MODEL, memory.estimates)


@pytest.mark.no_cover
def test_the_verdict_names_the_fault(faulty):
    found = assess(faulty[0], (), AgingConfig(), parameters=MODEL.parameters)
    assert found.verdict.text == "sensor"
    assert found.verdict.fault == "sensor_offset"
    present = found.diagnosis.present
    assert present is not None
    assert present.onset == ONSET
    assert present.severity == pytest.approx(0.004, rel=0.1)


@pytest.mark.no_cover
def test_a_healthy_valve_is_no_reference_first_and_then_in_order():
    history, _ = run()
    verdict = assess(history, (), AgingConfig(), parameters=MODEL.parameters).verdict
    assert verdict.text == "ok"
    early = [e for e in history if e.cycle <= 15]
    assert assess(early, (), AgingConfig(), parameters=MODEL.parameters).verdict.text != "ok"


def as_before(estimate):
    """Return features as they were stored when the noise was that of the whole cycle."""
    kept = [
        replace(p, value=3.0 * p.value) if p.name == NOISE else p
        for p in estimate.parameters
        if p.name != MOVE_NOISE
    ]
    return replace(estimate, parameters=tuple(kept))


@pytest.mark.no_cover
def test_features_stored_before_the_noise_was_that_of_rest_raise_no_alarm():
    before = [as_before(e) if e.cycle <= 25 and e.estimator == ESTIMATOR else e for e in run()[0]]
    found = assess(before, (), AgingConfig(), parameters=MODEL.parameters)
    assert found.diagnosis.findings == ()
    assert found.verdict.text == "ok"


def test_features_come_only_where_they_are_asked_for():
    config = get_simulation("first_order")
    frames = to_frames(SimulatedValve(config, 7).advance(config.cycle_samples))
    done, _ = estimate_cycle(
        MODEL, MODEL.options, Cycle(1, config.period_s, frames), Memory.empty()
    )
    assert features(done) == []


def test_a_cycle_with_missing_samples_shows_nothing(faulty):
    config = get_simulation("first_order")
    frames = to_frames(SimulatedValve(config, 7).advance(config.cycle_samples))
    valid = np.arange(len(frames)) % 20 != 0
    cycle = Cycle(CYCLES + 1, config.period_s, replace(frames, valid=valid))
    done, _ = estimate_cycle(MODEL, OPTIONS, cycle, faulty[1])
    (shown,) = features(done)
    assert not np.isfinite([shown.value(n) for n in NAMES]).any()


def test_the_motion_travels_with_the_first_features_that_have_a_reference(faulty):
    with_motion = [e.cycle for e in features(faulty[0]) if numbers_of(e)]
    assert with_motion == [REFERENCE_CYCLES + 1]
    assert len(past_of(faulty[0]).features.motions) == 1


def test_all_that_is_published_has_a_unit(faulty):
    units = {p.name: p.unit for p in published(MODEL)}
    assert {p.name for e in faulty[0] for p in e.parameters} <= set(units)
    assert units["lag_up"] == units["reference.time_constant"] == "s"
