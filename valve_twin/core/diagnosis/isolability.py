# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which faults the features of a cycle can distinguish, from their signatures alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.table import FACTORS, whitener, with_floor

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import FloatArray

CONFUSED = 2.563
"""Distance below which two faults are confused in more than one case of ten: 2 * 1.2816 [1]."""

_MEDIUM = FACTORS.index(3.0)


@dataclass(frozen=True, slots=True)
class Isolability:
    """How far apart faults of medium size are after the cycles that name a fault.

    Attributes
    ----------
    faults : tuple of str
        Names of the K faults.
    distance : (K, K) array
        Standard deviations by which fault k (row) differs from the nearest size of fault j [1].
    classes : tuple of tuple of str
        Faults that no data of this kind distinguish stand together.
    """

    faults: tuple[str, ...]
    distance: FloatArray
    classes: tuple[tuple[str, ...], ...]

    def together(self, fault: str) -> tuple[str, ...]:
        """Return the class of a fault."""
        return next((c for c in self.classes if fault in c), (fault,))


def isolability(table: SignatureTable, config: DetectionConfig | None = None) -> Isolability:
    """Compare the signatures of all faults.

    Parameters
    ----------
    table : SignatureTable
        Signatures and scatter.
    config : DetectionConfig, optional
        How many cycles name a fault, and how many give the line they are compared with.

    Returns
    -------
    Isolability
        Two faults belong together where either, at medium size, lies nearer than `CONFUSED` to
        the other's signature: the chance to take it for that one is then above 10 %.
    """
    config = config or DetectionConfig()
    white = whitener(with_floor(np.array(table.covariance), np.array(table.floor)))
    changes = table.changes() @ white.T
    root = white[None] * table.scatters()[:, None, :]
    spread = root @ root.transpose(0, 2, 1)
    rows = {
        name: [i for i, s in enumerate(table.signatures) if s.fault == name]
        for name in table.faults
    }
    size = len(table.faults)
    distance = np.zeros((size, size))
    for a, first in enumerate(table.faults):
        medium = _medium(table, rows[first])
        for b, second in enumerate(table.faults):
            if a != b:
                distance[a, b] = min(
                    _distance(changes[i], spread[i], changes[j], spread[j], table.range(j), config)
                    for i in medium
                    for j in rows[second]
                )
    return Isolability(table.faults, distance, _classes(table.faults, distance))


def _medium(table: SignatureTable, rows: list[int]) -> list[int]:
    """Return the signatures of medium size among those of a fault, one of each sign."""
    signs = (1.0, -1.0)
    own = ([i for i in rows if table.signatures[i].severity * sign > 0.0] for sign in signs)
    return [same[_MEDIUM] for same in own if same]


def _distance(
    change: FloatArray,
    spread: FloatArray,
    other: FloatArray,
    other_spread: FloatArray,
    limits: tuple[float, float],
    config: DetectionConfig,
) -> float:
    """Return the distance of two faults, the second one of the size that is nearest [1].

    Twice the root of twice Bhattacharyya's distance, which for equal scatter is the number of
    standard deviations between the two: what scatters otherwise differs, too.
    """
    own = np.eye(len(change))
    first, second = own + spread, own + other_spread
    mean = 0.5 * (first + second)
    solved = np.linalg.solve(mean, other)
    size = float(solved @ change) / max(float(solved @ other), 1e-300)
    size = min(max(size, limits[0]), limits[1])
    left = change - size * other
    apart = _cycles_that_count(config) * float(left @ np.linalg.solve(mean, left))
    logs = [float(np.linalg.slogdet(c)[1]) for c in (mean, first, second)]
    return float(np.sqrt(apart + 4.0 * config.isolate * (logs[0] - 0.5 * (logs[1] + logs[2]))))


def _cycles_that_count(config: DetectionConfig) -> float:
    """Return how many cycles without error of the line name a fault as well as ours with it."""
    ahead = 0.5 * (config.window + config.isolate)
    line = 1.0 / config.window + 12.0 * ahead**2 / (config.window * (config.window**2 - 1.0))
    return 1.0 / (1.0 / config.isolate + line)


def _classes(faults: tuple[str, ...], distance: FloatArray) -> tuple[tuple[str, ...], ...]:
    """Return the groups that are linked by pairs too near to be distinguished."""
    near = np.minimum(distance, distance.T) < CONFUSED
    label = np.arange(len(faults))
    for _ in faults:
        for i in range(len(faults)):
            label[i] = label[near[i]].min()
    return tuple(
        tuple(f for f, k in zip(faults, label, strict=True) if k == group)
        for group in dict.fromkeys(label.tolist())
    )
