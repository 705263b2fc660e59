# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A memory of features saves judging cycles anew and changes no bit of what is said."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.diagnosis.features import DELAYS, ESTIMATOR, NOISE
from valve_twin.core.diagnosis.generic.features import MOVE_NOISE
from valve_twin.core.diagnosis.generic.reference import _PREFIX
from valve_twin.core.diagnosis.generic.signatures import signatures_of
from valve_twin.core.diagnosis.history import diagnose
from valve_twin.core.diagnosis.watch import alarm, straight
from valve_twin.core.diagnosis.watch.memory import Known
from valve_twin.core.past.state import AgingState
from valve_twin.core.types import Estimate, EstimateStatus, Maintenance, ParameterValue
from valve_twin.core.valves.registry import get_model

CYCLES = 130
PRESS, ANY = get_model("press_cartridge"), get_model("servo_system")


def drawn(model, seed, cycles=CYCLES):
    """Return (N, F) features with what a search has to tell apart, by a seed."""
    table, random = signatures_of(model), np.random.default_rng(seed)
    assert table is not None
    covariance = np.array(table.covariance)
    deviation = np.sqrt(np.diag(covariance))
    rows = random.multivariate_normal(np.zeros(len(deviation)), covariance, cycles)
    if seed % 3 == 1:  # wanders
        rows += 0.3 * np.cumsum(random.standard_normal(rows.shape), axis=0) * deviation
    for _ in range(seed % 4):  # faults, most of which end
        fault = table.signatures[random.integers(len(table.signatures))]
        first = random.integers(cycles)
        last = first + random.choice([1, 2, 6, 20, 1000])
        rows[first:last] += random.uniform(0.7, 2.0) * np.array(fault.change)
    for row in random.integers(cycles, size=3):  # outliers
        rows[row] += 30.0 * random.standard_normal(len(deviation)) * deviation
    if seed % 2:  # not every cycle shows all
        rows[random.random(rows.shape) < 0.05] = np.nan
        rows[random.random(cycles) < 0.05] = np.nan
    names = table.features
    if DELAYS[0] in names and seed % 5 < 2:  # a slip; clocks that run apart
        rows[random.integers(cycles) :, names.index(DELAYS[0])] += 0.02
        both = [names.index(n) for n in DELAYS]
        rows[:, both] += 1e-3 * (seed % 5) * np.arange(cycles)[:, None]
    if NOISE in names and seed % 3 == 0:
        first = random.integers(cycles)
        rows[first : first + random.choice([5, 30, 1000]), names.index(NOISE)] += 1.0
    return rows


def history_of(model, rows, products=1):
    """Return the estimates that hold (N, F) features as they are followed, of some products."""
    kind, found, start = model.feature_set, [], 0
    relative = np.isin(kind.names, sorted(kind.relative))
    beside = [ParameterValue(_PREFIX + "gain", 1.0), ParameterValue(MOVE_NOISE, 1.0)]
    for n, row in enumerate(np.where(relative, np.exp(rows), rows).tolist()):
        length = (20 + 6 * (n // 5 % products)) * 10**9
        found.append(
            Estimate(
                model=model.name,
                estimator=ESTIMATOR,
                cycle=n + 1,
                start_ns=start,
                end_ns=start + length,
                parameters=(
                    *map(ParameterValue, kind.names, row),
                    *(beside if kind.of_any_valve else ()),
                ),
                status=EstimateStatus.PARTIAL,
                reason="",
            )
        )
        start += length + 5 * 10**9
    return found


def grown(history, known, *, maintenance=(), told=0, kept=2048, step=1):
    """Yield what is said of a history as it grows, with what was found before and without.

    Cycles come in steps of some; maintenance is told from a cycle on.
    """
    state = AgingState(recent_features=kept)
    for n, estimate in enumerate(history):
        state.maintenance = maintenance if n >= told else ()
        state.add(estimate)
        if n % step == 0:
            past = state.past()
            said = diagnose(past, state.maintenance, known)
            yield said, diagnose(past, state.maintenance) if n % 8 == 0 else said


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(n, marks=pytest.mark.no_cover) for n in range(2, 12))]
)
@pytest.mark.parametrize("model", [PRESS, ANY], ids=["press valve", "any valve"])
def test_it_changes_no_bit(model, seed):
    mark = Maintenance(0, 60, "") if seed % 4 == 3 else None
    history = history_of(model, drawn(model, seed), products=1 + seed % 3)
    said = grown(
        history,
        Known(),
        maintenance=(mark,) if mark else (),
        told=60 + 20 * (seed % 2),
        kept=30 if seed % 5 == 4 else 2048,
        step=(1, 1, 3)[seed % 3],
    )
    for with_memory, without in said:
        assert repr(with_memory) == repr(without)


@pytest.mark.no_cover
def test_the_drawn_histories_hold_faults_that_last_and_that_are_over():
    ends = [
        finding.end >= 0
        for seed in range(12)
        for finding in diagnose(history_of(PRESS, drawn(PRESS, seed)), ()).findings
    ]
    assert {True, False} == set(ends)
    assert len(ends) > 10


@pytest.fixture
def judged(monkeypatch):
    """Return a list that gets the number of rows of every judgement."""
    rows, follow = [], straight.follow

    def counted(*arguments):
        rows.append(len(arguments[-1]))
        return follow(*arguments)

    monkeypatch.setattr(alarm, "follow", counted)
    return rows


def test_a_cycle_is_judged_once(judged):
    history = history_of(PRESS, drawn(PRESS, 12)[:100])
    for n, _ in enumerate(grown(history, Known(), step=1)):
        if n < 60:
            judged.clear()
    assert judged
    assert max(judged) < 100  # what is said without a memory
    assert sum(rows == 1 for rows in judged) >= 39 * 6


def test_no_cycle_long_behind_an_alarm_is_judged(judged):
    rows, table = drawn(PRESS, 0, 3000), signatures_of(PRESS)
    assert table is not None
    rows[300:] += 2.0 * np.array(table.signatures[0].change)
    found = diagnose(history_of(PRESS, rows), ())
    assert found.findings[0].onset == 301
    assert max(judged) < 1000


def test_other_values_in_the_same_place_are_judged_anew():
    rows, known = drawn(PRESS, 12), Known()
    before = diagnose(history_of(PRESS, rows), (), known)
    rows[50:, 3] += 5.0
    other = history_of(PRESS, rows)
    assert repr(diagnose(other, (), known)) == repr(diagnose(other, ()))
    assert repr(diagnose(other, ())) != repr(before)
    fewer = [replace(e, cycle=e.cycle + 3) for e in other[:70]]
    assert repr(diagnose(fewer, (), known)) == repr(diagnose(fewer, ()))
