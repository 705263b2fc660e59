# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Static fields against energy, reciprocity, closed forms and finer meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from valve_twin.design.field import make_model, solve_field
from valve_twin.design.field.shapes import flux_density
from valve_twin.design.geometry import DoubleStroke, Region, Section, read_design
from valve_twin.design.geometry.section import rectangle
from valve_twin.design.materials import Linear, Magnet

SECTION = DoubleStroke().section()
VACUUM = 4e-7 * np.pi


@pytest.fixture(scope="module")
def coarse():
    return make_model(SECTION, 0.5)


@pytest.mark.parametrize("fine", [0.5, 1.0])
def test_equal_currents_in_the_middle_give_no_force(fine):
    found = solve_field(make_model(SECTION, fine), (1.0, 1.0))
    assert abs(found.force) < 1e-9
    assert abs(found.flux[0] - found.flux[1]) < 1e-9


def test_the_two_sides_are_mirrors(coarse):
    one = solve_field(coarse, (2.0, 0.5), 0.4e-3)
    other = solve_field(coarse, (0.5, 2.0), -0.4e-3)
    assert one.flux == pytest.approx(other.flux[::-1], abs=1e-9)
    assert one.force == pytest.approx(-other.force, abs=1e-9)


@pytest.mark.parametrize("state", [(2.0, 0.5, 0.3e-3), (0.6, 1.0, -0.8e-3), (3.0, 0.0, 0.9e-3)])
def test_force_and_flux_are_slopes_of_the_coenergy(coarse, state):
    i_a, i_b, x = state
    found = solve_field(coarse, (i_a, i_b), x)
    h = 1e-6
    ends = [solve_field(coarse, (i_a, i_b), x + s * h) for s in (1.0, -1.0)]
    assert (ends[0].coenergy - ends[1].coenergy) / (2 * h) == pytest.approx(found.force, rel=1e-5)
    slope = (ends[0].flux - ends[1].flux) / (2 * h)
    assert slope == pytest.approx(found.force_slope, rel=1e-4, abs=1e-3)
    d = 1e-3
    ends = [solve_field(coarse, (i_a + s * d, i_b), x) for s in (1.0, -1.0)]
    psi = (ends[0].coenergy - ends[1].coenergy) / (2 * d)
    assert psi == pytest.approx(found.flux[0], rel=1e-5)
    rate = (ends[0].flux - ends[1].flux) / (2 * d)
    assert rate == pytest.approx(found.inductance[:, 0], rel=1e-5)
    pull = (ends[0].force - ends[1].force) / (2 * d)
    assert pull == pytest.approx(found.force_slope[0], rel=1e-5)


def test_mutual_inductances_are_equal(coarse):
    found = solve_field(coarse, (2.0, 1.0), 0.5e-3).inductance
    assert found[0, 1] == pytest.approx(found[1, 0], rel=1e-6)
    assert found[0, 1] < 0.0


def test_energy_and_coenergy_share_the_product_of_current_and_flux(coarse):
    found = solve_field(coarse, (2.0, 1.0), 0.5e-3)
    assert found.energy + found.coenergy == pytest.approx(found.currents @ found.flux)
    assert 0.0 < found.energy < found.coenergy


def test_more_turns_and_less_current_make_the_same_field(coarse):
    regions = tuple(replace(r, turns=2.0 * r.turns) for r in SECTION.regions)
    double = make_model(replace(SECTION, regions=regions), 0.5)
    one, other = solve_field(coarse, (2.0, 1.0)), solve_field(double, (1.0, 0.5))
    assert other.force == pytest.approx(one.force, rel=1e-9)
    assert 0.5 * other.flux == pytest.approx(one.flux, rel=1e-9)


def filaments(region, count):
    """Return radii, places and turns of the rings that a winding space is cut into."""
    (r0, z0), (r1, z1) = region.outline[0], region.outline[2]
    at = (np.arange(count) + 0.5) / count
    r, z = np.meshgrid(r0 + at * (r1 - r0), z0 + at * (z1 - z0))
    return r.ravel(), z.ravel(), np.full(r.size, region.turns / r.size)


def mutual(one, other, count=16):
    """Return the mutual inductance of two windings from complete elliptic integrals [H]."""
    (r1, z1, n1), (r2, z2, n2) = filaments(one, count), filaments(other, count + 1)
    a, b = r1[:, None], r2[None, :]
    m = 4 * a * b / ((a + b) ** 2 + (z1[:, None] - z2[None, :]) ** 2)
    k = np.sqrt(m)
    each = VACUUM * np.sqrt(a * b) * ((2 / k - k) * ellipk(m) - 2 / k * ellipe(m))
    return float(n1 @ each @ n2)


def test_coils_in_air_have_the_inductances_of_elliptic_integrals():
    coils = tuple(r for r in SECTION.regions if r.coil)
    air = Section("air", coils, {}, None, 0.32, -0.384, 0.384)
    found = solve_field(make_model(air, 0.9), (1.0, 0.0)).inductance
    assert found[0, 1] == pytest.approx(mutual(*coils), rel=2e-3)
    assert found[0, 0] == pytest.approx(mutual(coils[0], coils[0]), rel=2e-3)


