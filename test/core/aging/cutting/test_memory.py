# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A memory saves searches and changes no bit of what is said."""

import json
from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.cutting import memory as module
from valve_twin.core.aging.cutting.ahead import look_ahead
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.aging.cutting.stretch import search
from valve_twin.core.past.columns import past_of
from valve_twin.core.types import Condition, Estimate, EstimateStatus, Parameter, ParameterValue

CONFIG = AgingConfig(max_candidates=40)
PARAMETERS = (Parameter("gain", "1", "", trend=True),)
LOOKS = range(200, 260)


def life(cycles=260, *, products=1, load=False):
    """Return estimates that wear, with a step at 130; products and the load change their level."""
    random = np.random.default_rng(11)
    found, start = [], 0
    for n in range(1, cycles + 1):
        which, force = n // 7 % products, random.uniform(-1.0, 1.0)
        value = (1.0 + 1e-4 * n + 0.02 * (n > 130)) * (1.0 + 0.1 * which) + 0.05 * force * load
        length = (25 + 8 * which) * 10**9
        found.append(
            Estimate(
                model="",
                estimator="",
                cycle=n,
                start_ns=start,
                end_ns=start + length,
                parameters=(ParameterValue("gain", value + 2e-3 * random.standard_normal()),),
                status=EstimateStatus.ACCEPTED,
                reason="",
                used_by_trend=True,
                conditions=(Condition("load", force),),
            )
        )
        start += length
    return found


def said(found):
    return repr((found.trends, found.verdict))


@pytest.fixture
def searches(monkeypatch):
    """Return a list that gets the length of every search that is made."""
    made = []

    def counted(x, *rest):
        made.append(len(x))
        return search(x, *rest)

    monkeypatch.setattr(module, "search", counted)
    return made


@pytest.mark.no_cover
@pytest.mark.parametrize(
    ("history", "config"),
    [
        (life(), CONFIG),
        (life(products=2), CONFIG),
        (life(load=True), replace(CONFIG, covariates=("load",))),
    ],
    ids=["plain", "products", "covariates"],
)
def test_it_changes_no_bit_and_saves_most_searches(history, config, searches):
    memory, with_memory = Memory(), []
    for end in LOOKS:
        past = past_of(history[:end])
        with_memory.append(assess(past, (), config, parameters=PARAMETERS, memory=memory))
        look_ahead(past, (), config, parameters=PARAMETERS, memory=memory)
    saved = len(searches)
    searches.clear()
    without = [assess(past_of(history[:n]), (), config, parameters=PARAMETERS) for n in LOOKS]
    assert list(map(said, with_memory)) == list(map(said, without))
    assert saved < 0.5 * len(searches)


def test_what_was_sought_ahead_is_not_sought_in_the_verdict(searches):
    memory, history = Memory(), life()
    late = []
    for end in LOOKS:
        past, before = past_of(history[:end]), len(searches)
        assess(past, (), CONFIG, parameters=PARAMETERS, memory=memory)
        late.append(len(searches) - before)
        look_ahead(past, (), CONFIG, parameters=PARAMETERS, memory=memory)
    assert late[0] == 1
    assert sum(late[1:]) == 0
    assert len(searches) > 5


def stored(memory):
    """Return a memory that took over what another froze, through a text."""
    head, arrays = memory.freeze()
    found = Memory()
    found.thaw(json.loads(json.dumps(head)), arrays)
    return found


def test_after_it_was_stored_nothing_is_sought_again(searches):
    memory, past = Memory(), past_of(life())
    before = assess(past, (), CONFIG, parameters=PARAMETERS, memory=memory)
    searches.clear()
    after = assess(past, (), CONFIG, parameters=PARAMETERS, memory=stored(memory))
    assert said(after) == said(before)
    assert not searches


def test_what_was_stored_is_not_used_for_other_values(searches):
    memory, history = Memory(), life()
    assess(past_of(history), (), CONFIG, parameters=PARAMETERS, memory=memory)
    changed = replace(history[50], parameters=(ParameterValue("gain", 1.007),))
    other = past_of([*history[:50], changed, *history[51:]])
    searches.clear()
    found = assess(other, (), CONFIG, parameters=PARAMETERS, memory=stored(memory))
    assert searches
    assert said(found) == said(assess(other, (), CONFIG, parameters=PARAMETERS))


def test_other_rules_begin_anew(searches):
    memory, past = Memory(), past_of(life())
    assess(past, (), CONFIG, parameters=PARAMETERS, memory=memory)
    other = replace(CONFIG, penalty_scale=1e6)
    searches.clear()
    found = assess(past, (), other, parameters=PARAMETERS, memory=memory)
    assert searches
    assert found.trends[0].segments == 1
