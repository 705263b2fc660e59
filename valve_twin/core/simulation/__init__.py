# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated valve: a plant with production cycles, aging, faults and a measurement layer."""

from valve_twin.core.simulation.aging_laws import AgingRule as AgingRule
from valve_twin.core.simulation.block import SimulationBlock as SimulationBlock
from valve_twin.core.simulation.block import to_frames as to_frames
from valve_twin.core.simulation.config import Scatter as Scatter
from valve_twin.core.simulation.config import SimulationConfig as SimulationConfig
from valve_twin.core.simulation.config import StartFault as StartFault
from valve_twin.core.simulation.measurement import MeasurementConfig as MeasurementConfig
from valve_twin.core.simulation.plant import Drive as Drive
from valve_twin.core.simulation.plant import Plant as Plant
from valve_twin.core.simulation.plant import Response as Response
from valve_twin.core.simulation.program import CycleProgram as CycleProgram
from valve_twin.core.simulation.settings import configure as configure
from valve_twin.core.simulation.valve import SimulatedValve as SimulatedValve
from valve_twin.core.simulation.valve import simulate_cycles as simulate_cycles

__all__ = [
    "AgingRule",
    "CycleProgram",
    "Drive",
    "MeasurementConfig",
    "Plant",
    "Response",
    "Scatter",
    "SimulatedValve",
    "SimulationBlock",
    "SimulationConfig",
    "StartFault",
    "configure",
    "simulate_cycles",
    "to_frames",
]
