# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The seating speed is scored on grid and draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.valves.hybrid_actuator.landing.strokes import open_stroke
from valve_twin.validation import Verdict, landing
from valve_twin.validation.registry import get_benchmark


def test_the_goal_is_kept_on_other_draws_and_missed_where_the_gas_is_too_strong(monkeypatch):
    monkeypatch.setattr(landing, "DRAWS", 3)
    monkeypatch.setattr(landing, "SCORED_SEED", 7100)
    monkeypatch.setattr(landing, "grid", lambda: landing.draws(2, 7200))
    advanced: list[int] = []
    found = get_benchmark("landing").run(lambda: advanced.append(1))
    assert len(advanced) == get_benchmark("landing").steps
    assert [c.verdict for c in found.checks] == [Verdict.PASS] * 4
    grid, drawn, beyond = found.tables.values()
    assert [row["strokes"] for row in (*grid, *drawn)] == [2.0] * 4 + [3.0] * 4
    by = {row["valve"]: row for row in beyond}
    assert float(by["gas 40 N"]["closing, m/s"]) > landing.GOAL


def test_draws_stay_within_the_spread_and_differ():
    drawn = [valve for valve, _ in landing.draws(20, 7100)]
    for name in ("damping", "coulomb_friction", "supply_voltage", "gas_force"):
        share = np.array([getattr(v, name) for v in drawn]) / getattr(landing.VALVE, name)
        assert np.abs(share - 1.0).max() <= landing.SPREAD
        assert share.std() > 0.03


def test_a_stroke_that_never_lands_fails_the_goal(monkeypatch):
    valve = replace(landing.VALVE, gas_force=500.0)
    rng = np.random.default_rng(7100)
    _, checks = landing._scored("none", lambda: [(landing.VALVE, rng), (valve, rng)], lambda: None)
    assert checks[0].verdict is Verdict.FAIL
    assert checks[0].obtained == pytest.approx(np.inf)


def test_a_row_of_strokes_that_never_land_is_told():
    strokes = [open_stroke(replace(landing.VALVE, gas_force=500.0), True)[0]]
    row = landing.row_of("opening", "open sequence", strokes)
    assert row["landed"] == pytest.approx(0.0)
    assert np.isnan(row["largest speed, m/s"])
