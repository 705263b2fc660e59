# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Numbers, dates and ticks as a reader expects them."""

import numpy as np
import pytest

from valve_twin.report.svg import round_ticks, thin, tick_texts
from valve_twin.report.text import count, fixed, number, percent, when, with_interval


@pytest.mark.parametrize(
    ("x", "text"),
    [
        (0.0512345, "0.05123"),
        (-1.5, "−1.500"),
        (0.0, "0"),
        (np.nan, "–"),
        (np.inf, "∞"),
        (1.234e-7, "1.234·10<sup>−7</sup>"),
        (9876.5, "9876" if f"{9876.5:.0f}" == "9876" else "9877"),
    ],
)
def test_numbers(x: float, text: str) -> None:
    assert number(x) == text


def test_an_interval_sets_the_decimals() -> None:
    assert with_interval(0.0435678, 0.0434, 0.0437) == "0.04357<small>0.04340 … 0.04370</small>"
    assert with_interval(0.0435678, np.nan, np.nan) == "0.04357"
    assert with_interval(np.nan, 1.0, 2.0) == "–"
    assert percent(-14.36, -14.8, -14.0) == "−14.4 %<small>−14.8 … −14.0</small>"


def test_what_rounds_to_zero_has_no_sign() -> None:
    assert fixed(-0.04, 1, sign=True) == fixed(0.04, 1, sign=True) == fixed(-0.0, 1) == "0.0"
    assert fixed(-0.06, 1, sign=True) == "−0.1"


def test_counts_and_times() -> None:
    assert count(1234567) == "1\u202f234\u202f567"
    assert when(1_770_000_000 * 10**9) == "2026-02-02 02:40:00 UTC"
    assert when(3_725 * 10**9) == "1:02:05 on the data's clock"


@pytest.mark.parametrize(
    ("lower", "upper"),
    [(-0.0041, 0.0041), (0.0407, 0.0522), (3.0, 3.0001), (0, 1e6), (-2e-7, 3e-7), (5e7, 5.1e7)],
)
def test_ticks_are_round_inside_and_distinct(lower: float, upper: float) -> None:
    ticks = round_ticks(lower, upper, 4)
    texts = tick_texts(ticks)
    assert 2 <= len(ticks) <= 9
    assert min(ticks) >= lower - 1e-9 * abs(upper)
    assert max(ticks) <= upper * (1 + 1e-9)
    assert len(set(texts)) == len(texts)
    assert all(
        np.isclose(float(t.replace("−", "-")), v, rtol=1e-2, atol=1e-12)
        for t, v in zip(texts, ticks, strict=True)
    )


def test_ticks_of_nothing() -> None:
    assert round_ticks(1.0, 1.0, 4) == []
    assert round_ticks(np.nan, 1.0, 4) == []
    assert tick_texts([]) == []


def test_thinning_keeps_ends_and_extremes_of_every_bin() -> None:
    y = np.sin(np.arange(10_000) * 0.37)
    y[5000] = 7.0
    y[7000] = np.nan
    x, kept = thin(np.arange(10_000.0), y, 50)
    assert len(x) <= 200
    assert (x[0], x[-1]) == (0.0, 9999.0)
    assert np.nanmax(kept) == 7.0
    assert np.all(np.diff(x) > 0)
