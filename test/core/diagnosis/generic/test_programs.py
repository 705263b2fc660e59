# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Programs of equal duration that are told apart by their levels, where they come in turn."""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.diagnosis.generic.programs import PROGRAM, published, with_programs
from valve_twin.core.diagnosis.history import diagnose, products_of
from valve_twin.core.diagnosis.watch.memory import Known
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.past.columns import past_of
from valve_twin.core.past.state import AgingState
from valve_twin.core.types import Cycle, Estimate, EstimateStatus, Frames, ParameterValue
from valve_twin.core.valves.registry import complete_options, get_model

MODEL = get_model("first_order")
OPTIONS = complete_options(MODEL, {"estimators": ["output_error", "features"]})


def cycle_of(number, *values):
    """Return features of a cycle that hold some numbers of the program, or none."""
    names = ("program.command.mean", "program.command.spread")
    held = tuple(ParameterValue(n, float(v)) for n, v in zip(names, values, strict=False))
    start_ns = number * 10**9
    end_ns = start_ns + 10**9
    status = EstimateStatus.ACCEPTED
    return Estimate(MODEL.name, "features", number, start_ns, end_ns, held, status, "")


def rows(means, spreads=None):
    """Return features of cycles that drive a command to some levels."""
    spreads = np.full(len(means), 0.3) if spreads is None else spreads
    pairs = zip(means, spreads, strict=True)
    return past_of([cycle_of(k + 1, m, s) for k, (m, s) in enumerate(pairs)]).features


def told(means, spreads=None):
    return with_programs(np.zeros(len(means), np.int64), rows(means, spreads)).tolist()


def test_levels_have_the_unit_of_their_command_which_is_no_share_of_a_valve_in_its_own_units():
    assert {p.unit for p in published(MODEL)} == {"1"}
    in_volts: Any = SimpleNamespace(inputs=("u",), normalised=False)
    assert [(p.name, p.unit) for p in published(in_volts)] == [
        ("program.u.mean", ""),
        ("program.u.spread", ""),
    ]


def test_levels_that_come_in_turn_are_products_in_the_order_in_which_they_came():
    levels = [0.5, 0.2, 0.2, 0.5, 0.8] * 8
    assert told(levels) == [0, 1, 1, 0, 2] * 8


def test_programs_of_the_same_mean_differ_by_their_spread():
    assert told([0.4] * 20, [0.3, 0.2] * 10) == [0, 1] * 10


def test_a_level_that_comes_once_and_stays_is_the_same_product():
    assert told([0.5] * 30 + [0.42] * 30) == [0] * 60


@pytest.mark.parametrize("shift", [-0.06, 0.06])
def test_what_a_controller_makes_of_a_fault_at_all_levels_is_no_other_product(shift):
    levels = np.tile([0.2, 0.8, 0.5], 20)
    shifted = np.concatenate([levels, levels + shift])
    assert told(shifted) == [0, 1, 2] * 40


def test_levels_as_they_come_are_one_product():
    rng = np.random.default_rng(4)
    for n in (12, 40, 200):
        assert set(told(rng.uniform(0.1, 0.9, n))) == {0}
        assert set(told(0.5 + 0.02 * rng.standard_normal(n))) == {0}


def test_programs_stay_what_they_were_when_a_ninth_and_a_tenth_come():
    levels = np.linspace(0.05, 0.95, 10)
    eight, ten = levels[:8].tolist() * 8, levels.tolist() * 8
    assert told(eight) == list(range(8)) * 8
    assert told(eight + ten) == list(range(8)) * 8 + [*range(8), 8, 8] * 8


def test_few_cycles_of_another_level_are_of_no_product():
    levels = [0.5, 0.2] * 12
    levels[9] = 0.9
    assert told(levels) == [0, 1] * 4 + [0, -1] + [0, 1] * 7


def test_products_by_duration_are_kept_and_those_without_levels_as_they_are():
    product = np.tile([0, 1, 1, -1], 12)
    means = np.tile([0.5, 0.2, 0.6, 0.9], 12)
    assert with_programs(product, rows(means)).tolist() == [0, 1, 2, -1] * 12
    other = past_of([cycle_of(k + 1) for k in range(8)]).features
    assert with_programs(product[:8], other).tolist() == product[:8].tolist()


