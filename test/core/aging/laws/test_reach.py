# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import stdtr

from valve_twin.core.aging.laws.reach import first_places, reached, student, student_table
from valve_twin.core.aging.laws.shapes import curves, grid

SHARES = np.array([0.025, 0.5, 0.975])
AHEAD = np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 48)]) * 100.0
SINCE, LENGTH = 98.0, 100.0


@pytest.mark.parametrize("freedom", [1.0, 3.5, 30.0, 500.0, 1e6])
def test_the_table_is_the_distribution(freedom):
    table = student_table(freedom)
    z = np.concatenate([np.linspace(-12.0, 12.0, 501), np.sinh(np.linspace(-20.0, 20.0, 200))])
    assert [student(table, v) for v in z] == pytest.approx(stdtr(freedom, z), abs=1e-10)


def shapes(seed):
    """Return law and rows of shapes as a fit leaves them, some of which bend back."""
    random = np.random.default_rng(seed)
    law, number, _ = grid(())
    chosen = np.sort(random.choice(len(law), 12, replace=False))
    weight = random.dirichlet(np.ones(12))
    gap, change = -random.uniform(0.5, 2.0, 12), random.normal(0.7, 0.4, 12)
    spread = random.uniform(0.01, 0.1, (2, 12))
    cov = random.uniform(-0.5, 0.5, 12) * np.sqrt(spread[0] * spread[1])
    return law[chosen], np.stack([number[chosen], weight, gap, change, spread[0], cov, spread[1]])


def probability(law, rows, freedom, ahead):
    """Return the probability at places ahead by scipy, the largest so far of every shape."""
    number, weight, gap, change, var_gap, cov, var_change = (r[:, None] for r in rows)
    h = curves(law, number[:, 0], (SINCE + ahead) / LENGTH) - 1.0
    z = (gap + change * h) / np.sqrt(var_gap + 2.0 * h * cov + h * h * var_change)
    return (weight * np.maximum.accumulate(stdtr(freedom, z), axis=1)).sum(axis=0)


@pytest.mark.parametrize("seed", range(1000, 1008))
def test_places_are_those_at_which_scipy_finds_the_shares(seed):
    law, rows = shapes(seed)
    table, freedom = student_table(40.0), 40.0
    found = first_places(law, rows, table, SINCE, LENGTH, AHEAD, SHARES)
    fine = np.unique(np.concatenate([AHEAD, np.geomspace(1e-3, 1e6, 20_001)]))
    reach = probability(law, rows, freedom, fine)
    for share, place in zip(SHARES, found, strict=True):
        if reach[-1] < share:
            assert place == np.inf
            continue
        j = int(np.argmax(reach >= share))
        assert reached(law, rows, table, SINCE, LENGTH, fine[: j + 1]) == pytest.approx(reach[j])
        low = fine[max(j - 1, 0)]
        assert low * (1.0 - 1e-3) - 1e-3 <= place <= fine[j] * (1.0 + 1e-3) + 1e-3


def test_a_single_line_reaches_its_limit_where_the_closed_form_does():
    rows = np.array([[0.0], [1.0], [-1.0], [0.5], [0.01], [0.0], [0.001]])
    law, table = np.zeros(1, np.int64), student_table(25.0)
    found = first_places(law, rows, table, SINCE, LENGTH, AHEAD, SHARES)

    def off(ahead, share):
        h = (SINCE + ahead) / LENGTH - 1.0
        return stdtr(25.0, (0.5 * h - 1.0) / np.sqrt(0.01 + h * h * 0.001)) - share

    exact = [brentq(off, 0.0, 1e5, (share,)) for share in SHARES]
    assert found == pytest.approx(exact, rel=1e-4)