def test_a_magnet_has_the_field_of_its_surface_currents_on_the_axis():
    radius, half, remanence = 5e-3, 8e-3, 1.2
    magnet = Region("m", "magnet", rectangle(0.0, radius, -half, half))
    material = Magnet(remanence=remanence, permeability=1.0)
    section = Section("m", (magnet,), {"magnet": material}, None, 0.12, -0.15, 0.15)
    model = make_model(section, 1.2)
    found = solve_field(model, ())
    near = np.flatnonzero(model.grid.points[0, model.grid.triangles].max(axis=0)
                          < 1.01 * model.grid.lines_r[1])  # fmt: skip
    _, b_z = flux_density(model, model.grid.points, found.potential, near)
    z = model.grid.points[1, model.grid.triangles[:, near]].mean(axis=0)
    up, down = z + half, z - half
    wanted = remanence / 2 * (up / np.hypot(up, radius) - down / np.hypot(down, radius))
    off = np.abs(b_z.mean(axis=1) - wanted)[np.abs(np.abs(z) - half) > 1e-3]
    assert off.max() < 0.01 * remanence


def test_a_magnet_holds_its_armature_and_the_coil_can_weaken_it(root):
    section = read_design(root / "samples" / "design" / "pot_magnet.yaml")
    assert isinstance(section, Section)
    model = make_model(section, 0.6)
    rest, helped, weakened = (solve_field(model, (i,), -0.5e-3) for i in (0.0, 4.0, -4.0))
    assert helped.force < rest.force < weakened.force < 0.0
    h = 1e-6
    ends = [solve_field(model, (4.0,), -0.5e-3 + s * h).coenergy for s in (1.0, -1.0)]
    assert (ends[0] - ends[1]) / (2 * h) == pytest.approx(helped.force, rel=1e-5)


def test_the_coarse_mesh_is_near_the_usual_one(coarse):
    one, other = (solve_field(m, (2.0, 0.0)) for m in (coarse, make_model(SECTION, 1.0)))
    assert one.flux[0] == pytest.approx(other.flux[0], rel=5e-3)
    assert one.force == pytest.approx(other.force, rel=1e-2)


@pytest.mark.slow
def test_a_finer_mesh_changes_little():
    usual, fine = make_model(SECTION, 1.0), make_model(SECTION, 2.0)
    for x, psi, force in ((0.0, 2e-3, 3e-3), (0.8e-3, 2e-3, 2e-2), (-0.8e-3, 2e-3, 2e-2)):
        one, other = (solve_field(m, (2.0, 0.0), x) for m in (usual, fine))
        assert one.flux[0] == pytest.approx(other.flux[0], rel=psi)
        assert one.force == pytest.approx(other.force, rel=force)


def test_the_energy_converges_with_the_order_of_its_elements():
    coil = Region("c", "air", rectangle(2e-3, 6e-3, -4e-3, 4e-3), "A", 100.0)
    section = Section("c", (coil,), {}, None, 0.02, -0.02, 0.02)
    found = [solve_field(make_model(section, f), (1.0,)).coenergy for f in (0.4, 0.8, 1.6, 3.2)]
    off = np.abs(np.array(found[:3]) / found[3] - 1.0)
    orders = np.log2(off[:-1] / off[1:])
    assert orders.min() > 3.2  # P2: 4 for a smooth field, less at the corners of the winding


@pytest.mark.parametrize(
    ("currents", "position", "words"),
    [
        ((1.0,), 0.0, r"currents = \[1.0\]: must be one finite number for each coil, A, B"),
        ((1.0, np.nan), 0.0, "must be one finite number"),
        ((1e300, 0.0), 0.0, r"current of A = 1e\+300: must be from -428 to 428 \[A\]"),
        ((1.0, 0.0), 1.2e-3, r"position = 0.0012: must be from -0.001 to 0.001 \[m\]"),
    ],
)
def test_what_does_not_fit_the_section_is_refused(coarse, currents, position, words):
    with pytest.raises(ValueError, match=words):
        solve_field(coarse, currents, position)


def test_a_region_in_the_air_that_the_motion_stretches_is_refused():
    lid = Region("lid", "steel", rectangle(2e-3, 5e-3, 12.5e-3, 13e-3))
    said = r"lid: r = 0.002 to 0.005, z = 0.0125 to 0.013 lies in the air .* r below 0.00825 and z"
    with pytest.raises(ValueError, match=said):
        make_model(replace(SECTION, regions=(*SECTION.regions, lid)), 0.5)
    ring = Region("shim", "copper", rectangle(2e-3, 5e-3, 12.5e-3, 13e-3))
    section = replace(SECTION, regions=(*SECTION.regions, ring),
                      materials={**SECTION.materials, "copper": Linear()})  # fmt: skip
    assert make_model(section, 0.5).unknowns > 1000
