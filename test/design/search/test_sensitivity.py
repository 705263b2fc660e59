# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Sensitivities, on an analytic stand-in for the field computation."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.design.search.sensitivity import Study, names_of, one_at_a_time, sobol_indices
from valve_twin.design.search.tasks import Outcome


class Ishigami:
    """The function whose indices are known in closed form, a = 7, b = 0.1, in three dimensions."""

    NAMES = ("armature_radius", "gap_ratio", "tube_ratio")

    def __init__(self, design, share):
        self.own = {n: getattr(design, n) for n in self.NAMES}
        self.share, self.noise = share, np.random.default_rng(5)

    def __call__(self, tasks):
        for task in tasks:
            # a quarter of the usual period: smooth enough for a surrogate of 300 points
            x, y, z = (
                np.pi / 2 * (task.values.get(n, own) / own - 1.0) / self.share
                for n, own in self.own.items()
            )
            rise = np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)
            noise = float(np.random.default_rng(len(task.key)).random())
            figures = {
                "rise_s": 10.0 + rise,
                "loss": noise + 1e-9 * hash(task.key),
                "overshoot": 0.0,
            }
            yield Outcome(task.key, task.fidelity, task.values, figures)


def exact():
    """Return the first indices of the function, by quadrature."""
    t, w = np.polynomial.legendre.leggauss(40)
    t, w = t * np.pi / 2, w / 2
    x, y, z = np.meshgrid(t, t, t, indexing="ij")
    f = np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)
    weight = w[:, None, None] * w[None, :, None] * w[None, None, :]
    mean = np.sum(weight * f)
    total = np.sum(weight * (f - mean) ** 2)
    alone = []
    for axis in range(3):
        others = tuple(k for k in range(3) if k != axis)
        of_axis = np.sum(weight * f, axis=others) / w
        alone.append(np.sum(w * (of_axis - mean) ** 2) / total)
    return alone


def test_indices_are_those_of_the_closed_form_within_their_intervals(design, archive):
    study = Study(design, archive, Ishigami(design, 0.05))
    (found,) = sobol_indices(study, Ishigami.NAMES, 300, figures=("rise_s",), seed=1)
    assert found.surrogate is not None
    assert found.surrogate.told > 0.98
    for name, wanted in zip(Ishigami.NAMES, exact(), strict=True):
        middle, low, high = found.first[name]
        assert middle == pytest.approx(wanted, abs=0.03)
        assert low - 0.01 <= wanted <= high + 0.01
        assert found.total[name][0] >= middle - 0.03


def test_every_change_knows_the_design_that_it_changes(design, archive, stand_in):
    seen = []

    def run(tasks):
        seen.extend(tasks)
        return stand_in(tasks)

    one_at_a_time(Study(design, archive, run), ("gap_ratio",))
    assert [of.like for of in seen] == [design] * 3
    assert {of.fidelity for of in seen} == {"evened"}


def test_static_curves_and_poles_have_indices_beside_the_loop(design, archive):
    def smooth(tasks):
        for task in tasks:
            r, g = (task.values[n] / getattr(design, n) for n in ("armature_radius", "gap_ratio"))
            figures = dict.fromkeys(("rise_s", "settling_s", "overshoot", "loss"), r)
            figures |= {"margin": 80.0 * r, "current_pole_2_hz": 200.0 / g,
                        "force_pole_2_hz": 100.0 + r + g}  # fmt: skip
            curves = {"force": (1.0, -100.0 * r * r / g), "flux": (0.1 / g, 0.0)}
            yield Outcome(task.key, task.fidelity, task.values, figures, curves)

    study = Study(design, archive, smooth)
    found = {of.figure: of for of in sobol_indices(study, ("armature_radius", "gap_ratio"), 30)}
    assert list(found)[4:] == ["force", "flux", "margin", "current_pole_2_hz", "force_pole_2_hz"]
    force = found["force"].first  # of r^2 / g: 4 to 1 for small changes
    assert force["armature_radius"][0] == pytest.approx(0.8, abs=0.01)
    assert force["gap_ratio"][0] == pytest.approx(0.2, abs=0.01)
    assert found["flux"].total["armature_radius"][0] == pytest.approx(0.0, abs=0.01)
    assert found["margin"].surrogate is not None
    assert found["margin"].surrogate.error == pytest.approx(0.0, abs=1e-9)


def test_a_poor_surrogate_gives_no_indices(design, archive):
    study = Study(design, archive, Ishigami(design, 0.05))
    found = sobol_indices(study, Ishigami.NAMES, 30, figures=("loss", "overshoot"))
    assert found[0].first == {}
    assert "variance of designs it has not seen" in found[0].refused
    assert found[1].refused == "it is the same in all designs"


def test_one_at_a_time_gives_changes_of_curves_and_figures(design, archive, stand_in):
    names = ("armature_radius", "gap_ratio", "turns")
    middle, effects = one_at_a_time(Study(design, archive, stand_in), names, 0.1)
    radius, gap, turns = effects
    assert radius.lower == pytest.approx(7.2e-3)
    assert radius.force == pytest.approx(0.1)
    assert radius.flux == pytest.approx(0.0, abs=1e-12)
    assert gap.flux == pytest.approx(0.1)
    assert gap.figures["rise_s"][1] / middle.figures["rise_s"] > 1.09
    assert (turns.lower, turns.upper) == (338.0, 413.0)
    assert len(stand_in.keys) == 7


def test_a_number_whose_design_fails_is_a_line_and_the_others_go_on(design, archive, stand_in):
    _, effects = one_at_a_time(Study(design, archive, stand_in), ("turns", "gap_ratio"), 0.2)
    turns, gap = effects
    assert "winding height" in turns.error
    assert np.isnan(turns.figures["rise_s"][1])
    assert np.isfinite(turns.figures["rise_s"][0])
    assert np.isfinite(gap.figures["rise_s"][1])


def test_a_design_that_fails_ends_it(design, archive):
    def fails(tasks):
        return [Outcome(t.key, t.fidelity, t.values, error="why not") for t in tasks]

    with pytest.raises(ValueError, match="the design itself cannot be evaluated: why not"):
        one_at_a_time(Study(design, archive, fails), ("gap_ratio",))
    with pytest.raises(ValueError, match="20 of 20 designs failed: why not"):
        sobol_indices(Study(design, archive, fails), ("gap_ratio", "tube_ratio"), 20)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["gap"], "'gap' is no number of the design"),
        (["steel.table_h"], "'steel.table_h' is no number of the design"),
        (["gap_ration"], "'gap_ration' is no number of the design; did you mean 'gap_ratio'"),
        (["wire_overall"], "wire_overall = 0: a share of it is no change"),
    ],
)
def test_unknown_numbers_are_one_line(design, given, said):
    with pytest.raises(ValueError, match=said):
        names_of(design, given)


def test_too_few_designs_are_refused(design, archive, stand_in):
    with pytest.raises(ValueError, match=r"2 numbers, 5 designs: .* 6 designs or more"):
        sobol_indices(Study(design, archive, stand_in), ("gap_ratio", "tube_ratio"), 5)
