# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which fault fits a change of the features, and whether the end of one fits it better."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.lines import fit_changes
from valve_twin.core.diagnosis.table import BY_NAME

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.lines import Rays
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import FloatArray

_NO_SIZE = 1e-3
"""Size, in that of a signature, below which a fault explains nothing [1]."""

_MOST = 1e6
"""A change that is larger is matched at this size: its matrices stay regular
[standard deviations]."""


@dataclass(frozen=True, slots=True)
class Match:
    """How some cycles fit: twice the log likelihood per fault, the best one's numbers.

    `ray` is the whitened signature that fits best [row of `Rays.rays`].
    """

    likelihood: dict[str, float]
    severity: float
    deviation: float
    like: float
    excess: float
    ray: int

    def is_unknown(self, config: DetectionConfig) -> bool:
        """Return whether the change is like no signature."""
        return self.like < 0.0 or (self.like < config.like and self.excess > config.excess)


def match(
    off: FloatArray, rays: Rays, table: SignatureTable, config: DetectionConfig, *, line: float
) -> Match:
    """Match what some cycles show with every signature.

    Parameters
    ----------
    off : (m, F) array
        Whitened cycles less what they are compared with [standard deviations].
    rays : Rays
        Whitened signatures.
    table : SignatureTable
        Signatures.
    config : DetectionConfig
        How far a valve may be unlike the simulated one.
    line : float
        Variance of what they are compared with [1].
    """
    scale = _MOST / max(float(np.abs(off).max()), _MOST)
    off = scale * off
    unlike = config.unlike**2 * float(np.sum(off.mean(axis=0) ** 2)) / off.shape[1]
    ranges = [table.range(k) for k in range(len(table.signatures))]
    limits = [(scale * low, scale * high) for low, high in ranges]
    fits = fit_changes(off, rays, line, limits, unlike=unlike, varies=config.varies)
    best: dict[str, float] = {}
    values = [value if size > scale * _NO_SIZE else -np.inf for value, size, _ in fits]
    for signature, value in zip(table.signatures, values, strict=True):
        best[signature.fault] = max(best.get(signature.fault, -np.inf), value)
    k = int(np.argmax(values))
    size, change = fits[k][1], off.mean(axis=0)
    like = float(rays.rays[k] @ change) ** 2 / max(float(change @ change), 1e-300)
    like = like if np.isfinite(values[k]) else -1.0
    severity = table.signatures[k].severity * size / scale
    deviation = float(np.linalg.norm(change)) / scale
    return Match(best, severity, deviation, like, fits[k][2] / off.size, k)


def fits_an_end(found: Match, ended: Match, config: DetectionConfig, *, least: float) -> bool:
    """Return whether a change is the end of a fault that comes in one direction only.

    Parameters
    ----------
    found, ended : Match
        Of the change, and of the change the other way round.
    config : DetectionConfig
        When a change is like no signature.
    least : float
        Twice the log likelihood by which the end must fit better than any fault [1].
    """
    one_sided = {n: v for n, v in ended.likelihood.items() if not BY_NAME[n].two_sided}
    if not one_sided or ended.is_unknown(config):
        return False
    best = max(ended.likelihood.values())
    return max(one_sided.values()) >= best > max(found.likelihood.values()) + least
