# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Frames for the tests of estimation: made by hand or by the simulated plant."""

import numpy as np
import pytest

from valve_twin.core.simulation import configure, simulate_cycles
from valve_twin.core.simulation.block import to_frames
from valve_twin.core.types import Frames
from valve_twin.core.valves.press_cartridge.plant import default_simulation

PERIOD_S = 0.03


def frames_of(position, v_in=0.0, v_out=0.0):
    n = len(position)
    inputs = np.column_stack([np.broadcast_to(v_in, n), np.broadcast_to(v_out, n)]).astype(float)
    nothing = np.full(n, np.nan)
    stamps = np.arange(n, dtype=np.int64) * round(PERIOD_S * 1e9)
    return Frames(stamps, np.asarray(position, float), inputs, nothing, nothing, np.ones(n, bool))


@pytest.fixture(scope="session")
def make_frames():
    """Return a function that makes frames of a position and two commands, 0.03 s apart."""
    return frames_of


@pytest.fixture(scope="session")
def plant_cycles():
    """Return a function that simulates reference cycles with a measurement layer."""

    def simulate(count, seed, **layer):
        config = configure(default_simulation(), {"measurement": layer})
        return [to_frames(block) for block in simulate_cycles(config, count, seed)]

    return simulate
