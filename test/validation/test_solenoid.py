# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Dynamics from a coarse field keep the goals as well, and static curves would not."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import pytest

from valve_twin.validation import Verdict, solenoid
from valve_twin.validation.registry import get_benchmark


def test_the_dynamics_of_a_coarse_field_are_those_that_the_paper_describes(monkeypatch):
    monkeypatch.setattr(solenoid, "FIDELITY", "search")
    monkeypatch.setattr(solenoid, "MATCHED", "search")
    monkeypatch.setattr(import_module("valve_twin.design.dynamics.replay"), "FOLLOWED_S", 0.008)
    advanced: list[int] = []
    found = get_benchmark("solenoid").run(lambda: advanced.append(1))
    assert len(advanced) == get_benchmark("solenoid").steps
    assert [c.verdict for c in found.checks[:8]] == [Verdict.PASS] * 8, found.checks
    late, *followed = found.checks[8:]
    assert late.quantity == "fit of the force on a step of 50 %, second_order [%]"
    forms = [" eddies [%]"] * 2 + [" growing [%]"] * 5
    assert [c.quantity.split(",")[1] for c in followed] == forms
    assert followed[0].obtained > late.obtained + 10.0
    assert [c.note.endswith("fitted to this step") for c in followed[2:]] == [False] * 4 + [True]
    assert "on a step from 100 to 0 %, growing" in followed[5].quantity
    (rows,) = found.tables.values()
    assert [row["dynamics"] for row in rows] == ["G_A", "G_F"]
    by = {c.quantity: c for c in found.checks}
    fit = by["fit of G_A [%]"]
    static = float(rows[0]["static alone, %"])
    assert replace(fit, obtained=static).verdict is Verdict.FAIL
    assert by["fit of G_A above static curves [points]"].obtained == pytest.approx(
        fit.obtained - static
    )
