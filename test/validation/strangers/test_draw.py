# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What strangers differ in."""

import dataclasses

from valve_twin.validation.strangers.campaign import seeds
from valve_twin.validation.strangers.draw import draw
from valve_twin.validation.strangers.troubles import AGING_LAWS, TROUBLES


def test_a_seed_gives_the_same_stranger_and_another_seed_another():
    assert draw(5) == draw(5)
    assert draw(5) != draw(6)


def test_the_scored_strangers_differ_in_all_that_was_asked_for():
    drawn = [draw(seed) for seed in seeds()]
    assert len(drawn) >= 200
    assert {s.aging.law for s in drawn} == set(AGING_LAWS)
    assert {t.name for s in drawn for t in s.troubles} == set(TROUBLES)
    assert {len(s.troubles) for s in drawn} == {0, 1, 2}
    assert min(t.onset for s in drawn for t in s.troubles) == 1
    assert {bool(t.end) for s in drawn for t in s.troubles} == {True, False}
    loggers = [s.logger for s in drawn]
    assert {x.bits for x in loggers} == {6, 8, 10, 12, 14, 16}
    assert {x.refresh for x in loggers} == {1, 2, 4}
    assert min(x.noise for x in loggers) < 2e-5
    assert max(x.noise for x in loggers) > 5e-3
    apart = [abs(x.clocks_apart) for x in loggers if x.clocks_apart]
    assert min(apart) >= 50e-6
    assert max(apart) <= 500e-6
    assert {len(s.recipes) for s in drawn} == {1, 2}


def test_each_law_of_aging_starts_new_and_ends_at_its_size():
    aging = draw(0).aging
    for law in set(AGING_LAWS) - {"none"}:
        own = dataclasses.replace(aging, law=law, size=-0.2, bend=2.0, steps=(10, 20))
        assert own.share(1.0) == 0.0
        assert abs(own.share(61.0) + 0.2) < 1e-12
