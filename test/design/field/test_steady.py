# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is made once a mesh gives, with what varies, the sum over all triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.design.field import make_model, solve_field
from valve_twin.design.field.kernel import assemble
from valve_twin.design.geometry import DoubleStroke, Section, read_design
from valve_twin.design.materials import Magnet


def pot(root):
    section = read_design(root / "samples" / "design" / "pot_magnet.yaml")
    assert isinstance(section, Section)
    return section


@pytest.mark.parametrize("position", [0.0, 0.5e-3])
def test_form_and_varying_triangles_are_the_field_of_all(position, root):
    for section, there in (
        (DoubleStroke().section(), position),
        (pot(root), 0.0),  # with a magnet
    ):
        model = make_model(section, 0.3)
        found = solve_field(model, [1.5, 0.4][: len(section.coils)], there)
        a, points = found.potential, model.moved(there)
        whole, part = (np.empty(len(a)), np.empty(len(model.rows))), np.empty(len(a))
        entries = np.empty(len(model.rows))
        every = np.arange(model.elements.triangles.shape[1])
        energy = assemble(model.elements, every, points, a, *whole)
        steady = model.steady
        assert 0 < len(steady.varying) < 0.6 * len(every)
        varying = assemble(model.elements, steady.varying, points, a, part, entries)
        image = steady.stiff @ a
        summed = varying + steady.energy + a @ (steady.pull + 0.5 * image)
        assert summed == pytest.approx(energy, rel=1e-12)
        assert part + steady.pull + image == pytest.approx(
            whole[0], abs=1e-12 * np.abs(whole[0]).max()
        )
        assert entries + steady.entries == pytest.approx(
            whole[1], abs=1e-12 * np.abs(whole[1]).max()
        )


def test_the_form_knows_the_magnets_remanence(root):
    section = pot(root)
    magnet = section.materials["magnet"]
    assert isinstance(magnet, Magnet)
    weaker = replace(
        section,
        materials={**section.materials, "magnet": replace(magnet, remanence=magnet.remanence / 2)},
    )
    pulls = [make_model(s, 0.3).steady.pull for s in (section, weaker)]
    assert pulls[1] == pytest.approx(0.5 * pulls[0], rel=1e-12)
    assert np.abs(pulls[0]).max() > 0.0
