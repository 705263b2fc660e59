# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The search, on an analytic stand-in for the field computation."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import pytest

from valve_twin.design.search.archive import Archive, header_of
from valve_twin.design.search.front import Limits
from valve_twin.design.search.optimise import Progress, Settings, make_problem, optimise

VARIED = {
    "armature_radius": (7e-3, 9e-3),
    "gap_ratio": (0.17, 0.21),
    "turns": (299, 400),
    "valve.preload": (5.0, 30.0),
}
SETTINGS = Settings(population=12, generations=8, seed=3)


def test_it_finds_better_designs_and_its_hypervolume_never_falls(design, archive, stand_in):
    told: list[Progress] = []
    problem = make_problem(design, VARIED)
    found = optimise(problem, SETTINGS, archive, stand_in, told.append)
    volumes = [at.hypervolume for at in told]
    assert volumes == sorted(volumes)
    assert volumes[-1] > volumes[0] > 0.0
    own, best = found.reference.figures, found.chosen.figures
    assert all(best[name] < own[name] for name in ("rise_s", "settling_s"))
    assert best["loss"] <= 1.15 * own["loss"]
    assert all(of.fidelity == "twice" for of in (found.reference, *found.front))
    assert len(stand_in.keys) == len(set(stand_in.keys))
    assert told[-1].failed == sum(bool(of.error) for of in found.searched) > 0
    assert {of.error for of in found.searched} >= {"", "a line that says why"}


def test_the_front_on_its_final_fields_counts_as_well(design, archive, stand_in):
    """It is half of the work, and nothing was told of it."""
    advanced: list[int] = []
    expected: list[int] = []
    problem = make_problem(design, VARIED)
    found = optimise(problem, SETTINGS, archive, stand_in, advance=lambda: advanced.append(1),
                     expect=expected.append)  # fmt: skip
    (more,) = expected
    assert more % 2 == 0
    assert more >= 2 * (1 + len(found.front))
    assert len(advanced) == SETTINGS.population * SETTINGS.generations + more


def test_an_interrupted_search_goes_on_to_the_same_front(design, archive, stand_in, tmp_path):
    problem = make_problem(design, VARIED)
    whole = optimise(problem, SETTINGS, archive, stand_in)
    path = tmp_path / "other.jsonl"

    def ends_early(tasks):
        if len(stand_in.keys) > 40:
            raise KeyboardInterrupt
        yield from islice(stand_in(tasks), 9)

    stand_in.keys.clear()
    with pytest.raises((KeyboardInterrupt, ValueError)):
        optimise(problem, SETTINGS, Archive(path, header_of(design, "")), ends_early)
    done = len(stand_in.keys)
    assert done > 0
    again = optimise(problem, SETTINGS, Archive(path, header_of(design, "")), stand_in)
    assert again == whole
    assert len(stand_in.keys) == len(set(stand_in.keys))


def test_the_seed_decides(design, archive, stand_in, tmp_path):
    problem = make_problem(design, VARIED)
    one = optimise(problem, SETTINGS, archive, stand_in)
    other = Archive(tmp_path / "other.jsonl", header_of(design, ""))
    settings = Settings(population=12, generations=8, seed=4)
    assert optimise(problem, settings, other, stand_in).searched != one.searched


def test_a_design_with_other_figures_on_twice_the_mesh_is_left_out(design, archive, stand_in):
    """Designs of little preload settle later there by more than is promised."""

    def run(tasks):
        for of in stand_in(tasks):
            if of.fidelity == "twice" and of.values["valve.preload"] < 12.0:
                late = {**of.figures, "settling_s": of.figures["settling_s"] + 3e-4}
                yield replace(of, figures=late)
            else:
                yield of

    problem = make_problem(design, VARIED)
    found = optimise(problem, SETTINGS, archive, run)
    preloads = [of.values["valve.preload"] for of in found.front]
    assert found.apart
    assert preloads
    assert min(preloads) >= 12.0 > max(of.values["valve.preload"] for of in found.apart)
    kept = Settings(population=12, generations=8, seed=3, final="usual")
    assert optimise(problem, kept, archive, run).apart == ()


def test_where_all_figures_differ_on_twice_the_mesh_it_says_so(design, archive, stand_in):
    def run(tasks):
        for of in stand_in(tasks):
            factor = 0.5 if of.fidelity == "twice" else 1.0
            yield replace(of, figures={**of.figures, "rise_s": factor * 3e-3})

    settings = Settings(population=4, generations=2)
    varied = {"armature_radius": (7e-3, 9e-3)}
    with pytest.raises(ValueError, match=r"none of (\d+) designs is left: \1 differ on usual and"):
        optimise(make_problem(design, varied), settings, archive, run)


def test_without_a_feasible_point_the_nearest_is_named(design, archive, stand_in):
    settings = Settings(population=4, generations=2, limits=Limits(overshoot=0.015))
    with pytest.raises(ValueError, match=r"none of \d+ designs .*overshoot = 0.02: must be 0.015"):
        optimise(make_problem(design, VARIED), settings, archive, stand_in)


def test_a_reference_that_fails_ends_it(design, archive):
    from valve_twin.design.search.tasks import lost_design

    def fails(tasks):
        return [lost_design(task, "it is broken") for task in tasks]

    with pytest.raises(ValueError, match="the reference cannot be evaluated: it is broken"):
        optimise(make_problem(design, VARIED), SETTINGS, archive, fails)


@pytest.mark.parametrize(
    ("varied", "said"),
    [
        ({}, "nothing is varied"),
        ({"gap_ratio": (0.2, 0.3)}, "gap_ratio = 0.1875 of the reference: lies outside"),
        ({"turns": (400, 300)}, "turns: bounds 400 to 300: the lower must be below"),
        ({"diameter": (1.0, 2.0)}, "'diameter' is no number of the design"),
    ],
)
def test_bad_problems_are_one_line(design, varied, said):
    with pytest.raises(ValueError, match=said):
        make_problem(design, varied)


def test_an_unknown_fidelity_is_refused():
    with pytest.raises(ValueError, match="fidelity 'best': must be one of search, usual, twice"):
        Settings(fidelity="best")
