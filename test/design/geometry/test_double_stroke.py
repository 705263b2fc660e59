# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The double-stroke solenoid: restrictions, winding, mass, section."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.geometry.section import area

REFERENCE = DoubleStroke()


def test_the_reference_is_feasible_and_its_coil_is_that_of_equation_3():
    assert REFERENCE.violations() == ()
    found = REFERENCE.winding()
    layers = math.ceil(375 / math.floor(18.0 / 0.679))
    assert found.layers == layers == 15
    assert found.height == pytest.approx((1.0 + 14.0 * math.sin(math.pi / 3.0)) * 0.679e-3)


def test_the_armature_weighs_what_its_ring_weighs():
    assert REFERENCE.armature_mass() == pytest.approx(7850.0 * math.pi * (64e-6 - 4e-6) * 24e-3)


@pytest.mark.parametrize(
    ("change", "name", "by"),
    [
        ({"turns": 500}, "winding height", 2.352e-3),
        ({"stroke_ratio": 0.9}, "stroke_ratio", 0.1),
        ({"collar_ratio": 0.2}, "collar_ratio", 0.05),
        ({"collar_ratio": 0.95}, "bridge length", 0.05e-3),
        ({"coil_ratio": 1.0, "turns": 100}, "flange behind the pole's face", 0.5e-3),
        ({"gap_ratio": -0.1}, "gap_ratio", 0.12),
        ({"wire": 4e-3, "wire_overall": 5e-3, "coil_ratio": 0.5}, "overall diameter", 1e-3),
    ],
)
def test_a_broken_restriction_is_named_with_its_amount(change, name, by):
    (found,) = replace(REFERENCE, **change).violations()
    assert found.name.startswith(name)
    assert found.by == pytest.approx(by, rel=1e-3)
    assert "off by" in str(found)


def test_every_restriction_that_is_broken_is_named():
    broken = replace(REFERENCE, turns=500, stroke_ratio=0.9)
    with pytest.raises(ValueError, match=r"winding height = .*; stroke_ratio = 0.9: must be 0 to"):
        broken.section()


def test_the_section_is_a_mirror_of_itself_and_grows_with_the_armature():
    section = REFERENCE.section()
    by_name = {r.name: r for r in section.regions}
    for one in ("pole", "flange", "coil"):
        a, b = by_name[f"{one}_a"], by_name[f"{one}_b"]
        assert {(r, -z) for r, z in a.outline} == set(b.outline)
    assert section.coils == ("A", "B")
    larger = replace(REFERENCE, armature_radius=9e-3, turns=300).section()
    scale = area(larger.regions[4].outline) / area(section.regions[4].outline)
    assert scale == pytest.approx((9.0 / 8.0) ** 2)
