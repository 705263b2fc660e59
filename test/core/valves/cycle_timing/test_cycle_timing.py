# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The timing of a fixed cycle: what it measures, what it refuses, how it predicts."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from test.core.valves import blocks
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.cycles import Segmenter
from valve_twin.core.estimation.cycle.memory import Memory, model_in_force
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.types import (
    Cycle,
    CycleRule,
    EstimateStatus,
    FloatArray,
    Frames,
    ParameterStatus,
    Validity,
)
from valve_twin.core.valves.cycle_timing import MODEL
from valve_twin.core.valves.cycle_timing.timing import self_centred
from valve_twin.core.valves.registry import complete_options, get_model
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import ConfigError

PERIOD_S = 0.1
N = 600
OPTIONS = complete_options(MODEL, {"healthy_instant_s": 9.7, "healthy_flow": 8.0})


def make_cycle(shift_s=0.0, steady=8.0, noise=0.0, seed=1, number=1):
    """Return a minute of flow, averaged over each sample: a spike at 9.4 s + shift, then rest."""
    fine = (np.arange(N * 50) + 0.5) * PERIOD_S / 50 - PERIOD_S
    since = fine - 9.4 - shift_s
    spike = np.where(since > 0.0, steady + 12.5 * np.exp(-np.maximum(since, 0.0) / 0.4), 0.0)
    flow = spike.reshape(N, 50).mean(axis=1)
    flow = flow + np.random.default_rng(seed).normal(0.0, noise, N) if noise else flow
    stamps = (np.arange(N) * PERIOD_S * 1e9).astype(np.int64) + number * 60_000_000_000
    nothing = np.full(N, np.nan)
    frames = Frames(stamps, flow, np.empty((N, 0)), nothing, nothing, np.ones(N, dtype=bool))
    return Cycle(number, PERIOD_S, frames)


def estimate(cycle, options=OPTIONS):
    (found,) = MODEL.estimate(cycle, options)
    return found


@pytest.mark.parametrize("shift_s", [0.03, 0.05, 0.14, 0.31, 0.5])
def test_a_later_spike_is_reported_later_wherever_the_samples_fall(shift_s):
    starts = np.linspace(0.0, PERIOD_S, 11)
    lags = [
        estimate(make_cycle(s + shift_s)).value("valve_lag")
        - estimate(make_cycle(s)).value("valve_lag")
        for s in starts
    ]
    assert np.mean(lags) == pytest.approx(shift_s, abs=0.004)
    assert np.abs(np.array(lags) - shift_s).max() < 0.3 * PERIOD_S


def test_leakage_and_lag_do_not_disturb_one_another():
    new = estimate(make_cycle())
    leaking = estimate(make_cycle(steady=7.6))
    late = estimate(make_cycle(shift_s=0.3))
    assert leaking.value("pump_leakage") - new.value("pump_leakage") == pytest.approx(
        0.4, rel=1e-6
    )
    assert abs(leaking.value("valve_lag") - new.value("valve_lag")) < 0.004
    assert late.value("pump_leakage") == pytest.approx(new.value("pump_leakage"), abs=1e-9)


def test_the_references_are_taken_off():
    found = estimate(make_cycle())
    assert found.value("valve_lag") == pytest.approx(found.value("switching_instant") - 9.7)
    assert found.value("pump_leakage") == pytest.approx(8.0 - found.value("steady_flow"))
    assert found.status is EstimateStatus.ACCEPTED


def test_a_window_centred_on_itself_moves_with_what_it_weighs():
    t = np.arange(200, dtype=np.float64) * 0.01
    spike: FloatArray = np.exp(-0.5 * ((t - 1.0) / 0.05) ** 2)
    later: FloatArray = np.exp(-0.5 * ((t - 1.0371) / 0.05) ** 2)
    assert self_centred(t, spike, 0.95, 0.2) == pytest.approx(1.0, abs=1e-9)
    assert self_centred(t, later, 0.95, 0.2) == pytest.approx(1.0371, abs=1e-6)


