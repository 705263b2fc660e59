# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The pole of paper 001: its parts fit, or one line says which does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from valve_twin.design.geometry import HybridPole, read_design, write_design
from valve_twin.design.geometry.section import area

SAMPLE = Path(__file__).resolve().parents[3] / "samples" / "design" / "hybrid_pole.yaml"


def test_the_sample_is_the_default_pole():
    assert read_design(SAMPLE) == HybridPole() == read_design(None, kind="hybrid_pole")


def test_parts_have_the_printed_dimensions():
    parts = {r.name: r for r in HybridPole().section().regions}
    assert area(parts["magnet"].outline) == pytest.approx(50e-3 * 4e-3)
    assert area(parts["armature"].outline) == pytest.approx(22e-3 * 5e-3)
    assert area(parts["cover"].outline) == pytest.approx(17.5e-3 * 9e-3)
    assert area(parts["yoke"].outline) == pytest.approx(55.5e-3 * 3e-3)
    assert min(z for _, z in parts["armature"].outline) == pytest.approx(0.5e-3)


@pytest.mark.parametrize(
    ("number", "value", "said"),
    [
        ("magnet_height", 0.055, r"magnet_height = 0\.055: must be from 0 to 0\.0539 \[m\]"),
        ("cover_width", 0.03, r"cover_width = 0\.03: must be from 0 to 0\.0212 \[m\]"),
        ("armature_width", 0.01, r"armature_width = 0\.01: must be from 0\.015 to 1 \[m\]"),
        ("core", 0.004, r"core = 0\.004: must be from 0\.0045 to 1 \[m\]"),
    ],
)
def test_parts_that_do_not_fit_are_named(number, value, said):
    with pytest.raises(ValueError, match=said):
        replace(HybridPole(), **{number: value}).section()


def test_numbers_outside_their_range_are_refused():
    with pytest.raises(ValueError, match="gap"):
        HybridPole(gap=-1e-3)


def test_what_is_written_reads_the_same(tmp_path):
    pole = replace(HybridPole(), gap=2e-3, shoe=2e-3)
    write_design(pole, tmp_path / "pole.yaml")
    assert read_design(tmp_path / "pole.yaml") == pole
