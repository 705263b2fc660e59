# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.valves.hybrid_actuator import electrical


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_coil_without_current_that_is_known_is_refused(value):
    """Of no column at all numpy has no least squares."""
    fit = electrical._solved(np.full((30, 3), value), np.ones(30), None, 0.0)  # type: ignore[arg-type]
    assert np.isnan(fit.resistance)
    assert "do not tell the resistance apart" in fit.reason