def test_no_spike_is_a_refusal_and_the_steady_flow_stands():
    cycle = make_cycle()
    flat = replace(cycle, frames=replace(cycle.frames, position=np.full(N, 8.0)))
    found = estimate(flat)
    assert found.status is EstimateStatus.PARTIAL
    assert "no spike from 9 to 10.5 s" in found.reason
    assert found.value("steady_flow") == pytest.approx(8.0)
    by_name = {p.name: p for p in found.parameters}
    assert by_name["valve_lag"].status is ParameterStatus.REFUSED
    assert by_name["pump_leakage"].usable


def test_a_hole_in_the_spike_is_a_refusal():
    cycle = make_cycle()
    flow = cycle.frames.position.copy()
    flow[95] = np.nan
    found = estimate(replace(cycle, frames=replace(cycle.frames, position=flow)))
    assert found.status is EstimateStatus.PARTIAL
    assert "the flow is not whole from" in found.reason
    assert found.counts.bad == 1


def test_a_cycle_that_ends_early_is_refused():
    cycle = make_cycle()
    found = estimate(replace(cycle, frames=cycle.frames[:60]))
    assert found.status is EstimateStatus.REFUSED
    assert all(p.status is ParameterStatus.REFUSED for p in found.parameters)


def test_a_pump_that_stands_is_no_spike():
    cycle = make_cycle()
    still = replace(cycle, frames=replace(cycle.frames, position=np.zeros(N)))
    assert "no spike" in estimate(still).reason


def test_the_cycle_before_predicts_the_next():
    memory = Memory.empty()
    for number in (1, 2):
        cycle = make_cycle(shift_s=0.04, noise=0.01, seed=number, number=number)
        (found,), memory = estimate_cycle(MODEL, OPTIONS, cycle, memory)
    assert found.fit_test > 80.0
    assert found.fit_train == pytest.approx(found.fit_test, abs=3.0)


def predict(flow, marks, cuts=()):
    """Predict with what one cycle taught, in blocks cut where told."""
    _, memory = estimate_cycle(MODEL, OPTIONS, make_cycle(), Memory.empty())
    force = model_in_force(MODEL, memory, PERIOD_S, OPTIONS)
    assert force is not None
    frames = SimpleNamespace(position=flow, inputs=np.empty((len(flow), 0)))
    return blocks.predict(MODEL, force.coefficients, frames, marks, cuts)


def two_cycles(**marked):
    """Return the flow of two cycles and the marks of their samples."""
    marks = blocks.marked(2 * N, {N: 1})
    for name, at in marked.items():
        marks[at] = {"gap": 2, "bad": 3}[name]
    return np.tile(make_cycle().frames.position, 2), marks


def test_blocks_of_any_length_predict_the_same_bits():
    flow, marks = two_cycles(bad=[7, 640])
    whole = predict(flow, marks)
    cut = predict(flow, marks, cuts=(1, 94, 95, 599, 600, 601))
    for one, other in zip(whole, cut, strict=True):
        assert one.tobytes() == other.tobytes()
    assert whole[2][7] == Validity.BAD_INPUT
    assert np.isfinite(whole[0][N + 300])


def test_behind_a_gap_the_phase_is_unknown_until_the_next_cycle():
    predicted, _, validity = predict(*two_cycles(gap=[50]))
    assert np.isnan(predicted[50:N]).all()
    assert set(validity[50:N]) == {Validity.STARTING}
    assert np.isfinite(predicted[N + 300])


def test_a_model_without_a_command_cannot_be_cut_by_one(tmp_path):
    file = tmp_path / "rig.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    valves: [rig]\n"
        "    model: cycle_timing\n    period_s: 0.1\n",
        encoding="utf-8",
    )
    with pytest.raises(ConfigError, match="'cycle_timing' has none; write window"):
        load_config(file)
    assert get_model("cycle_timing").inputs == ()
    Segmenter(CycleConfig(rule=CycleRule.WINDOW), (), PERIOD_S)
    with pytest.raises(ValueError, match="this model has none"):
        Segmenter(CycleConfig(), (), PERIOD_S)
