# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Sisters are built like a stranger, differ as assumed, and do not hang on how many there are."""

import numpy as np
import pytest

from valve_twin.validation.strangers.draw import draw
from valve_twin.validation.strangers.sisters import (
    EARLY_FAULTS,
    JUDGED_CYCLES,
    SHARES,
    SISTER_CYCLES,
    family,
)
from valve_twin.validation.strangers.troubles import GROSS


def test_a_sister_more_changes_nothing_else():
    few, more = family(73000, 2), family(73000, 5)
    assert few.sisters == more.sisters[:2]
    assert (few.own, few.troubles) == (more.own, more.troubles)
    assert {s.cycles for s in few.sisters} == {SISTER_CYCLES}
    assert few.own.cycles == JUDGED_CYCLES


def test_sisters_have_plc_logger_and_products_of_the_stranger_and_no_fault():
    base, found = draw(73004), family(73004, 3)
    for one in (*found.sisters, found.own):
        assert (one.plc, one.recipes, one.troubles) == (base.plc, base.recipes, ())
        assert one.logger.clocks_apart == 0.0
        assert one.logger.period_s == base.logger.period_s
    assert len({one.seed for one in (*found.sisters, found.own)}) == 4


@pytest.mark.parametrize("name", ["r_in", "leak", "gas", "supply"])
def test_they_differ_by_what_is_assumed(name):
    each = [getattr(s.press, name) for s in family(73004, 200).sisters]
    far = np.log(np.array(each) / getattr(draw(73004).press, name))
    assert far.std() == pytest.approx(SHARES[name], rel=0.2)  # 4 deviations of 200 draws
    assert abs(far.mean()) < 4.0 * SHARES[name] / np.sqrt(200)


def test_the_first_fault_is_there_from_the_first_cycle_on_and_the_others_are_not():
    for seed in range(73000, 73040):
        troubles = family(seed, 1).troubles
        assert len({t.name for t in troubles}) == EARLY_FAULTS
        assert [t.onset == 1 for t in troubles] == [True, False, False, False]
        assert all(1 <= t.onset <= 8 and not t.end for t in troubles)
        assert not any(t.name in GROSS or t.size == "small" for t in troubles)
