# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Signatures of the faults of any valve, from the motion of its own simulation.

A few cycles are simulated and their motion changed by each fault, as `derive` does it with a
plant that knows its faults. A valve without a simulation is given a made-up motion.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.derive import Effort, derive
from valve_twin.core.diagnosis.generic.faults import FIRST_SIZES, LARGEST, SET_SIZES
from valve_twin.core.diagnosis.generic.made_up import made_up
from valve_twin.core.diagnosis.generic.rig import IdealRig
from valve_twin.core.diagnosis.table import FACTORS, Signature, SignatureTable

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.valves.interface import ValveModel

_EFFORT = Effort(seeds=(900, 901), healthy=30, faulty=3)
_CHANCE_EFFORT = Effort(seeds=(900, 901), healthy=30, faulty=16)
_BY_CHANCE = ("command_loss", "sensor_freeze", "sticking")
"""Faults that come and go by chance: more cycles tell how they scatter."""

_SATURATED = 0.02
"""Share of samples by which a command is more often at its end that counts as small [1]."""


def signatures_of(model: ValveModel) -> SignatureTable | None:
    """Return how the faults of any valve change the features of a model; None = it has none.

    They are `TABLE` of the module `signatures` beside the model's own; without that they are
    derived, once a process.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    """
    followed = model.feature_set
    if not followed.names:
        return None
    shipped = _shipped(type(model).__module__)
    if shipped is not None and shipped.features == followed.names:
        return shipped
    if (model.name, followed.names) not in _derived:
        table = derive_table(model.simulation() or made_up(), followed)
        _derived[model.name, followed.names] = table
    return _derived[model.name, followed.names]


_derived: dict[tuple[str, tuple[str, ...]], SignatureTable] = {}


def _shipped(module: str) -> SignatureTable | None:
    """Return the table beside a module, None where there is none."""
    name = f"{module.rpartition('.')[0]}.signatures"
    if find_spec(name) is None:
        return None
    table: SignatureTable = import_module(name).TABLE
    return table


def derive_table(simulation: SimulationConfig, followed: FeatureSet) -> SignatureTable:
    """Return the signatures of the faults of any valve from a simulated motion.

    Parameters
    ----------
    simulation : SimulationConfig
        A valve that does not age.
    followed : FeatureSet
        Its features.
    """
    followed = replace(followed, first_sizes=FIRST_SIZES, largest=LARGEST)
    rig = IdealRig(replace(simulation, aging=(), scatter=()), followed)
    steady = tuple(n for n in FIRST_SIZES if n not in _BY_CHANCE)
    table = derive(rig, steady, effort=_EFFORT)
    scattered = derive(rig, _BY_CHANCE, small=SET_SIZES, effort=_CHANCE_EFFORT).signatures
    found = (*table.signatures, *scattered, *_saturation(followed))
    seen = {s.fault for s in found if np.any(s.change)}
    return replace(table, signatures=tuple(s for s in found if s.fault in seen))


def _saturation(followed: FeatureSet) -> tuple[Signature, ...]:
    """Return the signature of a command that is at its end more often."""
    if "saturated" not in followed.names:
        return ()
    shape = np.array([n == "saturated" for n in followed.names], dtype=np.float64)
    none = (0.0,) * len(shape)
    sizes = [_SATURATED * factor for factor in FACTORS]
    return tuple(Signature("saturation", x, tuple((x * shape).tolist()), none) for x in sizes)
