# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A motion of steps through a lag, as a model without error answers it."""

import numpy as np
import pytest

PERIOD_S = 0.05
LEVELS = (0.1, 0.9, 0.4, 0.7)


@pytest.fixture(scope="session")
def motion():
    """Four moves over the span 0.8 of a cycle of 400 samples, from the last level on."""
    x, out = LEVELS[-1], []
    for wanted in np.repeat(LEVELS, 100):
        out.append(x)
        x = wanted + np.exp(-PERIOD_S / 0.4) * (x - wanted)
    return np.array(out)
