# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What breaks in a stranger, how large, and by which names it is rightly told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from valve_twin.validation.any_strangers.kernel import CYLINDER, Valve

RIGHT = {
    "stiction": ("sticking", "lost_motion"),
    "dead_band": ("lost_motion", "sticking"),
    "delay": ("delay",),
    "slow_up": ("slow_up", "slow"),
    "slow_down": ("slow_down", "slow"),
    "end_stop_upper": ("end_stop_upper",),
    "end_stop_lower": ("end_stop_lower",),
    "noise": ("sensor_noise",),
    "repeats": ("sensor_freeze",),
    "frozen": ("sensor_freeze",),
    "command_loss": ("command_loss",),
    "oscillation": ("oscillation",),
}
"""By trouble, the faults as which it is rightly named, set before the first run: a quasi-static
valve shows stiction as lost motion."""

RIGHT_CYLINDER = {"dead_band": ("lost_motion", "sticking", "slow")}
"""Of a cylinder: a wider dead band of its valve slows every stroke."""

PER_STRANGER = 4
"""Troubles of a stranger, each in a record of its own."""

LARGE = 3.0
"""Large size over the medium one [1]."""

AFTER = 6
"""Cycles that a trouble is watched for."""

_SHARES = {"repeats": (0.1, 0.4), "command_loss": (0.3, 0.9), "frozen": (1.0, 1.0)}
"""Medium and large of those that are shares [1]."""

_NOISE = (2.5, 7.0)
"""Medium and large factor on the noise [1]."""


@dataclass(frozen=True, slots=True)
class Logger:
    """How command and position are recorded.

    Attributes
    ----------
    period_s, phase_s : float
        Sampling time and first sample [s].
    tick : int
        Steps of the integration between two commands of the controller.
    noise : float
        Standard deviation of the position [1].
    bits : int
        Of the position over 0..1, a little beyond.
    command_late_s : float
        How much later the command is recorded than sent [s].
    """

    period_s: float
    phase_s: float
    tick: int
    noise: float
    bits: int
    command_late_s: float

    @property
    def sigma(self) -> float:
        """Standard deviation of noise and rounding together [1]."""
        return float(np.hypot(self.noise, 2.0**-self.bits / np.sqrt(12.0)))


@dataclass(frozen=True, slots=True)
class Trouble:
    """One fault from a cycle (counted from 1) on: `medium` or `large`, its size in its unit."""

    name: str
    size: str
    severity: float
    onset: int
    wave_s: float = 0.0

    def right(self, kind: int) -> tuple[str, ...]:
        """Return the names by which it is rightly told of a kind of valve."""
        own = RIGHT_CYLINDER if kind == CYLINDER else {}
        return own.get(self.name, RIGHT[self.name])


def draw_troubles(
    rng: np.random.Generator, kind: int, cycles: int, logger: Logger
) -> tuple[Trouble, ...]:
    """Draw troubles that begin in any cycle, each for a record of its own.

    Parameters
    ----------
    rng : Generator
        Source of the random numbers.
    kind : int
        Of the valve.
    cycles : int
        Cycles of the record [1].
    logger : Logger
        What no recorded cycle can show is not medium: sizes grow with noise and period.
    """
    names = rng.choice(list(RIGHT), PER_STRANGER, replace=False)
    found = []
    for name in (str(n) for n in names):
        size = "large" if name == "frozen" else str(rng.choice(("medium", "large")))
        severity = medium_size(name, kind, logger)
        if name in _SHARES:
            severity = _SHARES[name][size == "large"]
        elif name == "noise":
            severity = _NOISE[size == "large"]
        elif size == "large":
            severity *= LARGE
        onset = int(rng.integers(1, cycles - AFTER + 1))
        wave_s = logger.period_s * float(rng.uniform(8.0, 30.0))
        found.append(Trouble(name, size, severity, onset, wave_s))
    return tuple(found)


def medium_size(name: str, kind: int, logger: Logger) -> float:
    """Return the medium size of a trouble [its unit].

    Parameters
    ----------
    name : str
        Which.
    kind : int
        Of the valve.
    logger : Logger
        How it is recorded.
    """
    least = 3.0 * logger.sigma
    sizes = {
        "stiction": max(0.02, least) if kind != CYLINDER else 0.04,
        "dead_band": max(0.015, least) if kind != CYLINDER else 0.03,
        "delay": max(1.5 * logger.period_s, 0.1),
        "slow_up": 0.15,
        "slow_down": 0.15,
        "end_stop_upper": max(0.02, least),
        "end_stop_lower": max(0.02, least),
        "oscillation": max(0.01, least),
    }
    return sizes.get(name, 0.0)


def troubled(valve: Valve, trouble: Trouble | None) -> Valve:
    """Return the valve with a trouble that changes its own numbers."""
    if trouble is None:
        return valve
    v, s = valve, trouble.severity
    if trouble.name == "oscillation":
        beyond = v.dead + v.breakaway if v.kind != CYLINDER else 0.0
        return v._replace(hunting=s + beyond, wave=2.0 * np.pi / trouble.wave_s)
    changed = {
        "stiction": v._replace(breakaway=v.breakaway + s, coulomb=v.coulomb + 0.5 * s),
        "dead_band": v._replace(dead=v.dead + s),
        "delay": v._replace(delay_s=v.delay_s + s),
        "slow_up": v._replace(up=v.up / (1.0 + s)),
        "slow_down": v._replace(down=v.down / (1.0 + s)),
        "end_stop_upper": v._replace(high=v.high - s),
        "end_stop_lower": v._replace(low=v.low + s),
    }
    return changed.get(trouble.name, v)
