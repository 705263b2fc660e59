# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A simulated press valve whose cycles are looked at for faults."""

from copy import deepcopy

import pytest

from valve_twin.core.diagnosis.derive import Rig
from valve_twin.core.simulation import SimulatedValve
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.registry import complete_options


@pytest.fixture(scope="session")
def rig():
    return Rig(MODEL, complete_options(MODEL, {}), MODEL.simulation())


@pytest.fixture(scope="session")
def table():
    return MODEL.signatures()


@pytest.fixture(scope="session")
def started(rig):
    """A function that returns the same valve after its first cycle, with a fault."""
    valve = SimulatedValve(rig.simulation, 11)
    valve.advance(rig.simulation.cycle_samples)

    def start(kind="none", severity=0.0):
        copy = deepcopy(valve)
        copy.set_fault(kind, severity)
        return copy

    return start