@pytest.mark.parametrize("level", [0.3, 55.3])
def test_a_command_that_stays_where_it_is_tells_no_program_by_its_last_bits(level):
    rng = np.random.default_rng(0)
    held = [np.full(rng.integers(120, 123), level) for _ in range(40)]
    spreads = [x.std() for x in held]
    assert np.median(spreads) > 0.0
    assert set(told([x.mean() for x in held], spreads)) == {0}


def test_cycles_of_before_levels_were_stored_stay_a_product_of_their_own():
    new = [cycle_of(31 + k, 0.2 + 0.3 * (k % 2), 0.3) for k in range(20)]
    shown = past_of([*(cycle_of(k + 1) for k in range(30)), *new]).features
    assert with_programs(np.zeros(50, np.int64), shown).tolist() == [2] * 30 + [0, 1] * 10


ONSET, CYCLES = 100, 130
PERIOD_S, SAMPLES, FIRST = 0.1, 120, 8


@lru_cache(maxsize=2)
def dosed(leaks):
    """Return the history of a dosing valve that drives to three levels by chance.

    Its curve is bent, which the model does not know, and the first cycles show one level alone.
    """
    rng, memory = np.random.default_rng(3), Memory.empty()
    history: list[Estimate] = []
    flow = 0.0
    for number in range(1, CYCLES + 1):
        level = rng.choice([0.35, 0.6, 0.85]) if number > FIRST else 0.35
        command = np.where(np.arange(SAMPLES) < 60, level, 0.0)
        opening = np.maximum(command, 0.05 if leaks and number >= ONSET else 0.0)
        position = np.empty(SAMPLES)
        for k, target in enumerate(opening**1.3):
            flow += PERIOD_S * (target - flow) / 0.4
            position[k] = flow
        position += 0.003 * rng.standard_normal(SAMPLES)
        nothing = np.full(SAMPLES, np.nan)
        stamps = ((number * SAMPLES + np.arange(SAMPLES)) * PERIOD_S * 1e9).astype(np.int64)
        valid = np.ones(SAMPLES, np.bool_)
        frames = Frames(stamps, position, command[:, None], nothing, nothing, valid)
        done, memory = estimate_cycle(MODEL, OPTIONS, Cycle(number, PERIOD_S, frames), memory)
        history += done
    return history


@pytest.mark.no_cover
def test_a_leak_is_named_though_levels_change_by_chance():
    history = dosed(leaks=True)
    assert not diagnose([e for e in history if e.cycle < ONSET], ()).findings
    findings = diagnose(history, ()).findings  # of each product
    assert {f.fault for f in findings} == {"end_stop_lower"}
    assert all(ONSET <= f.onset <= ONSET + 5 for f in findings)


def test_a_fault_that_was_told_before_levels_were_stored_stays_told():
    """As after an update of valve_twin: only newer cycles hold levels."""
    updated = 110
    history = [e if e.cycle > updated else without_levels(e) for e in dosed(leaks=True)]
    told_then = diagnose([e for e in history if e.cycle <= updated], ()).findings
    assert told_then
    shown = past_of(history).features
    assert len(set(products_of(shown)[-15:].tolist())) > 1
    assert set(told_then) <= set(diagnose(history, ()).findings)


def without_levels(estimate):
    kept = tuple(p for p in estimate.parameters if not p.name.startswith(PROGRAM))
    return replace(estimate, parameters=kept)


@pytest.mark.no_cover
def test_a_sound_valve_that_drives_to_three_levels_by_chance_has_no_fault():
    found = diagnose(dosed(leaks=False), ())
    assert not found.findings
    assert found.ready
    assert not found.doubt


def test_what_was_found_before_changes_nothing_where_programs_are_told_apart_later():
    """Products get other numbers once their programs come in turn."""
    known, state = Known(), AgingState()
    for n, estimate in enumerate(dosed(leaks=True)):
        state.add(estimate)
        if estimate.estimator == ESTIMATOR and (n < 60 or n % 5 == 0):
            past = state.past()
            assert repr(diagnose(past, (), known)) == repr(diagnose(past, ()))
