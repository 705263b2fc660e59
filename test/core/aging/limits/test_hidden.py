# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What cycles scatter too much to show is told, with what would show it."""

import numpy as np

from valve_twin.core.aging.limits.hidden import hidden_in, with_hidden
from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.diagnosis.table import SHOWN_BY, with_floor
from valve_twin.core.past.columns import past_of
from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL

TABLE, KIND = MODEL.signatures(), MODEL.feature_set
GAS = "gas in the chamber"


def said(**scatter):
    """Return what is said of 48 cycles, of which features scatter more than simulated ones."""
    return hidden_in(cycles_that(**scatter))


def cycles_that(**scatter):
    covariance = with_floor(np.array(TABLE.covariance), np.array(TABLE.floor))
    rows = np.random.default_rng(1).standard_normal((48, len(covariance)))
    rows = rows @ np.linalg.cholesky(covariance).T
    for name, times in scatter.items():
        rows[:, KIND.names.index(name)] *= times
    return past_of([cycle(k, row) for k, row in enumerate(rows, 1)])


def cycle(number, row):
    values = (np.exp(x) if n in KIND.relative else x for n, x in zip(KIND.names, row, strict=True))
    stamp = number * 30 * 10**9
    return Estimate(
        model=MODEL.name,
        estimator=ESTIMATOR,
        cycle=number,
        start_ns=stamp,
        end_ns=stamp + 25 * 10**9,
        parameters=tuple(
            ParameterValue(n, float(v)) for n, v in zip(KIND.names, values, strict=True)
        ),
        status=EstimateStatus.PARTIAL,
        reason="",
    )


def test_a_valve_that_scatters_as_the_simulated_one_hides_no_medium_fault():
    assert said() == ""


def test_delays_that_scatter_hide_gas_and_the_size_that_shows_is_told():
    hidden = said(delay_in=20.0, delay_out=20.0, gain_out_high=8.0)
    assert hidden.startswith("what these cycles do not show: ")
    assert GAS in hidden
    assert SHOWN_BY["aeration"] in hidden


def test_no_valve_without_features_is_said_to_hide_any():
    assert hidden_in(past_of([])) == ""


def test_only_an_ok_tells_what_is_hidden():
    past = cycles_that(delay_in=20.0, delay_out=20.0, gain_out_high=8.0)
    ok, other = (
        Verdict(0, "v1", kind, kind.text, "largest drift: none", 48)
        for kind in (VerdictKind.OK, VerdictKind.SENSOR)
    )
    assert with_hidden(ok, past).evidence == f"largest drift: none; {hidden_in(past)}"
    assert with_hidden(other, past) is other
