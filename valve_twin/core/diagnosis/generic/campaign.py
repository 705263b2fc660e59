# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A campaign of the faults of any valve on the model's own simulation."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.campaign import CampaignConfig
from valve_twin.core.diagnosis.config import detection_of
from valve_twin.core.diagnosis.derive import Effort, derive
from valve_twin.core.diagnosis.generic.faults import SET_SIZES
from valve_twin.core.diagnosis.generic.motion import motion_of
from valve_twin.core.diagnosis.generic.reference import features_against, record_of
from valve_twin.core.diagnosis.generic.rig import ModelRig
from valve_twin.core.diagnosis.generic.signatures import SizingRig, own_table, signatures_of
from valve_twin.core.diagnosis.table import SIZES
from valve_twin.core.simulation.aging_laws import AgingRule
from valve_twin.core.simulation.block import to_frames
from valve_twin.core.simulation.config import Scatter
from valve_twin.core.types import Cycle
from valve_twin.core.valves.registry import get_model, get_simulation

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.diagnosis.generic.rig import FaultyValve
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.valves.interface import ValveModel

_SIZING = Effort(seeds=(801, 802, 803), healthy=60, faulty=8)
_AGES = 5e-4
"""Relative change of the first parameter that is followed and ages, a cycle [1]."""
_SCATTERS = 0.01
"""Relative standard deviation of that parameter from cycle to cycle [1]."""
_ALL_SCATTER = 0.003
"""The same of every parameter that is followed, where signatures are by the model [1]."""


def model_rig(name: str, simulation: SimulationConfig | None = None) -> ModelRig:
    """Return the simulated valve of a model with its defaults.

    Parameters
    ----------
    name : str
        Name of the model.
    simulation : SimulationConfig, optional
        Valve that is simulated instead, such as one whose plant is an FMU.

    Raises
    ------
    ValueError
        If it is unknown, cannot be simulated or does not have the features of any valve.
    """
    model = get_model(name)
    if not model.feature_set.of_any_valve:
        msg = f"model '{name}' has features of its own: give --config FILE"
        raise ValueError(msg)
    simulation = simulation or get_simulation(name)
    followed = _followed(model, simulation)
    scatter = [Scatter(ages, _SCATTERS) for ages in followed[:1]]
    if model.feature_set.by_model:  # what it does not know of a cycle moves all that it sees
        scatter = [Scatter(each, _ALL_SCATTER) for each in followed]
    return ModelRig(model, model.options, replace(simulation, scatter=tuple(scatter)))


def _followed(model: ValveModel, simulation: SimulationConfig) -> list[str]:
    """Return the parameters that are followed and that the plant has."""
    numbers = {name for name, _ in simulation.plant_numbers(1)}
    return [p.name for p in model.parameters if p.trend and p.name in numbers]


def own_signatures(rig: ModelRig, valve: FaultyValve) -> SignatureTable:
    """Return the signatures that a twin of a valve derives from its next cycle.

    Parameters
    ----------
    rig : ModelRig
        Valve and model.
    valve : FaultyValve
        That has a reference; it stays where it is.
    """
    model, reference = rig.model, valve.reference
    shared = signatures_of(model)
    assert shared is not None
    assert reference is not None
    if model.feature_set.by_model:
        return shared
    block, _ = deepcopy(valve).next_cycle()
    cycle = Cycle(valve.cycle, rig.simulation.period_s, to_frames(block))
    known = model.coefficients(reference.values, reference.lag, cycle.period_s, rig.options)
    shown = features_against(model, rig.options, reference, cycle)
    motion = motion_of(record_of(model, known, cycle), shown)
    return own_table(model.name, motion) if motion else shared


def campaign_of(
    rig: ModelRig, seeds: tuple[int, ...], *, advance: Callable[[], None] = lambda: None
) -> CampaignConfig:
    """Return what is simulated: small changes a healthy cycle by four standard deviations.

    Parameters
    ----------
    rig : ModelRig
        Valve and model.
    seeds : tuple of int
        One record each.
    advance : callable
        Called after each fault.
    """
    sizing = SizingRig(rig.model, rig.options, rig.simulation)
    table = derive(
        sizing,
        small=SET_SIZES,
        correlations=signatures_of(rig.model),  # as the detection counts them
        apart=detection_of(rig.feature_set).apart,
        effort=_SIZING,
        advance=advance,
    )
    severities = {}
    for name in table.faults:
        small, medium, large = [s.severity for s in table.signatures if s.fault == name][
            : len(SIZES)
        ]
        severities[name] = (small, medium, large)
    ages = _followed(rig.model, rig.simulation)[:1]
    rules = tuple(AgingRule(name, "linear", _AGES) for name in ages)
    return CampaignConfig(severities, seeds=seeds, after=7, aging=rules, sizes=SIZES[1:])
