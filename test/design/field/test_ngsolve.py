# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The field against another program's, NGSolve, on the same mesh with the same curve of steel."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.core.physics.solenoid_map import VACUUM
from valve_twin.design.field import make_model, solve_field
from valve_twin.design.field.model import steel_table
from valve_twin.design.geometry import DoubleStroke

ngs = pytest.importorskip("ngsolve", reason="python -m pip install ngsolve")
nm = pytest.importorskip("netgen.meshing", reason="python -m pip install ngsolve")

DESIGN = DoubleStroke()
_CURVE_POINTS = 3001


@pytest.fixture(scope="module")
def model():
    return make_model(DESIGN.section(), 0.6)


def mesh_of(model, position):
    """Return the triangles of a model as a mesh of NGSolve, one material a region."""
    points, triangles = model.moved(position), model.grid.triangles
    made = nm.Mesh(dim=2)
    ids = [made.Add(nm.MeshPoint(nm.Pnt(float(r), float(z), 0.0))) for r, z in points.T]
    for k in range(len(model.section.regions) + 1):
        made.Add(nm.FaceDescriptor(surfnr=k + 1, domin=k + 1, bc=1))
        made.SetMaterial(k + 1, f"m{k}")  # m0: what no region covers
    side = points[:, triangles]
    one, other = side[:, 1] - side[:, 0], side[:, 2] - side[:, 0]
    turn = one[0] * other[1] - one[1] * other[0]
    for corners, region, left in zip(triangles.T, model.grid.region, turn > 0.0, strict=True):
        order = corners if left else corners[::-1]
        made.Add(nm.Element2D(int(region) + 2, [ids[n] for n in order]))
    edges = np.sort(triangles[[[0, 1, 0], [1, 2, 2]]].reshape(2, -1), axis=0)
    found, count = np.unique(edges, axis=1, return_counts=True)
    for one, other in found[:, count == 1].T:
        made.Add(nm.Element1D([ids[one], ids[other]], index=1))
    made.SetBCName(0, "outer")
    return ngs.Mesh(made)


def solved(model, currents, position):
    """Return flux linkages [Wb] and force [N] by NGSolve."""
    mesh, section = mesh_of(model, position), model.section
    table, per_tesla = steel_table(DESIGN.steel)
    b = np.linspace(0.0, (len(table) - 1) / per_tesla, _CURVE_POINTS)
    from scipy.interpolate import CubicHermiteSpline

    nodes = np.arange(len(table)) / per_tesla
    h = CubicHermiteSpline(nodes, table[:, 0], table[:, 1])(b)
    energy = ngs.BSpline(2, [0.0, *b.tolist()], h.tolist()).Integrate()
    space = ngs.H1(mesh, order=2, dirichlet="outer")
    u, r = space.TrialFunction(), ngs.x
    b_r, b_z = -ngs.grad(u)[1], ngs.grad(u)[0] + u / r
    square = b_r * b_r + b_z * b_z
    form = ngs.BilinearForm(space, symmetric=True)
    linked = [ngs.LinearForm(space) for _ in section.coils]
    v = space.TestFunction()
    for k in range(-1, len(section.regions)):
        of = ngs.dx(definedon=mesh.Materials(f"m{k + 1}"))
        region = section.regions[k] if k >= 0 else None
        iron = region is not None and region.material == "steel"
        density = energy(ngs.sqrt(square + 1e-18)) if iron else 0.5 / VACUUM * square
        form += ngs.Variation(2.0 * np.pi * r * density * of)
        if region is None or not region.coil:
            continue
        place = section.coils.index(region.coil)
        whole = ngs.Integrate(ngs.CF(1.0), mesh, definedon=mesh.Materials(f"m{k + 1}"))
        share = region.turns / whole
        linked[place] += 2.0 * np.pi * r * share * v * of
        form += ngs.Variation(-2.0 * np.pi * r * share * currents[place] * u * of)
    for of_coil in linked:
        of_coil.Assemble()
    a = ngs.GridFunction(space)
    ngs.solvers.NewtonMinimization(form, a, maxit=60, maxerr=1e-10, printing=False)
    flux = [ngs.InnerProduct(of_coil.vec, a.vec) for of_coil in linked]
    g = ngs.GridFunction(ngs.H1(mesh, order=1))
    g.vec.FV().NumPy()[:] = model.shift
    b_r, b_z = -ngs.grad(a)[1], ngs.grad(a)[0] + a / r
    pull = b_r * b_z * ngs.grad(g)[0] + 0.5 * (b_z * b_z - b_r * b_r) * ngs.grad(g)[1]
    force = -ngs.Integrate(2.0 * np.pi * r / VACUUM * pull, mesh, order=6)
    return np.array(flux), force


@pytest.mark.parametrize(
    ("currents", "position"),
    [((1.0, 0.0), 0.0), ((2.0, 0.0), 0.0), ((2.0, 0.5), 0.8e-3), ((3.0, 0.0), -0.8e-3)],
)
def test_flux_and_force_are_those_of_another_program(model, currents, position):
    ours = solve_field(model, currents, position)
    flux, force = solved(model, currents, position)
    largest = np.abs(ours.flux).max()
    assert flux == pytest.approx(ours.flux, abs=1e-4 * largest)
    assert force == pytest.approx(ours.force, rel=1e-3)
