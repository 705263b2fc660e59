# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the strangers of the generic verdict differ in."""

import numpy as np

from valve_twin.validation.any_strangers.draw import CYCLES, draw, wanted
from valve_twin.validation.any_strangers.kernel import KINDS
from valve_twin.validation.any_strangers.troubles import AFTER, RIGHT

DRAWN = [draw(seed) for seed in range(73_000, 73_120)]


def test_a_seed_gives_the_same_stranger_and_another_seed_another():
    assert draw(5) == draw(5)
    assert draw(5) != draw(6)


def test_they_differ_in_all_that_was_asked_for():
    assert {s.kind for s in DRAWN} == set(KINDS)
    troubles = [t for s in DRAWN for t in s.troubles]
    assert {t.name for t in troubles} == set(RIGHT)
    assert {t.size for t in troubles} == {"medium", "large"}
    assert min(t.onset for t in troubles) == 1
    assert max(t.onset for t in troubles) == CYCLES - AFTER
    assert {s.logger.bits for s in DRAWN} == {10, 12, 14, 16}
    assert {s.logger.period_s for s in DRAWN} == {0.05, 0.1, 0.2}
    assert {s.programme.varies for s in DRAWN} == {0.0, 0.05, 1.0}


def test_a_programme_steps_and_ramps_and_ends_where_it_began():
    for stranger in DRAWN[:20]:
        asked, move = wanted(stranger.programme, np.random.default_rng(3))
        assert len(asked) == len(move)
        assert asked[0] == asked[-1] == 0.0
        assert asked.max() == 1.0
        assert move[-1] == len(stranger.programme.levels)
