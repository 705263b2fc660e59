# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A long life is drawn with few points, and none that stands out is missing."""

import re

import numpy as np
import pytest

from valve_twin.core.types import (
    Estimate,
    EstimateStatus,
    Maintenance,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.report.plots import Marks, plot_parameter
from valve_twin.report.svg import extremes

CYCLES = 8000
FAR = (1234, 4321, 7654)
DIGIT = 7.0
"""Width of a digit at the axes of a chart of 480 units at least [units of the drawing]."""


def chart(values, status=(ParameterStatus.OK, ParameterStatus.OK), marks=None) -> str:
    """Return the chart of a parameter with these values, states in turn."""
    estimates = [
        Estimate(
            model="",
            estimator="",
            cycle=n,
            start_ns=n,
            end_ns=n + 1,
            parameters=(ParameterValue("gain", value, status[n % 2]),),
            status=EstimateStatus.ACCEPTED,
            reason="",
            used_by_trend=True,
        )
        for n, value in enumerate(values, 1)
    ]
    return str(plot_parameter("gain", estimates, marks or Marks(), "cycle"))


@pytest.fixture(scope="module")
def picture() -> str:
    """Return the chart of a long life in which three values stand out and half are refused."""
    values = 1.0 + 1e-3 * np.random.default_rng(1000).standard_normal(2 * CYCLES)
    values[[2 * n for n in FAR]] += 1.0
    return chart(values.tolist(), (ParameterStatus.NOT_EXCITED, ParameterStatus.OK))


def moves(picture: str, style: str) -> list[tuple[float, float]]:
    (path,) = re.findall(rf'<path class="{style}" d="([^"]*)"', picture)
    return [(float(a), float(b)) for a, b in re.findall(r"M([\d.]+) ([\d.]+)", path)]


def test_what_stands_out_of_a_long_life_is_drawn(picture):
    dots = moves(picture, "estimate")
    assert len(dots) < CYCLES / 4
    assert sum(y < 100.0 for _, y in dots) == len(FAR)


def test_a_refused_cycle_takes_one_line_a_column_at_most(picture):
    assert len(moves(picture, "refused")) <= 2 * 353


@pytest.mark.parametrize("seed", range(1000, 1005))
def test_the_ends_of_every_column_are_kept(seed):
    random = np.random.default_rng(seed)
    column, y = random.integers(0, 9, 400), random.standard_normal(400)
    y[random.random(400) < 0.1] = np.nan
    kept = extremes(column, y)
    assert np.all(np.diff(kept) > 0)
    for k in range(9):
        own, shown = np.flatnonzero(column == k), kept[column[kept] == k]
        assert {own[0], own[-1], own[np.nanargmin(y[own])], own[np.nanargmax(y[own])]} == set(
            shown
        )


def test_numbers_at_the_axis_are_not_cut_however_long():
    for values in ([0.00100, 0.00101], [0.0100, 0.0101], [1e-4, 1.01e-4], [12345.6, 12345.7]):
        texts = re.findall(r'<text class="tick end" x="([\d.]+)"[^>]*>([^<]*)<', chart(values))
        assert len(texts) >= 2
        assert all(float(x) >= DIGIT * len(text) for x, text in texts), texts


@pytest.mark.parametrize("count", [2, 3, 8, 60])
def test_cycles_are_counted_in_whole_numbers(count):
    texts = re.findall(r'<text class="tick mid"[^>]*>([^<]*)<', chart([1.0] * count))
    assert len(texts) >= 2
    assert all(text.isdecimal() for text in texts), texts


def test_the_word_of_a_maintenance_stands_over_the_curves_that_cross_it():
    marks = Marks(maintenance=(Maintenance(0, 20, "cleaned"),))
    drawn = chart([1.0] * 60, marks=marks)
    assert drawn.index("▼ service") > max(
        drawn.rindex(f'class="{c}"') for c in ("estimate", "axis")
    )


def test_no_point_is_no_point():
    assert not len(extremes(np.zeros(0, np.int64), np.zeros(0)))
