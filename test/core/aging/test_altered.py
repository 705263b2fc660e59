# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A copy with some fields changed is what `dataclasses.replace` makes."""

from dataclasses import replace

import pytest

from valve_twin.core.aging.altered import altered
from valve_twin.core.aging.drift import NO_LIMIT
from valve_twin.core.aging.life import NEVER


def test_it_is_the_copy_that_the_standard_library_makes():
    made = altered(NEVER, low=3.0)
    assert made == replace(NEVER, low=3.0)
    assert NEVER.low == float("inf")
    assert altered(NO_LIMIT, beyond=True, value=2.0).remaining is NEVER


def test_a_field_that_is_none_is_refused():
    with pytest.raises(KeyError, match="lower"):
        altered(NEVER, lower=3.0)  # type: ignore[call-arg]
