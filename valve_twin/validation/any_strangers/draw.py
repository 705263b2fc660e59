# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Draw a stranger: a valve, what it is asked to do, how it is recorded, and what breaks when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.validation.any_strangers.kernel import CYLINDER, KINDS, STEP_S, Valve
from valve_twin.validation.any_strangers.troubles import Logger, Trouble, draw_troubles

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

CYCLES = 40
"""Production cycles of a record [1]."""

_DOMAIN = 20261123


@dataclass(frozen=True, slots=True)
class Programme:
    """What is asked for in a cycle: levels [1], ways to them and stays there [s]; how it varies.

    `varies` is the share by which levels and stays scatter from cycle to cycle; 1 = every cycle
    is drawn anew.
    """

    levels: tuple[float, ...]
    ramps_s: tuple[float, ...]
    holds_s: tuple[float, ...]
    varies: float


@dataclass(frozen=True, slots=True)
class Stranger:
    """A valve that the twin has never seen, and the faults it has in records of their own.

    `wanders` is the relative standard deviation of its speeds from cycle to cycle, `ages` their
    relative change over a record [1].
    """

    seed: int
    valve: Valve
    logger: Logger
    programme: Programme
    wanders: float
    ages: float
    troubles: tuple[Trouble, ...]

    @property
    def kind(self) -> str:
        """Name of its kind."""
        return KINDS[self.valve.kind]


def draw(seed: int) -> Stranger:
    """Draw the stranger of a seed.

    Parameters
    ----------
    seed : int
        Seed of everything about it.
    """
    rng = np.random.default_rng([_DOMAIN, seed])
    kind = seed % len(KINDS)
    lag = float(10.0 ** rng.uniform(-1.0, -0.2))
    valve = _valve(rng, kind, lag)
    slowest = max(5.0 * lag, 1.3 / min(valve.up, valve.down))
    logger = _logger(rng)
    programme = _programme(rng, slowest)
    return Stranger(
        seed,
        valve,
        logger,
        programme,
        float(rng.choice((0.0, 0.002, 0.005))),
        float(rng.choice((0.0, -0.03, 0.03))),
        draw_troubles(rng, kind, CYCLES, logger),
    )


def _valve(rng: np.random.Generator, kind: int, lag: float) -> Valve:
    coulomb = float(rng.uniform(0.0, 0.01))
    up = float(rng.uniform(0.3, 1.2)) if kind != CYLINDER else float(rng.uniform(0.15, 0.6))
    return Valve(
        kind=kind,
        lag_s=lag if kind != CYLINDER else 0.2 * lag,
        delay_s=float(rng.uniform(0.0, 0.3)),
        up=up,
        down=up * float(rng.uniform(0.6, 1.6)),
        dead=float(rng.uniform(0.001, 0.012)) if kind != CYLINDER else rng.uniform(0.01, 0.06),
        breakaway=coulomb * float(rng.uniform(1.0, 1.8)),
        coulomb=coulomb,
        gain=float(rng.uniform(4.0, 10.0)) if kind != CYLINDER else rng.uniform(3.0, 6.0),
        omega=float(rng.uniform(15.0, 40.0)),
        damping=float(rng.uniform(0.7, 1.5)),
        load=float(rng.uniform(-0.2, 0.2)),
        low=0.0,
        high=1.0,
        hunting=0.0,
        wave=0.0,
    )


def _logger(rng: np.random.Generator) -> Logger:
    period = float(rng.choice((0.05, 0.1, 0.1, 0.2)))
    return Logger(
        period,
        float(rng.uniform(0.0, period)),
        round(float(rng.choice((0.01, 0.02, 0.05))) / STEP_S),
        float(10.0 ** rng.uniform(-4.0, -2.5)),
        int(rng.choice((10, 12, 12, 14, 16))),
        float(rng.choice((0.0, 0.0, 0.04))),
    )


def _programme(rng: np.random.Generator, slowest_s: float) -> Programme:
    moves = int(rng.integers(3, 7))
    levels = [*rng.uniform(0.15, 0.9, moves - 1), 1.0]  # every cycle reaches the upper stop
    ramps = np.where(rng.random(moves + 1) < 0.3, rng.uniform(1.0, 4.0, moves + 1), 0.0)
    holds = slowest_s + rng.uniform(1.0, 6.0, moves + 1)
    return Programme(
        (*(float(x) for x in rng.permutation(levels)), 0.0),
        tuple(float(x) for x in ramps),
        tuple(float(x) for x in holds),
        float(rng.choice((0.0, 0.0, 0.05, 1.0))),
    )


def wanted(programme: Programme, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return what is asked for in one cycle.

    Parameters
    ----------
    programme : Programme
        Which.
    rng : Generator
        Of what differs from cycle to cycle.

    Returns
    -------
    (N,) array
        Wanted position at each step of the integration [1].
    (N,) array
        Number of the move that each step belongs to [1].
    """
    levels, holds = np.array(programme.levels), np.array(programme.holds_s)
    inner = (levels > 0.0) & (levels < 1.0)
    if programme.varies >= 1.0:
        levels = np.where(inner, rng.uniform(0.15, 0.9, len(levels)), levels)
        holds = holds * rng.uniform(0.8, 1.3, len(holds))
    elif programme.varies:
        change = 1.0 + programme.varies * rng.standard_normal((2, len(levels)))
        levels = np.where(inner, np.clip(levels * change[0], 0.05, 0.95), levels)
        holds = holds * np.clip(change[1], 0.8, 1.2)
    parts, moves, at = [np.zeros(round(2.0 / STEP_S))], [0], 0.0
    for level, ramp_s, hold_s in zip(levels, programme.ramps_s, holds, strict=True):
        way = np.linspace(at, level, round(ramp_s / STEP_S), endpoint=False)
        parts.append(np.concatenate((way, np.full(round(hold_s / STEP_S), level))))
        moves.append(moves[-1] + 1)
        at = float(level)
    number = np.repeat(np.array(moves, dtype=np.float64), [len(p) for p in parts])
    return np.concatenate(parts), number
