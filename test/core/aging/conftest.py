# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Histories with known truth for the tests of the aging monitor."""

import numpy as np
import pytest

from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue

PERIOD_NS = 30_000_000_000
LENGTH_NS = 25_500_000_000


@pytest.fixture(scope="session")
def scatter():
    """Return AR(1) scatter of unit standard deviation: scatter(seed, n, rho)."""

    def draw(seed, n, rho=0.0):
        white = np.random.default_rng(seed).standard_normal(n + 60)
        if rho == 0.0:
            return white[60:]
        out = np.zeros(n + 60)
        for i in range(1, n + 60):
            out[i] = rho * out[i - 1] + np.sqrt(1.0 - rho**2) * white[i]
        return out[60:]

    return draw


@pytest.fixture(scope="session")
def history():
    """Return stored estimates, one a 30 s cycle: history(K_in=values, leak=values, ...)."""

    def make(first_cycle=1, **columns):
        n = len(next(iter(columns.values())))
        return [
            Estimate(
                model="press_cartridge",
                estimator="output_error",
                cycle=first_cycle + i,
                start_ns=(first_cycle + i) * PERIOD_NS,
                end_ns=(first_cycle + i) * PERIOD_NS + LENGTH_NS,
                parameters=tuple(ParameterValue(k, float(v[i])) for k, v in columns.items()),
                status=EstimateStatus.ACCEPTED,
                reason="",
                used_by_trend=True,
            )
            for i in range(n)
        ]

    return make
