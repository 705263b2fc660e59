# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which of 16 patterns is taken: the one with the least error over the sample, or at its end."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.core.control.current_loop import PATTERNS, STEP_S, pattern
from valve_twin.core.control.flux_reconstruction import error_bound, reconstruct_flux

SUPPLY, OHM = 24.0, 2.0
TIME = 1e-4 * np.arange(61)
WANTED = 0.03 + 0.02 * np.sin(2 * np.pi * TIME / 8e-3)
CURRENT = np.ones(480)


def ways(begin):
    """Return the flux of every pattern over a sample, (16, 8)."""
    levels = [
        [start if k < before else -start for k in range(8)]
        for start, before in map(pattern, range(PATTERNS))
    ]
    return begin + STEP_S * np.cumsum(SUPPLY * np.array(levels) - OHM, axis=1)


def test_no_pattern_has_less_error_over_the_interval():
    found = reconstruct_flux(WANTED, CURRENT, OHM, SUPPLY, "interval")
    for n in range(60):
        straight = WANTED[n] + np.arange(1, 9) / 8 * (WANTED[n + 1] - WANTED[n])
        each = ((ways(found.flux[8 * n]) - straight) ** 2).sum(axis=1)
        taken = ((found.flux[8 * n + 1 : 8 * n + 9] - straight) ** 2).sum()
        assert taken == pytest.approx(each.min(), rel=1e-9)
    assert found.largest < SUPPLY * 50e-6  # where the voltage suffices


def test_the_end_is_nearer_where_the_end_is_asked_for():
    end = reconstruct_flux(WANTED, CURRENT, OHM, SUPPLY)
    over = reconstruct_flux(WANTED, CURRENT, OHM, SUPPLY, "interval")
    assert np.abs(end.error).max() <= error_bound(SUPPLY) < np.abs(over.error).max()
    assert over.largest < end.largest


def test_an_unknown_criterion_is_refused():
    with pytest.raises(ValueError, match="criterion = 'best': must be one of end, interval"):
        reconstruct_flux(WANTED, CURRENT, OHM, SUPPLY, "best")
