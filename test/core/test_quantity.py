# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import math
from dataclasses import dataclass

import pytest

from valve_twin.core.quantity import check_quantities, describe, nearest_hint, quantity


@dataclass(frozen=True)
class Tank:
    volume: float = quantity(1.0, "m^3", "Volume", lower=0.1, upper=5.0, assumed=True)

    def __post_init__(self):
        check_quantities(self)


@pytest.mark.parametrize("value", [0.0, 6.0, math.nan, math.inf, "1.0", True, None])
def test_refuses_a_value_with_its_name_value_and_range(value):
    with pytest.raises(ValueError, match=r"Tank\.volume = .*from 0\.1 to 5 \[m\^3\]") as caught:
        Tank(volume=value)
    assert repr(value) in str(caught.value)


def test_takes_the_ends_of_the_range_and_integers():
    assert [Tank(v).volume for v in (0.1, 1, 5.0)] == [0.1, 1, 5.0]


def test_an_assumption_carries_its_tag():
    assert [d.description for d in describe(Tank)] == ["Volume (assumed)"]


def test_hint_names_the_nearest_name_or_all():
    assert nearest_hint("aera_in", ["area_in", "mass"]) == "; did you mean 'area_in'?"
    assert nearest_hint("zzz", ["area_in", "mass"]) == "; known are area_in, mass"
