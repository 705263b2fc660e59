# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults that can be put into the simulated valve while it runs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

COMMON_KINDS = ("leak", "stuck", "sensor_freeze", "lost_samples")
"""Kinds that every simulated valve takes."""

KINDS = (
    *COMMON_KINDS,
    "stiction",
    "preload",
    "coil_resistance",
    "dead_band",
    "sensor_offset",
    "sensor_gain",
    "command_loss",
    "supply_drop",
    "aeration",
)
"""Every kind; what a valve takes beyond `COMMON_KINDS` is named by its plant."""

PLANT_KINDS = ("stiction", "preload", "coil_resistance", "dead_band", "supply_drop", "aeration")
"""Kinds that are other numbers of the plant."""

_LOWEST = {"sensor_offset": -1.0, "sensor_gain": -0.9}
_LARGEST = {
    "leak": 1.0,
    "sensor_freeze": 1.0,
    "lost_samples": 1.0,
    "stiction": 0.5,
    "preload": 1.0,
    "coil_resistance": 10.0,
    "dead_band": 0.5,
    "sensor_offset": 1.0,
    "sensor_gain": 1.0,
    "command_loss": 1.0,
    "supply_drop": 0.95,
    "aeration": 0.9,
}


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault that is present.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    severity : float
        leak: loss of stroke [1/s]; lost_samples: probability [1]; sensor_freeze: share of
        samples at which the sensor repeats its last value, 0 = all [1]; stiction: change of
        command that a sticking pilot does not follow [1]; preload: further closing force over
        that of the supply [1]; coil_resistance: relative rise [1]; dead_band: growth at either
        command [1]; sensor_offset [1]; sensor_gain: relative change [1]; command_loss: share of
        samples whose command does not reach the valve [1]; supply_drop: relative [1]; aeration:
        share of gas in the chamber's volume under pressure [1]; stuck: without meaning.
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

        Parameters
        ----------
        kind : str
            Name of the fault; "none" clears all.
        severity : float
            Its size [unit by kind].
        start : int
            First sample.
        samples : int
            How many, 0 = for good [1].

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
        lowest = _LOWEST.get(kind, 0.0)
        if not lowest <= severity <= largest:
            message = (
                f"fault.severity = {severity!r} for {kind}: must be from {lowest:g} to {largest:g}"
            )
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

    def of(self, kinds: tuple[str, ...]) -> tuple[Fault, ...]:
        """Return the faults present whose kind is among `kinds`."""
        return tuple(f for f in self.present if f.kind in kinds)
