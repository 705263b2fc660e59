# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Columns hold what the estimates hold, and stay as they are while more come."""

from dataclasses import replace

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR, FeatureSet
from valve_twin.core.diagnosis.generic.motion import Motion
from valve_twin.core.past.columns import Table, past_of
from valve_twin.core.past.state import AgingState
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.types import (
    Condition,
    Estimate,
    EstimateStatus,
    Guard,
    ParameterStatus,
    ParameterValue,
)


def estimate(cycle, *parameters, **fields):
    return Estimate(
        **{
            "model": "m", "estimator": "e", "cycle": cycle, "start_ns": 10 * cycle,
            "end_ns": 10 * cycle + 9, "parameters": parameters,
            "status": EstimateStatus.ACCEPTED, "reason": "fine", "used_by_trend": True, **fields,
        }
    )  # fmt: skip


def test_every_value_comes_back_after_many_growths():
    history = [
        estimate(
            c,
            ParameterValue("a", float(c)),
            *([ParameterValue("b", -1.0, ParameterStatus.AT_BOUND)] if c % 3 else []),
            missed_cycles=c % 2,
            mse_test=0.5 * c,
            conditions=(Condition("load", 2.0 * c),),
        )
        for c in range(1, 1001)
    ]
    rows = past_of(history).trend
    for name in ("a", "b", "unknown"):
        assert np.array_equal(rows.value(name), [e.value(name) for e in history], equal_nan=True)
    assert np.isnan(rows.usable("b")).all()
    assert rows.usable("a").tolist() == [float(e.cycle) for e in history]
    assert rows.missed.tolist() == [e.missed_cycles for e in history]
    assert rows.error.tolist() == [e.mse_test for e in history]
    assert rows.condition("load").tolist() == [e.conditions[0].value for e in history]
    assert np.isnan(rows.condition("unknown")).all()


def test_rows_that_were_taken_stay_while_more_come():
    growing = AgingState()
    for cycle in range(1, 65):
        growing.add(estimate(cycle, ParameterValue("a", 1.0)))
    taken = growing.past().trend
    for cycle in range(65, 200):
        growing.add(estimate(cycle, ParameterValue("a", 2.0), ParameterValue("new", 2.0)))
    assert len(taken) == 64
    assert taken.value("a").tolist() == [1.0] * 64
    assert np.isnan(taken.value("new")).all()
    assert np.isnan(growing.past().trend.value("new")[:64]).all()


def test_reasons_and_failed_checks_go_with_their_rows():
    failed = Guard("bounds", False, 1.0, 2.0, "out of range")
    refused = {"status": EstimateStatus.REFUSED, "reason_code": RefusalCode.IMPLAUSIBLE}
    history = [
        estimate(1, guards=(failed, replace(failed, passed=True))),
        estimate(2, reason="upside down", **refused),
    ]
    past = past_of(history)
    rows = past.trend.take(np.array([1, 0]))
    assert rows.given.tolist() == [False, True]
    assert rows.implausible.tolist() == [True, False]
    assert rows.reasons[rows.key[0]] == "upside down"
    assert rows.failed[rows.key[1]] == (failed,)
    assert past.apart == (2,)


def test_a_cycle_is_found_by_number_and_end_also_where_ends_repeat():
    rows = past_of([estimate(c, end_ns=e) for c, e in ((1, 5), (2, 7), (3, 7), (1, 9))]).trend
    cycle, end_ns = np.array([3, 2, 1, 1, 2]), np.array([7, 7, 9, 5, 9])
    assert rows.at(cycle, end_ns).tolist() == [2, 1, 3, 0, -1]
    alone = rows.take(np.array([0, 1]))
    assert alone.at(cycle, end_ns).tolist() == [-1, 1, -1, 0, -1]


def test_features_of_many_cycles_are_those_of_each():
    kind = FeatureSet(("a", "b"), relative=frozenset({"b"}))
    random = np.random.default_rng(0)
    history = [
        estimate(
            c,
            ParameterValue("a", float(random.random())),
            ParameterValue("b", float(random.random()), ParameterStatus(2 * (c % 5 == 0))),
            estimator="features",
            used_by_trend=False,
        )
        for c in range(300)
    ]
    past = past_of(history)
    assert not len(past.trend)
    each = np.array([kind.vector(e.parameters) for e in history])
    assert np.array_equal(kind.vectors(past.features.usable), each, equal_nan=True)


def test_a_motion_takes_no_columns_and_lasts_as_long_as_its_row():
    motion = Motion(0.1, 1e-3, 0.0, (0.0, 9.0, 19.0), (0.0, 0.2, 1.0))
    table = Table()
    for cycle in range(1, 81):
        own = motion.values() if cycle in {3, 70} else ()
        shown = (ParameterValue("a", float(cycle)), *own)
        table.add(estimate(cycle, *shown, estimator=ESTIMATOR))
    numbers = tuple(p.value for p in motion.values())
    assert table.rows().motions == {2: numbers, 69: numbers}
    assert set(table.rows().parameters) == {"a"}
    assert table.rows().value("a").tolist() == [float(c) for c in range(1, 81)]
    table.keep(np.arange(40, 80))
    arrays: list[np.ndarray] = []
    head = table.freeze(arrays)
    assert Table.thaw(head, arrays).rows().motions == {69: numbers}
    arrays = []
    older = {k: v for k, v in table.freeze(arrays).items() if k != "motions"}
    assert Table.thaw(older, arrays).rows().motions == {}
