# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults that can be put into the simulated valve while it runs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

KINDS = ("leak", "stuck", "sensor_freeze", "lost_samples")
_LARGEST = {"leak": 1.0, "lost_samples": 1.0}


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault that is present.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    severity : float
        leak: loss of stroke [1/s]; lost_samples: probability [1]; else without meaning.
    end : int
        Index of the first sample without it, -1 = until cleared.
    """

    kind: str
    severity: float
    end: int


@dataclass(frozen=True, slots=True)
class Faults:
    """The faults present at a time, at most one of each kind."""

    present: tuple[Fault, ...] = field(default=())

    def with_fault(self, kind: str, severity: float, start: int, samples: int) -> Faults:
        """Return these faults and one more from sample `start` on, for `samples` (0 = for good).

        A fault replaces one of the same kind; kind "none" clears all.

        Raises
        ------
        ValueError
            If the kind is unknown or the severity outside its range.
        """
        if kind == "none":
            return Faults()
        if kind not in KINDS:
            message = f"fault.kind = {kind!r}: must be one of {', '.join(KINDS)} or none"
            raise ValueError(message)
        largest = _LARGEST.get(kind, math.inf)
        if not 0.0 <= severity <= largest:
            message = f"fault.severity = {severity!r} for {kind}: must be from 0 to {largest:g}"
            raise ValueError(message)
        others = tuple(f for f in self.present if f.kind != kind)
        end = start + samples if samples > 0 else -1
        return Faults((*others, Fault(kind, float(severity), end)))

    def at(self, sample: int) -> Faults:
        """Return the faults still present at a sample."""
        return Faults(tuple(f for f in self.present if f.end < 0 or f.end > sample))

    def next_change(self, sample: int) -> int:
        """Return the first sample after `sample` at which a fault ends, -1 = none does."""
        ends = [f.end for f in self.present if f.end > sample]
        return min(ends) if ends else -1

    def severity(self, kind: str) -> float:
        """Return the severity of a kind, 0 where it is absent."""
        return next((f.severity for f in self.present if f.kind == kind), 0.0)

    def has(self, kind: str) -> bool:
        """Return whether a kind is present."""
        return any(f.kind == kind for f in self.present)
