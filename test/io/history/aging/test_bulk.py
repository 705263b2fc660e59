# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is made of many rows at once is what is made of them one by one, to the same bits."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from valve_twin.bench.data.years import features, life
from valve_twin.core.diagnosis.features import MOTION
from valve_twin.core.past.state import AgingState
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.types import (
    Condition,
    EstimateStatus,
    Guard,
    Maintenance,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.io.history.aging.bulk import AT_ONCE, add_rows
from valve_twin.io.history.tables import estimate_row, row_estimate

CYCLES = 2 * AT_ONCE
REFUSED = (RefusalCode.FEW_SAMPLES, RefusalCode.IMPLAUSIBLE)


def varied(estimate, random):
    """Return an estimate as they come in a life: most alike, some not."""
    parameters, kind = list(estimate.parameters), int(random.integers(0, 12))
    some = int(random.integers(len(parameters)))
    if kind == 0:
        code = REFUSED[random.integers(2)]
        kept = parameters if random.random() < 0.5 else []
        return replace(
            estimate,
            status=EstimateStatus.REFUSED,
            reason='few of them, "nan"',
            reason_code=code,
            parameters=tuple(kept),
        )
    if kind == 1:
        parameters[some] = replace(
            parameters[some], value=np.nan, status=ParameterStatus.NOT_EXCITED, reason="at rest"
        )
    if kind == 2:
        parameters[some] = replace(parameters[some], upper_95=np.inf)
    if kind == 3:
        parameters = parameters[: 1 + some]
    if kind == 4:
        parameters[some] = replace(parameters[some], name="nan" if some else 'a "nan"')
    if kind == 5:
        parameters.append(parameters[0])  # a name twice
    if kind == 6 and not estimate.used_by_trend:
        parameters += [ParameterValue(f"{MOTION}{k}", 0.1 * k) for k in range(3)]
    if kind == 7:
        estimate = replace(estimate, model="another", missed_cycles=int(random.integers(3)))
    names = ("stroke", "pressure")[: random.integers(0, 3)] if kind == 8 else ("stroke",)
    conditions = [Condition(n, np.nan if kind == 9 else 0.3 * some) for n in names]
    guards = [Guard("structure", kind != 10, 0.1 * some, np.nan, "as it is")]
    return replace(
        estimate,
        parameters=tuple(parameters),
        conditions=tuple(conditions),
        guards=tuple(guards) if some else (),
        mse_test=np.nan if kind == 11 else 1e-6,
    )


def rows_of(seed):
    random = np.random.default_rng(seed)
    rows = []
    for estimates in zip(life(CYCLES), features(CYCLES), strict=True):
        for position, estimate in enumerate(estimates):
            row = estimate_row(1, position, varied(estimate, random))
            rows.append(row)
    return rows


def known(rows, add, maintenance):
    state = AgingState(recent=32, recent_features=64)
    state.maintenance = maintenance
    add(state, rows)
    arrays: list[Any] = []
    head = state.freeze(arrays)
    return repr(head), [a.tobytes() for a in arrays], [a.dtype for a in arrays]


def refuse(row):
    pytest.fail(f"cycle {row['cycle']} went alone")


def one_by_one(state, rows):
    for row in rows:
        state.add(row_estimate(row))


@pytest.mark.parametrize("seed", range(6))
def test_rows_at_once_make_what_they_make_one_by_one(seed):
    rows = rows_of(seed)
    marks = [Maintenance(cycle=CYCLES // 3, stamp_ns=0, note="new spool", new_reference=True)]
    alone: list[Any] = []

    def read(row):
        alone.append(row)
        return row_estimate(row)

    def at_once(state, rows):
        add_rows(state, rows, read)

    assert known(rows, at_once, marks) == known(rows, one_by_one, marks)
    assert 0 < len(alone) < 0.4 * len(rows)


def test_rows_that_are_alike_go_together():
    rows = [estimate_row(1, 0, e) for e in life(CYCLES)]
    state = AgingState()
    add_rows(state, rows, refuse)
    assert len(state.past().trend) == CYCLES


def test_a_damaged_text_is_told_as_that_of_one_row_is():
    rows = [estimate_row(1, 0, e) for e in life(3)]
    rows[1]["parameters"] = rows[1]["parameters"].replace("1.0", "1.0.0", 1)
    with pytest.raises(ValueError, match="delimiter"):
        add_rows(AgingState(), rows)
