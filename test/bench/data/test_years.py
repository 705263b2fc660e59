# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is measured of years is what its name says, and stands beside a committed ratio."""

import pytest

from valve_twin.bench.data import years
from valve_twin.bench.run import committed_ratios


def test_a_beginning_finds_every_fault_over():
    assert years._begins_with_faults(0) > 0.0  # which refuses other findings


@pytest.mark.parametrize("form", ["quick", "full"])
def test_verdicts_and_beginnings_with_features_are_committed(form):
    of_features = [n for n in committed_ratios(form) if "features" in n or "faults" in n]
    assert len(of_features) == 3
