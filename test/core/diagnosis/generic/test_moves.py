# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The moves of a cycle."""

from itertools import pairwise

import numpy as np
import pytest

from valve_twin.core.diagnosis.generic.moves import find_moves


def test_every_step_is_a_move_with_its_way(motion):
    moves, rest = find_moves(motion)
    ways = [m.way for m in moves]
    assert ways == pytest.approx(
        [-0.6, 0.8, -0.5, 0.3], rel=0.06
    )  # less what is below 2 % of the greatest speed
    assert [m.first for m in moves] == pytest.approx([0, 100, 200, 300], abs=1)
    assert all(a.next == b.first and b.earlier == a.last for a, b in pairwise(moves))
    assert rest[90:99].all()
    assert not rest[101:105].any()


def test_a_position_that_stays_has_none():
    moves, rest = find_moves(np.full(50, 0.3))
    assert moves == ()
    assert rest.all()


def test_what_is_small_beside_the_span_is_no_move(motion):
    ripple = motion + 0.02 * (np.arange(400) > 350)
    assert len(find_moves(ripple)[0]) == 4
