# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Materials: the closed form, tables and what is no magnetisation curve."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.design.materials import Magnet, Steel

PUBLIC = {318.0: 0.865, 478.0: 1.111, 796.0: 1.331, 1592.0: 1.50, 3183.0: 1.60, 7958.0: 1.78,
          15900.0: 1.905, 31800.0: 2.025, 79600.0: 2.165}  # fmt: skip
"""AISI 1008, A/m: T."""


def test_the_closed_form_follows_the_public_table():
    h, b = np.array(list(PUBLIC)), np.array(list(PUBLIC.values()))
    assert np.abs(Steel().flux_density(h) / b - 1.0).max() < 0.05


@pytest.mark.parametrize(
    ("h", "b", "words"),
    [
        ((0.0, 100.0, 200.0), (0.0, 1.0, 0.9), r"table_b\[2\] = 0.9 T after 1: must rise"),
        ((0.0, 100.0, 100.0), (0.0, 1.0, 1.1), r"table_h\[2\] = 100 A/m after 100: must rise"),
        ((0.0, 100.0), (0.0, 1.0), "must be as many, 3 or more"),
        ((1.0, 100.0, 200.0), (0.0, 1.0, 1.1), "begins with 0 and 0"),
        ((0.0, 100.0, 1e6), (0.0, 1.0, 1.1), "less than vacuum"),
        (
            (0.0, 100.0, 8e4),
            (0.0, 1000.0, 2160.0),  # mT
            r"table_b\[1\] = 1000 T at 100 A/m: 1e\+03 T beyond that of vacuum; must be at most 4",
        ),
        (
            (0.0, 0.3, 80.0),
            (0.0, 0.8, 2.16),  # kA/m
            r"table_b\[1\] = 0.8 T at 0.3 A/m: rises by 2.67 H/m, 2.12e\+06 times vacuum; "
            r"must be at most 1e\+06",
        ),
    ],
)
def test_a_curve_that_is_none_is_refused_with_place_and_value(h, b, words):
    with pytest.raises(ValueError, match=words):
        Steel(table_h=h, table_b=b)


def test_a_magnet_says_what_it_may_be():
    with pytest.raises(ValueError, match=r"remanence = 11.0: must be a number from -2 to 2 \[T\]"):
        Magnet(remanence=11.0)
