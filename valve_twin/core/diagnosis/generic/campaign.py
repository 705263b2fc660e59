# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A campaign of the faults of any valve on the model's own simulation."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.campaign import CampaignConfig, look_at_features
from valve_twin.core.diagnosis.config import OF_ANY_VALVE, detection_of
from valve_twin.core.diagnosis.derive import Effort, derive
from valve_twin.core.diagnosis.generic.explained import NAMED, explained
from valve_twin.core.diagnosis.generic.faults import SET_SIZES
from valve_twin.core.diagnosis.generic.motion import motion_of
from valve_twin.core.diagnosis.generic.naming import renamed
from valve_twin.core.diagnosis.generic.reference import features_of, record_against
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

    from valve_twin.core.diagnosis.campaign import Look
    from valve_twin.core.diagnosis.changes.finding import Diagnosis
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.generic.features import Record
    from valve_twin.core.diagnosis.generic.rig import FaultyValve
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.interface import ValveModel

_SIZING = Effort(seeds=(801, 802, 803), healthy=60, faulty=8)
_AGES = 5e-4
"""Relative change of the first parameter that is followed and ages, a cycle [1]."""
_SCATTERS = 0.01
"""Relative standard deviation of that parameter from cycle to cycle [1]."""
_ALL_SCATTER = 0.003
"""The same of every parameter that is followed, where signatures are by the model [1]."""


class NamingRig(ModelRig):
    """A simulated valve and its model, with what explains its cycles behind their features."""

    __slots__ = ()

    def row(self, record: Record) -> FloatArray:
        """Return the features of a cycle and what faults explain of it, (F + K,)."""
        found = explained(record)
        behind = [found.get(name, np.nan) for name in NAMED]
        return np.append(super().row(record), behind)


def look_at_motion(
    table: SignatureTable, config: DetectionConfig | None, rows: FloatArray
) -> Diagnosis:
    """Return what is found in features, named by what explains the cycles.

    Parameters
    ----------
    table : SignatureTable
        Signatures.
    config : DetectionConfig or None
        When a change is a fault; None = as for any valve.
    rows : (N, F + K) array
        As `NamingRig` gives them, of the cycles from 1 on [unit by feature].
    """
    config = config or OF_ANY_VALVE
    found = look_at_features(table, config, rows)
    features, shown = np.split(rows, [len(table.features)], axis=1)
    cycles = np.arange(1, len(rows) + 1)
    return replace(found, findings=renamed(found.findings, cycles, features, shown, table, config))


def look_of(rig: ModelRig) -> Look:
    """Return how the rows that a rig gives are looked at.

    Parameters
    ----------
    rig : ModelRig
        Valve and model.
    """
    return look_at_motion if isinstance(rig, NamingRig) else look_at_features


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
    kind: type[ModelRig] = NamingRig
    if model.feature_set.by_model:  # what it does not know of a cycle moves all that it sees
        scatter, kind = [Scatter(each, _ALL_SCATTER) for each in followed], ModelRig
    return kind(model, model.options, replace(simulation, scatter=tuple(scatter)))


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
    record = record_against(model, rig.options, reference, cycle)
    motion = motion_of(record, features_of(model, record))
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
