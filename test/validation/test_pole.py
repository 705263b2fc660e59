# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the field of paper 001's pole gives stands beside what was measured, with the deviation."""

from __future__ import annotations

import pytest

from valve_twin.design.geometry import HybridPole
from valve_twin.design.holding import NEAR, PUBLISHED, STUDIED, UNPRINTED, holding_forces
from valve_twin.validation import Verdict, pole
from valve_twin.validation.registry import get_benchmark

COARSE = 0.4


def test_every_measured_force_has_a_row_with_its_deviation_and_why(monkeypatch):
    monkeypatch.setattr(pole, "FINE", COARSE)
    advanced: list[int] = []
    found = get_benchmark("pole").run(lambda: advanced.append(1))
    assert len(advanced) == get_benchmark("pole").steps
    *static, freed = found.checks
    assert [c.published for c in static] == list(PUBLISHED.values())
    assert all(c.verdict is Verdict.CANNOT for c in found.checks)  # a reading proves nothing
    by = {c.quantity: c for c in static}
    driven = by["force at 0.5 mm and 1000 At [N]"]
    assert driven.obtained == holding_forces(HybridPole(), NEAR, [0.0, 500.0, 1000.0], COARSE)[2]
    assert driven.note.startswith(f"{100 * (driven.obtained / 611.0 - 1):+.0f} %: how coil")
    held = by["holding force of the magnet at 0.5 mm and 0 At [N]"]
    assert held.obtained == pytest.approx(117.8, rel=0.04)  # regression, finer mesh
    assert "were chosen" in held.note
    assert (freed.published, freed.obtained > held.obtained) == ("lets go", True)


def test_the_study_has_every_dimension_beside_what_the_paper_says(monkeypatch):
    monkeypatch.setattr(pole, "FINE", COARSE)
    over_gap, study = pole.run(lambda: None).tables.values()
    assert [row["gap, mm"] for row in over_gap] == [0.5, 1.0, 2.0, 3.0, 4.0]
    assert [str(row["number"]).split()[0] for row in study] == [*STUDIED, *UNPRINTED]
    by = {str(row["number"]): row for row in study}
    assert str(by["gap_4 (0 and +0.1 mm)"]["1000 At, %"]).startswith("+0.0/-")
    assert by["magnet_thickness"]["paper says"] == "+61.4 % for +4 mm"
    low, high = (float(v) for v in str(by["magnet_thickness"]["0 At, %"]).split("/"))
    assert low < 0.0 < high
    assert str(by["magnet_height"]["0 At, %"]).endswith("/-")  # does not fit its yoke
    assert by["hole"]["paper says"] == "not printed"
