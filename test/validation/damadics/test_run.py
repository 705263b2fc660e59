# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.valves.damadics.diagnosis.isolation import UNDECIDED, Diagnosis
from valve_twin.validation.damadics.run import elementary, score, varied
from valve_twin.validation.damadics.scenarios import scenarios

BY_NAME = {s.name: s for s in scenarios()}


def decided(*parts):
    """Return decision and name of 1500 samples from (first, last, name)."""
    high, named = np.zeros(1500), np.zeros(1500, dtype=np.int64)
    for first, last, name in parts:
        high[first:last], named[first:last] = 1.0, name
    return high, named


def test_a_right_name_late_in_the_alarm_is_scored_from_where_it_stands():
    parts = ((910, 1000, UNDECIDED), (1000, 1050, Diagnosis.SPRING), (1050, 1500, Diagnosis.STOP))
    found = score(BY_NAME["f1M"], *decided(*parts))
    assert (found.detection.time, found.isolation.time) == (10.0, 150.0)
    assert found.others == pytest.approx(50 / 1200)
    assert (found.accuracy, found.named, found.right) == (1.0, "f1", True)
    assert found.share == pytest.approx(450 / 590)


def test_a_wrong_name_is_not_right_however_early_the_alarm():
    found = score(BY_NAME["f18S"], *decided((901, 1500, Diagnosis.MORE_FLOW)))
    assert (found.detected, found.right, found.accuracy) == (True, False, 0.0)
    assert found.named == "f3 or f19"


def test_silence_on_what_nothing_shows_is_the_right_diagnosis_but_no_detection():
    found = score(BY_NAME["f14B"], *decided())
    assert (found.detected, found.right) == (False, False)
    assert found.accuracy == pytest.approx(1 / 3)


def test_twins_share_a_name():
    assert elementary(6) == elementary(18) == Diagnosis.ADDED_FLOW


def test_variations_come_from_their_seed():
    scenario = BY_NAME["f1S"]
    assert varied(scenario, 4) == varied(scenario, 4)
    assert varied(scenario, 4)[1] != varied(scenario, 5)[1]
