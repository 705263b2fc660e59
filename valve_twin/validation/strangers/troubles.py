# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What happens to a stranger: how it ages, and which faults it has in which cycles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.validation.strangers.kernel import Press

AGING_LAWS = ("none", "linear", "exponential", "saturating", "stepwise")

TROUBLES = {
    # medium size, part: sizes small and large are a third of it and three times it
    "leak": (6e-4, "valve"),
    "stiction": (0.03, "valve"),
    "dead_band": (0.01, "valve"),
    "coil_resistance": (0.05, "valve"),
    "preload": (0.008, "valve"),
    "aeration": (0.03, "valve"),
    "no_motion": (1.0, "valve"),
    "sensor_offset": (3e-3, "sensor"),
    "sensor_gain": (0.04, "sensor"),
    "sensor_freeze": (0.03, "sensor"),
    "sensor_noise": (4.0, "sensor"),
    "frozen": (1.0, "sensor"),
    "command_loss": (0.03, "command"),
    "command_offset": (6e-3, "command"),
    "supply_drop": (0.08, "supply"),
}
"""Medium size [unit of the fault] and the part that has it, by fault."""

ATMOSPHERE = 1.013e5
"""Pressure at which `Press.gas` is told [Pa]."""

_SIZE = {"small": 1.0 / 3.0, "medium": 1.0, "large": 3.0}
_OF_NOISE = 2e-3
"""Noise [1] from which on sizes grow with it: what no cycle can show is not medium."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """One fault: its size, and from which cycle (counted from 1) until before which it is there.

    `end` is 0 where it lasts.
    """

    name: str
    part: str
    size: str
    severity: float
    onset: int
    end: int

    def at(self, cycle: int) -> bool:
        """Whether a cycle has it."""
        return cycle >= self.onset and (not self.end or cycle < self.end)


@dataclass(frozen=True, slots=True)
class Aging:
    """How a number of the press changes: law, which, the share after `over` cycles, its bend.

    `steps` are the cycles at which a stepwise aging goes on.
    """

    law: str
    part: str
    size: float
    bend: float
    steps: tuple[int, ...]
    over: int = 60

    def share(self, cycle: float) -> float:
        """Return the relative change of the number in a cycle [1]."""
        s = max(cycle - 1.0, 0.0) / self.over
        if self.law == "linear":
            return self.size * s
        if self.law == "exponential":
            most = min(self.bend * s, 50.0)
            return self.size * float(np.expm1(most) / np.expm1(self.bend))
        if self.law == "saturating":
            return self.size * float(np.expm1(-self.bend * s) / np.expm1(-self.bend))
        if self.law == "stepwise":
            return self.size * sum(cycle >= c for c in self.steps) / len(self.steps)
        return 0.0


def steps_of(rng: np.random.Generator, cycles: int) -> tuple[int, ...]:
    """Draw the cycles of a stepwise aging."""
    return tuple(int(c) for c in np.sort(rng.integers(2, cycles, int(rng.integers(1, 5)))))


def draw_troubles(rng: np.random.Generator, cycles: int, sigma: float) -> tuple[Trouble, ...]:
    """Draw no, one or two faults that begin in any cycle.

    Parameters
    ----------
    rng : Generator
        Source of the random numbers.
    cycles : int
        Cycles of the record [1].
    sigma : float
        Noise of the recorded position [1].
    """
    count = int(rng.choice((0, 1, 2), p=(0.3, 0.55, 0.15)))
    names = rng.choice(list(TROUBLES), size=count, replace=False)
    found = []
    for name in (str(n) for n in names):
        size = str(rng.choice(list(_SIZE)))
        onset = int(rng.integers(1, cycles - 3))
        lasting = rng.random() < 0.6
        end = 0 if lasting else min(onset + int(rng.integers(3, 12)), cycles + 1)
        found.append(trouble_of(rng, name, size, sigma, onset, end))
    return tuple(found)


def trouble_of(
    rng: np.random.Generator, name: str, size: str, sigma: float, onset: int, end: int = 0
) -> Trouble:
    """Return a fault of a size, whose sign is drawn where it may have either.

    Parameters
    ----------
    rng : Generator
        Source of the random numbers.
    name, size : str
        Of `TROUBLES`, and small, medium or large.
    sigma : float
        Noise of the recorded position [1].
    onset, end : int
        Its first cycle, and the one behind its last, 0 = it lasts [1].
    """
    medium, part = TROUBLES[name]
    gross = name in GROSS
    severity = medium if gross else medium * max(1.0, sigma / _OF_NOISE) * _SIZE[size]
    severity = min(severity, _MOST.get(name, 1.0))
    if name in _TWO_SIDED and rng.random() < 0.5:
        severity = -severity
    return Trouble(name, part, "large" if gross else size, severity, onset, end)


GROSS = {"no_motion", "frozen"}
"""Faults that have no size."""

_TWO_SIDED = {"sensor_offset", "sensor_gain", "command_offset"}
_MOST = {
    "leak": 0.01,
    "stiction": 0.2,
    "dead_band": 0.1,
    "coil_resistance": 0.4,
    "preload": 0.1,
    "aeration": 0.6,
    "sensor_offset": 0.05,
    "sensor_gain": 0.3,
    "sensor_freeze": 0.4,
    "sensor_noise": 30.0,
    "command_loss": 0.3,
    "command_offset": 0.05,
    "supply_drop": 0.35,
}


def troubled(press: Press, troubles: tuple[Trouble, ...]) -> Press:
    """Return the press with those of its faults that change its own numbers."""
    p = press
    for t in troubles:
        s = t.severity
        if t.name == "leak":
            own = s * p.area_bottom * p.stroke
            p = p._replace(leak=p.leak + own / np.sqrt(p.supply * p.area_top / p.area_bottom))
        elif t.name == "stiction":
            p = p._replace(play=p.play + s)
        elif t.name == "dead_band":
            p = p._replace(offset_in=p.offset_in + s, offset_out=p.offset_out + s)
        elif t.name == "coil_resistance":
            p = p._replace(coil=p.coil * (1.0 - s))
        elif t.name == "preload":
            p = p._replace(preload=p.preload + s)
        elif t.name == "aeration":
            p = p._replace(gas=p.gas + s * p.volume * p.supply / ATMOSPHERE)
        elif t.name == "command_offset":
            p = p._replace(command_offset=s)
        elif t.name == "supply_drop":
            p = p._replace(supply=p.supply * (1.0 - s))
    return p
