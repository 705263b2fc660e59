# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is drawn slice by slice is the curve that a drawing of all samples would show."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest

from valve_twin.gateway.live.plot import (
    BIN_S,
    MOST_WAITING,
    STRIPS,
    UNITS_A_SECOND,
    WIDTH,
    WINDOW_S,
    LivePlot,
    decimated,
)

BEGIN_NS = 1_700_000_000 * 10**9
POSITION = STRIPS[0]


def stamps(t):
    return BEGIN_NS + np.rint(np.asarray(t) * 1e9).astype(np.int64)


def points(slices: list[dict[str, Any]], curve: str):
    """Return the points of a curve in the drawing, all slices behind each other."""
    found = []
    for one in slices:
        for x, y in re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", one["d"].get(curve, "")):
            found.append((one["t"] + float(x), float(y)))
    return np.array(found)


def feed(plot: LivePlot, rate_hz: float, seconds: float, look_s: float = 0.2):
    """Feed a sine and look at it now and then; return what the looks gave."""
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    values = 0.5 + 0.4 * np.sin(2.0 * t)
    drawn = []
    for begin in np.arange(0.0, seconds, look_s):
        now = (t >= begin - 1e-9) & (t < begin + look_s - 1e-9)
        plot.add(stamps(t[now]), {"measured": values[now]}, 0.001)
        drawn.append(plot.draw())
    return drawn


@pytest.mark.parametrize("rate_hz", [5.0, 50.0, 1000.0, 8000.0])
def test_every_point_lies_on_the_curve_and_none_is_missing(rate_hz):
    plot = LivePlot()
    feed(plot, rate_hz, 8.0)
    found = points(plot.all(), "measured")
    t = found[:, 0] / UNITS_A_SECOND
    lower, upper = plot._ranges[0]
    share = upper - (found[:, 1] - POSITION.top) / POSITION.height * (upper - lower)
    assert np.allclose(share, 0.5 + 0.4 * np.sin(2.0 * t), atol=2.0 * BIN_S * 0.8 + 0.003)
    assert np.diff(t).max() <= 1.0 / rate_hz + 2 * BIN_S
    assert t[-1] >= 7.5


def test_the_cost_of_a_window_does_not_grow_with_the_rate():
    sizes = {}
    for rate_hz in (1000.0, 20000.0):
        plot = LivePlot()
        feed(plot, rate_hz, 12.0)
        sizes[rate_hz] = len(points(plot.all(), "measured"))
    assert sizes[20000.0] <= 1.1 * sizes[1000.0]
    assert sizes[1000.0] < 2.5 * (WINDOW_S + 2.0) / BIN_S


def test_what_is_new_is_told_once_and_the_old_goes():
    plot = LivePlot()
    drawn = feed(plot, 1000.0, 60.0)
    assert drawn[0].anew
    told = [s["t"] for d in drawn for s in d.slices]
    assert len(told) == len(set(told))
    assert sum(d.anew for d in drawn) <= 3  # ranges settle
    assert len(plot.all()) < 1.3 * WINDOW_S / 0.2
    assert plot.right == pytest.approx(60.0 * UNITS_A_SECOND, abs=2 * BIN_S * UNITS_A_SECOND)
    assert plot.all()[0]["t"] > plot.right - 1.3 * WIDTH


@pytest.mark.parametrize("jump_s", [-100.0, 1000.0])
def test_a_clock_that_jumps_begins_anew(jump_s):
    plot = LivePlot()
    feed(plot, 100.0, 4.0)
    t = np.arange(4.0 + jump_s, 5.0 + jump_s, 0.01)
    plot.add(stamps(t), {"measured": np.full(len(t), 0.25)})
    assert plot.draw().anew
    assert plot.right <= 1.0 * UNITS_A_SECOND


def test_what_is_no_number_interrupts_and_a_large_value_widens_the_axis():
    plot = LivePlot()
    t = np.arange(0.0, 2.0, 0.01)
    values = np.full(len(t), 0.5)
    values[80:120] = np.nan
    plot.add(stamps(t), {"measured": values, "residual": np.full(len(t), np.nan)})
    plot.draw()
    (whole,) = plot.all()
    assert whole["d"]["measured"].count("M") == 2
    assert whole["d"]["residual"] == ""
    plot.add(stamps(t + 2.0), {"measured": np.full(len(t), 7.0)})
    assert plot.draw().anew
    y = points(plot.all(), "measured")[:, 1]
    assert (y >= POSITION.top - 1e-6).all()
    assert max(float(line["text"]) for line in plot.axes() if line["y"] < 280.0) > 1.0


