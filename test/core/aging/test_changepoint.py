# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import itertools

import numpy as np
import pytest

from valve_twin.core.aging.changepoint import _partition, _sums, best_lines, find_outliers

DEFAULT = {"least": 8, "most": 12, "max_candidates": 500}


def squares(x, y, a, b):
    fit = np.polyfit(x[a:b], y[a:b], 1)
    return float(np.sum((y[a:b] - np.polyval(fit, x[a:b])) ** 2))


@pytest.mark.parametrize("pieces", [2, 3])
def test_partition_is_the_best_of_all(pieces):
    rng = np.random.default_rng(pieces)
    n, least = 26, 4
    x, y = np.linspace(-0.5, 0.5, n), rng.standard_normal(n)
    places = np.arange(n + 1)
    found = _partition(_sums(x, y), places, least, pieces)[pieces - 1, : pieces + 1]
    best, wanted = np.inf, None
    for inner in itertools.combinations(range(least, n - least + 1), pieces - 1):
        bounds = (0, *inner, n)
        if all(b - a >= least for a, b in itertools.pairwise(bounds)):
            total = sum(squares(x, y, a, b) for a, b in itertools.pairwise(bounds))
            if total < best:
                best, wanted = total, bounds
    assert tuple(found) == wanted


def test_exact_pieces_are_found_at_their_places():
    x = np.arange(60.0)
    y = np.where(x < 23, 1.0 - 0.01 * x, np.where(x < 41, 0.9, 0.9 + 0.02 * (x - 41)))
    assert list(best_lines(x, y, **DEFAULT)) in ([0, 23, 41, 60], [0, 23, 42, 60])


@pytest.mark.parametrize("n", [3, 15, 16, 200])
def test_an_exact_line_is_not_cut(n):
    x = np.arange(float(n))
    assert list(best_lines(x, 0.0088 - 1e-5 * x, **DEFAULT)) == [0, n]


def test_a_constant_is_not_cut():
    assert list(best_lines(np.arange(50.0), np.full(50, 0.0088), **DEFAULT)) == [0, 50]


def test_steep_aging_is_one_line_and_not_a_staircase(scatter):
    x = np.arange(200.0)
    y = 1.0 - 0.005 * x + 0.01 * scatter(0, 200)  # a hundred standard deviations in all
    assert list(best_lines(x, y, **DEFAULT)) == [0, 200]


def test_change_of_slope_alone_is_found(scatter):
    x = np.arange(120.0)
    y = 1.0 - 0.0026 * np.maximum(x - 60, 0.0) + 0.013 * scatter(1, 120)
    bounds = best_lines(x, y, **DEFAULT)
    assert len(bounds) == 3
    assert abs(bounds[1] - 60) <= 12


def test_places_do_not_depend_on_unit_sign_or_origin(scatter):
    x = np.arange(150.0)
    y = 1.0 - 0.05 * (x >= 70) + 0.01 * scatter(2, 150)
    wanted = list(best_lines(x, y, **DEFAULT))
    assert wanted == [0, 70, 150]
    assert list(best_lines(0.5 * x + 1e6, -1e-4 * y, **DEFAULT)) == wanted


def test_long_histories_are_refined_to_the_same_place(scatter):
    x = np.arange(1200.0)
    y = 1.0 - 0.03 * (x >= 701) + 0.01 * scatter(3, 1200)
    exact = best_lines(x, y, least=8, most=4, max_candidates=2000)
    coarse = best_lines(x, y, least=8, most=4, max_candidates=150)
    assert list(exact) == list(coarse)
    assert abs(exact[1] - 701) <= 2


def test_wild_values_are_found_and_good_ones_kept(scatter):
    x = np.arange(100.0)
    y = 1.0 - 0.002 * x + 0.01 * scatter(4, 100)
    places = [0, 31, 32, 70, 99]
    y[places] += np.array([0.2, -0.15, 0.3, 1e6, -0.2])
    assert list(np.flatnonzero(find_outliers(x, y, 4.5))) == places


def test_a_step_is_not_wild_once_it_is_the_majority(scatter):
    x = np.arange(60.0)
    y = 1.0 - 0.1 * (x >= 50) + 0.01 * scatter(5, 60)
    assert not find_outliers(x, y, 4.5)[54:].any()


def test_few_values_are_not_judged():
    assert not find_outliers(np.arange(6.0), np.array([1, 1, 9, 1, 1, 1.0]), 4.5).any()
