# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Signatures of the faults of any valve, from its own motion or that of its simulation.

A few cycles are simulated and their motion changed by each fault, as `derive` does it with a
plant that knows its faults. A valve without a simulation is given a made-up motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.derive import Bench, Effort, V, derive
from valve_twin.core.diagnosis.features import UNFOLLOWED
from valve_twin.core.diagnosis.generic.faults import FIRST_SIZES, LARGEST, SET_SIZES
from valve_twin.core.diagnosis.generic.features import ROOTS
from valve_twin.core.diagnosis.generic.made_up import made_up
from valve_twin.core.diagnosis.generic.moves import find_moves
from valve_twin.core.diagnosis.generic.rig import IdealRig, ModelRig, MotionRig
from valve_twin.core.diagnosis.table import FACTORS, Signature, SignatureTable, with_floor

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.diagnosis.generic.motion import Motion
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.interface import ValveModel

_SIZES = (*FACTORS, 30.0, 100.0, 300.0)
"""Sizes of faults over the small one: where a model errs, what is medium there is large here."""

_EFFORT = Effort(seeds=(900, 901), healthy=30, faulty=3, factors=_SIZES)
_CHANCE_EFFORT = Effort(seeds=(900, 901), healthy=30, faulty=16, factors=_SIZES)
LOST = "command_loss"
_OWN_EFFORT = Effort(seeds=(900, 901), healthy=20, faulty=2, factors=_SIZES)
_OWN_CHANCE_EFFORT = Effort(seeds=(900, 901), healthy=20, faulty=8, factors=_SIZES)
_HEALTHY = 8
"""Cycles whose mean is the level of a feature."""

_AT_END = 0.05
"""Share of its way within which a motion is at its end, assumed [1]."""

_SAMPLED_CYCLES = 64
"""Cycles that tell how features scatter by where moves begin between two samples."""

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
        _derived[model.name, followed.names] = derive_table(model)
    return _derived[model.name, followed.names]


_derived: dict[tuple[str, tuple[str, ...]], SignatureTable] = {}


def _shipped(module: str) -> SignatureTable | None:
    """Return the table beside a module, None where there is none."""
    package = module.rpartition(".")[0]
    if not package or find_spec(f"{package}.signatures") is None:
        return None
    table: SignatureTable = import_module(f"{package}.signatures").TABLE
    return table


@dataclass(frozen=True, slots=True)
class SizingRig(ModelRig):
    """A simulated valve and its model, with where the search for the sizes of faults begins."""

    @property
    def feature_set(self) -> FeatureSet:
        """Return which features, and how they are followed."""
        return replace(self.model.feature_set, first_sizes=FIRST_SIZES, largest=LARGEST)


def derive_table(model: ValveModel) -> SignatureTable:
    """Return the signatures of the faults of any valve from a simulated motion.

    Parameters
    ----------
    model : ValveModel
        The valve's model; without a simulation the motion is made up.
    """
    still = replace(model.simulation() or made_up(), aging=(), scatter=())
    if model.feature_set.by_model:
        rig = SizingRig(model, model.options, still)
        return _derived_on(rig, _EFFORT, _CHANCE_EFFORT)
    followed = replace(model.feature_set, first_sizes=FIRST_SIZES, largest=LARGEST)
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
    table = _derived_on(rig, _OWN_EFFORT, _OWN_CHANCE_EFFORT)
    if not _is_switched(rig.positions):
        return table
    return replace(table, covariance=_resolved(rig, np.array(table.covariance)))


def _is_switched(positions: FloatArray) -> bool:
    """Return whether a motion (N,) rests at its ends alone, as that of an on/off valve.

    What switches one has a scan of its own, which is not that of the logger.
    """
    at_rest = positions[find_moves(positions)[1]] - positions.min()
    share = at_rest / np.ptp(positions)
    return bool(np.all(np.minimum(share, 1.0 - share) < _AT_END))


def _resolved(rig: MotionRig, covariance: FloatArray) -> tuple[tuple[float, ...], ...]:
    """Return a covariance (F, F) of sound cycles with what the logger does not resolve.

    A move that seems to begin a sample later changes delay, roughness and noise of moves at once.
    """
    rows = rig.sampled(_OWN_EFFORT.seeds[0], _SAMPLED_CYCLES)
    shown = np.isfinite(rows).all(axis=0)
    rows = np.where(shown, rows, 0.0)
    found = with_floor(np.cov(rows, rowvar=False), np.sqrt(np.diag(covariance)))
    return tuple(tuple(float(f"{x:.5g}") for x in row) for row in found)


def _derived_on(rig: Bench[V], effort: Effort, by_chance_effort: Effort) -> SignatureTable:
    followed = rig.feature_set
    steady = tuple(n for n in FIRST_SIZES if n not in _BY_CHANCE)
    table = derive(rig, steady, effort=effort)
    by_chance = derive(rig, _BY_CHANCE, small=SET_SIZES, effort=by_chance_effort).signatures
    scattered = tuple(_alone(s, followed) if s.fault == LOST else s for s in by_chance)
    found = (*_following(table.signatures, followed), *scattered, *_saturation(followed))
    seen = {s.fault for s in found if np.any(s.change)}
    kept = tuple(s for s in found if s.fault in seen)
    return replace(table, signatures=kept, levels=_levels(rig, effort.seeds[0]))


def _levels(rig: Bench[V], seed: int) -> tuple[tuple[str, float], ...]:
    """Return the levels of the features that are roots of sums of squares."""
    valve = rig.start(seed)
    rows = rig.run(valve, _HEALTHY)
    names = rig.feature_set.names
    shown = {n: rows[:, names.index(n)] for n in ROOTS if n in names}
    known = {n: row[np.isfinite(row)] for n, row in shown.items()}
    return tuple((n, float(f"{row.mean():.4g}")) for n, row in known.items() if len(row))


def _following(signatures: tuple[Signature, ...], followed: FeatureSet) -> tuple[Signature, ...]:
    """Return signatures without the greatest sizes at which moves end where they should not.

    Such a cycle shows nothing else, and is that of a lost command.
    """
    kept: list[Signature] = []
    unfollowed = followed.names.index(UNFOLLOWED) if UNFOLLOWED in followed.names else -1
    for s in signatures:
        own = [k for k in kept if k.fault == s.fault and k.severity * s.severity > 0.0]
        lost = len(own) >= len(FACTORS) and any(
            before and not now for before, now in zip(own[-1].change, s.change, strict=True)
        )
        missed = unfollowed >= 0 and s.change[unfollowed]
        if not lost and not (len(own) >= len(FACTORS) and missed):
            kept.append(s)
    return tuple(kept)


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
