# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from valve_twin.core.quantity import suggest


def test_the_nearest_name_is_suggested():
    assert suggest("perid_s", ["period_s", "model"]) == "did you mean 'period_s'?"


def test_where_none_is_near_the_first_are_listed():
    assert suggest("x", ["alpha", "beta"]) == "there are alpha, beta"
    assert suggest("x", [f"name_{n}" for n in range(20)], shown=2).endswith("and 18 more")
    assert suggest("x", []) == "there are none"