def test_a_command_holds_until_the_next_one():
    plot = LivePlot()
    t = np.arange(0.0, 4.0, 0.1)
    for k in range(4):
        now = (t >= k) & (t < k + 1)
        plot.add(stamps(t[now]), {"measured": t[now]})
        plot.add(stamps([k + 0.45]), {"s0": np.array([float(k % 2)])})
        plot.draw()
    found = points(plot.all(), "s0")
    steps = np.abs(np.diff(found, axis=0))
    assert ((steps[:, 0] < 0.2) | (steps[:, 1] < 0.2)).all()  # up, or along


def test_of_a_command_that_holds_only_both_ends_are_drawn():
    plot = LivePlot()
    t = np.arange(0.0, 2.0, 0.03)
    plot.add(stamps(t), {"measured": t / 2.0})
    plot.add(stamps(t), {"s0": np.where(t < 1.0, 0.0, 1.0)})
    plot.draw()
    found = points(plot.all(), "s0")
    assert len(found) == 4
    assert np.ptp(found[:2, 1]) == np.ptp(found[2:, 1]) == 0.0


def test_an_axis_that_an_outlier_widened_is_narrowed_once_it_has_gone():
    plot = LivePlot()
    t = np.arange(0.0, 0.2, 0.01)
    plot.add(stamps(t), {"measured": np.full(len(t), 50.0)})
    plot.draw()
    assert plot._ranges[0][1] > 50.0
    for k in range(1, 70):
        plot.add(stamps(t + 0.2 * k), {"measured": np.full(len(t), 0.5)})
        plot.draw()
    assert plot._ranges[0][1] < 1.2


def test_the_band_is_twice_the_expected_deviation():
    plot = LivePlot()
    t = np.arange(0.0, 2.0, 0.01)
    plot.add(stamps(t), {"measured": t, "residual": 0.001 * np.sin(t)}, 0.002)
    plot.draw()
    (whole,) = plot.all()
    high, low = map(float, re.findall(r"M0 ([\d.]+)H[\d.]+V([\d.]+)", whole["d"]["expected"])[0])
    lower, upper = plot._ranges[1]
    assert low - high == pytest.approx(0.008 / (upper - lower) * STRIPS[1].height, abs=0.2)


def test_decimation_keeps_lowest_and_highest_of_each_bin():
    generator = np.random.default_rng(5)
    t = np.sort(generator.uniform(0.0, 1.0, 5000))
    values = generator.normal(size=5000)
    values[generator.integers(0, 5000, 50)] = np.nan
    found_t, found = decimated(t, values, 0.1)
    for k in range(10):
        inside, kept = np.floor(t / 0.1) == k, np.floor(found_t / 0.1) == k
        assert np.nanmin(values[inside]) == found[kept].min()
        assert np.nanmax(values[inside]) == found[kept].max()
    none_t, none = decimated(t, np.full(5000, math.nan), 0.1)
    assert np.isnan(none).all()
    assert len(none_t) == 20


def test_commands_that_come_without_predictions_do_not_pile_up():
    plot = LivePlot()
    for look in range(300):
        t = stamps(look + np.arange(0.0, 1.0, 1e-3))
        plot.add(t, {"s0": np.ones(len(t))})
        plot.draw()
    assert sum(len(t) for t, _ in plot._waiting[("s0",)]) <= MOST_WAITING


def test_what_nobody_looked_at_is_a_gap_and_no_line():
    plot = LivePlot()
    feed(plot, 100.0, 2.0)
    plot.interrupt()
    t = np.arange(6.0, 7.0, 0.01)
    plot.add(stamps(t), {"measured": np.full(len(t), 0.2), "s0": np.ones(len(t))})
    plot.draw()
    x = points(plot.all(), "measured")[:, 0] / UNITS_A_SECOND
    assert np.diff(x).max() > 3.5
    last = plot.all()[-1]
    assert min(p[0] for p in points([last], "measured")) == pytest.approx(6.0 * UNITS_A_SECOND)
    assert min(p[0] for p in points([last], "s0")) == pytest.approx(6.0 * UNITS_A_SECOND)
