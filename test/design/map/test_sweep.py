# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The fields of a map: half of them are mirror images of the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.design.field import make_model, solve_field
from valve_twin.design.geometry import DoubleStroke, Section, read_design
from valve_twin.design.map.sweep import is_mirror, sweep_fields

SECTION = DoubleStroke().section()


def test_mirror_images_are_the_fields_themselves():
    model = make_model(SECTION, 0.3)
    currents, positions = np.linspace(0.0, 3.0, 4), np.linspace(-1e-3, 1e-3, 4)
    found = sweep_fields(model, currents, positions)
    assert found.solved == 32
    field = solve_field(model, (currents[1], currents[2]), float(positions[0]))
    at = (1, 2, 0)
    assert found.coenergy[at] == pytest.approx(field.coenergy, rel=1e-9)
    assert found.force[at] == pytest.approx(field.force, abs=1e-8)
    assert found.flux[(slice(None), *at)] == pytest.approx(field.flux, abs=1e-9)
    assert found.force_slope[(slice(None), *at)] == pytest.approx(field.force_slope, abs=1e-4)
    assert found.inductance[(..., *at)] == pytest.approx(field.inductance, abs=1e-6)


def test_only_a_mirror_is_taken_for_one(root):
    assert is_mirror(SECTION)
    regions = (*SECTION.regions[:-1], replace(SECTION.regions[-1], turns=-300.0))
    assert not is_mirror(replace(SECTION, regions=regions))
    assert not is_mirror(replace(SECTION, high=SECTION.high + 1e-3))
    assert SECTION.motion is not None
    motion = replace(SECTION.motion, still_high=SECTION.motion.still_high + 1e-4)
    assert not is_mirror(replace(SECTION, motion=motion))
    other = read_design(root / "samples" / "design" / "pot_magnet.yaml")
    assert isinstance(other, Section)
    assert not is_mirror(other)


def wound(*turns):
    """Return the section with each coil in two halves of these turns: A, A, B, B."""
    *rest, one, other = SECTION.regions
    (inner, low), (outer, high) = one.outline[0], one.outline[2]
    ends = (low, 0.5 * (low + high), high)
    regions, left = list(rest), list(turns)
    for coil, sign in ((one, 1.0), (other, -1.0)):
        for k in range(2):
            corners = tuple((r, sign * z) for z in ends[k : k + 2] for r in (inner, outer))
            outline = (corners[0], corners[1], corners[3], corners[2])
            name = f"{coil.name}_{k}"
            regions.append(replace(coil, name=name, outline=outline, turns=left.pop(0)))
    return replace(SECTION, regions=tuple(regions))


def test_windings_against_each_other_are_a_mirror_only_if_both_coils_have_them():
    assert is_mirror(wound(300.0, 75.0, -300.0, -75.0))
    assert is_mirror(wound(300.0, -75.0, 300.0, -75.0))
    assert not is_mirror(wound(300.0, -75.0, -300.0, -75.0))


@pytest.mark.parametrize(
    ("currents", "positions", "words"),
    [
        ([0.0, 1.0, 2.0], [0.0, 1e-4, 2e-4, 3e-4], "currents = .* must be 4 or more, rising"),
        ([0.0, 2.0, 1.0, 3.0], [0.0, 1e-4, 2e-4, 3e-4], "must be 4 or more, rising"),
        ([1.0, 2.0, 3.0, 4.0], [0.0, 1e-4, 2e-4, 3e-4], r"currents\[0\] = 1: must be 0"),
        ([0.0, 1.0, 2.0, 3.0], [0.0], "positions = .* must be 4 or more"),
    ],
)
def test_a_grid_that_is_none_is_refused(currents, positions, words):
    model = make_model(SECTION, 0.3)
    with pytest.raises(ValueError, match=words):
        sweep_fields(model, np.array(currents), np.array(positions))
