# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Signatures of the faults of any valve, from its own motion or that of its simulation.

A few cycles are simulated and their motion changed by each fault, as `derive` does it with a
plant that knows its faults. A valve without a simulation is given a made-up motion.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.derive import Bench, Effort, V, derive
from valve_twin.core.diagnosis.features import UNFOLLOWED
from valve_twin.core.diagnosis.generic.faults import FIRST_SIZES, LARGEST, SET_SIZES
from valve_twin.core.diagnosis.generic.made_up import made_up
from valve_twin.core.diagnosis.generic.rig import IdealRig, MotionRig
from valve_twin.core.diagnosis.table import FACTORS, Signature, SignatureTable

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.diagnosis.generic.motion import Motion
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.valves.interface import ValveModel

_EFFORT = Effort(seeds=(900, 901), healthy=30, faulty=3)
_CHANCE_EFFORT = Effort(seeds=(900, 901), healthy=30, faulty=16)
LOST = "command_loss"
_OWN_EFFORT = Effort(seeds=(900, 901), healthy=20, faulty=2)
_OWN_CHANCE_EFFORT = Effort(seeds=(900, 901), healthy=20, faulty=8)
_KEPT = 128
"""Motions whose signatures a process keeps."""

_BY_CHANCE = (LOST, "sensor_freeze", "sticking")
"""Faults that come and go by chance: more cycles tell how they scatter."""

_SATURATED = 0.02
"""Share of samples by which a command is more often at its end that counts as small [1]."""


def signatures_of(model: ValveModel) -> SignatureTable | None:
    """Return how faults change the features of a model; None = it has no features.

    They are the model's own; of the faults of any valve `TABLE` of the module `signatures` beside
    it; without that they are derived, once a process.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    """
    own, followed = model.signatures(), model.feature_set
    if own is not None or not followed.of_any_valve:
        return own
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
    package = module.rpartition(".")[0]
    if not package or find_spec(f"{package}.signatures") is None:
        return None
    table: SignatureTable = import_module(f"{package}.signatures").TABLE
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
    still = replace(simulation, aging=(), scatter=())
    return _derived_on(IdealRig(still, followed), _EFFORT, _CHANCE_EFFORT)


@lru_cache(maxsize=_KEPT)
def own_table(name: str, motion: Motion) -> SignatureTable:
    """Return the signatures of the faults of any valve from the motion of a valve itself.

    Parameters
    ----------
    name : str
        Name of its model.
    motion : Motion
        What it does in a cycle.
    """
    from valve_twin.core.valves.registry import get_model  # which knows every model

    followed = get_model(name).feature_set
    followed = replace(followed, first_sizes=FIRST_SIZES, largest=LARGEST)
    rig = MotionRig(motion, motion.positions(), followed)
    return _derived_on(rig, _OWN_EFFORT, _OWN_CHANCE_EFFORT)


def _derived_on(rig: Bench[V], effort: Effort, by_chance_effort: Effort) -> SignatureTable:
    followed = rig.feature_set
    steady = tuple(n for n in FIRST_SIZES if n not in _BY_CHANCE)
    table = derive(rig, steady, effort=effort)
    by_chance = derive(rig, _BY_CHANCE, small=SET_SIZES, effort=by_chance_effort).signatures
    scattered = tuple(_alone(s, followed) if s.fault == LOST else s for s in by_chance)
    found = (*table.signatures, *scattered, *_saturation(followed))
    seen = {s.fault for s in found if np.any(s.change)}
    return replace(table, signatures=tuple(s for s in found if s.fault in seen))


def _alone(signature: Signature, followed: FeatureSet) -> Signature:
    """Return the signature of lost commands: a cycle that misses one shows nothing else."""
    shape = [float(n == UNFOLLOWED) for n in followed.names]
    change = tuple(a * b for a, b in zip(signature.change, shape, strict=True))
    scatter = tuple(a * b for a, b in zip(signature.scatter, shape, strict=True))
    return replace(signature, change=change, scatter=scatter)


def _saturation(followed: FeatureSet) -> tuple[Signature, ...]:
    """Return the signature of a command that is at its end more often."""
    if "saturated" not in followed.names:
        return ()
    shape = np.array([n == "saturated" for n in followed.names], dtype=np.float64)
    none = (0.0,) * len(shape)
    sizes = [_SATURATED * factor for factor in FACTORS]
    return tuple(Signature("saturation", x, tuple((x * shape).tolist()), none) for x in sizes)
