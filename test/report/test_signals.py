# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The measured signals of a cycle: in their units, those of one kind together."""

from __future__ import annotations

import re

import numpy as np
import pytest

from valve_twin.core.types import Cycle, Frames
from valve_twin.core.valves.registry import get_model
from valve_twin.report import ReportData, render_report
from valve_twin.report.signals import plot_signals, signals_of

COUNT = 50


def cycle_of(name):
    inputs = np.linspace(0.0, 1.0, COUNT)[:, None].repeat(len(get_model(name).inputs), 1)
    nan = np.full(COUNT, np.nan)
    stamps = np.arange(COUNT, dtype=np.int64) * 1_000_000
    frames = Frames(stamps, np.linspace(0.0, 1.0, COUNT), inputs, nan, nan, np.ones(COUNT, bool))
    return Cycle(7, 1e-3, frames)


def shown(name):
    model = get_model(name)
    return {s.name: s for s in signals_of(cycle_of(name), model, model.options)}


@pytest.mark.parametrize(
    ("name", "signal", "unit", "ends"),
    [
        ("double_solenoid", "position", "mm", (-0.8, 0.8)),
        ("double_solenoid", "current_b", "A", (0.0, 5.0)),
        ("hybrid_actuator", "position", "mm", (0.0, 8.0)),
        ("hybrid_actuator", "opener_voltage", "V", (0.0, 24.0)),
        ("servo_system", "pressure_1", "MPa", (0.0, 25.0)),
        ("servo_system", "current", "mA", (0.0, 60.0)),
        ("servo_system", "load_position", "mm", (0.0, 80.0)),
        ("press_cartridge", "v_in", "1", (0.0, 1.0)),
    ],
)
def test_signals_are_shown_in_their_units(name, signal, unit, ends):
    found = shown(name)[signal]
    assert found.scale.unit == unit
    assert (found.values[0], found.values[-1]) == pytest.approx(ends)


def test_it_is_said_which_end_is_closed():
    assert "0 = closed seat, 8 = open seat" in shown("hybrid_actuator")["position"].scale.ends


@pytest.mark.parametrize(
    ("name", "axes"), [("double_solenoid", 3), ("servo_system", 6), ("hydraulic_actuator", 2)]
)
def test_signals_of_one_unit_and_scale_share_their_axes(name, axes):
    signals = shown(name)
    plot = plot_signals(cycle_of(name).frames.stamp_ns, tuple(signals.values()))
    assert len(re.findall(r'class="axis" d="M64\.0 [\d.]+H', plot)) == axes
    assert plot.count('class="signal ') == len(signals)


def test_a_signal_that_was_never_known_is_drawn_empty():
    signals = list(shown("hydraulic_actuator").values())
    signals[0].values[:] = np.nan
    stamps = cycle_of("hydraulic_actuator").frames.stamp_ns
    assert plot_signals(stamps, signals).count('class="signal ') == 1


def test_the_page_shows_them_and_lacks_them_without_samples():
    model, cycle = get_model("hybrid_actuator"), cycle_of("hybrid_actuator")
    data = ReportData("/engine/valve", model.name, "a bag", model.parameters, cycle=cycle,
                      signals=signals_of(cycle, model, model.options))  # fmt: skip
    page = render_report(data)
    assert "Measured signals of cycle 7" in page
    assert "closer_current" in page
    bare = render_report(ReportData("/engine/valve", model.name, "a bag", model.parameters))
    assert "Measured signals" not in bare
