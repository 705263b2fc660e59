# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A past that was stored goes on as if it never had been."""

import json
from dataclasses import replace

import numpy as np
import pytest

from test.core.past.test_state import features, trends
from valve_twin.core.diagnosis.reference import NotYet
from valve_twin.core.past.columns import Settled
from valve_twin.core.past.state import AgingState
from valve_twin.core.past.stored import freeze, thaw
from valve_twin.core.types import EstimateStatus, Guard


def again(state):
    """Return a state that was frozen, went through a text, and was thawed."""
    head, arrays = freeze(state)
    copies = [np.frombuffer(a.tobytes(), a.dtype) for a in arrays]
    return thaw(json.loads(json.dumps(head)), copies)


def said(past):
    with np.printoptions(floatmode="unique", threshold=10**6):
        return repr(past)


def life():
    """Return estimates and features of 700 cycles with a fault, a refusal and a failed check."""
    random = np.random.default_rng(3)
    found = []
    faults = [(3, 200, 320), (5, 500, 701)]
    both = zip(trends(random.standard_normal(700)), features(700, 4, *faults), strict=True)
    for n, (trend, feature) in enumerate(both):
        refused = {"status": EstimateStatus.REFUSED, "reason": f"no motion in {n}"}
        found += [replace(trend, **refused) if n % 100 == 50 else trend, feature]
    return found


@pytest.mark.no_cover
@pytest.mark.parametrize("at", [3, 300, 900, 1399])
def test_it_goes_on_as_if_nothing_had_been(at):
    history = life()
    one = AgingState(recent=128, recent_features=128)
    for estimate in history[:at]:
        one.add(estimate)
    other = again(one)
    assert said(other.past()) == said(one.past())
    for estimate in history[at:]:
        one.add(estimate)
        other.add(estimate)
    assert said(other.past()) == said(one.past())


def test_reasons_and_failed_checks_come_back():
    bad = Guard("structure", False, float("inf"), 2.0, "too far")
    one = AgingState()
    for estimate in trends([1.0, 2.0]):
        refused = replace(
            estimate, status=EstimateStatus.REFUSED, reason="no motion", guards=(bad,)
        )
        one.add(refused)
    rows = again(one).past().trend
    assert rows.reasons == {0: "no motion", 1: "no motion"}
    assert rows.failed == {0: (bad,), 1: (bad,)}


def test_another_layout_is_refused():
    head, arrays = freeze(AgingState())
    with pytest.raises(ValueError, match="it is of layout 0"):
        thaw({**head, "layout": 0}, arrays)


@pytest.mark.parametrize("doubt", ["too noisy", NotYet("no reference yet")])
def test_a_doubt_stays_one_that_more_cycles_take_back_or_not(doubt):
    arrays: list[np.ndarray] = []
    head = AgingState().freeze(arrays)
    one = AgingState.thaw({**head, "settled": Settled((), 3, 2, doubt)}, arrays)
    after = again(one).past().settled
    assert after is not None
    assert after.doubt == doubt
    assert type(after.doubt) is type(doubt)
