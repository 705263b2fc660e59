# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Sisters of a stranger: presses built like it, that differ as valves of one series may.

By how much they differ is assumed (`SHARES`, `_OFFSET`, `_NOISE`, `_DELAY_S`). They have its PLC,
its logger, its products and its law of aging; clocks that run apart are left out: those are found
by themselves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.validation.strangers.draw import draw
from valve_twin.validation.strangers.troubles import GROSS, TROUBLES, trouble_of

if TYPE_CHECKING:
    from valve_twin.validation.strangers.draw import Logger, Stranger
    from valve_twin.validation.strangers.kernel import Press
    from valve_twin.validation.strangers.troubles import Trouble

SHARES = {
    "r_in": 0.03,
    "r_out": 0.03,
    "saturation_in": 0.05,
    "saturation_out": 0.05,
    "lag_in": 0.05,
    "lag_out": 0.05,
    "rate": 0.05,
    "seat": 0.05,
    "supply": 0.01,
    "mass": 0.01,
    "volume": 0.01,
    "bulk": 0.02,
    "damping": 0.1,
    "stribeck": 0.1,
    "leak": 0.2,
    "coulomb": 0.2,
    "play": 0.2,
    "gas": 0.3,
}
"""Standard deviation of the logarithm by which sisters differ, assumed [1]."""

_OFFSET = 5e-4
"""Standard deviation of the offsets of the pilots, assumed [1]."""

_NOISE = 0.15
"""Standard deviation of the logarithm of the sensor's noise, assumed [1]."""

_DELAY_S = 1e-3
"""Standard deviation of the sensor's delay, assumed [s]."""

_AGED = 0.5
"""Share of the stranger's aging that a sister has, assumed [1]."""

SISTER_CYCLES = 20
"""Production cycles of a sister, of which a reference is made [1]."""

JUDGED_CYCLES = 24
"""Production cycles of the press that is held against it [1]."""

EARLY_FAULTS = 4
"""Records with a fault: one from the first cycle on, the others from one of the next seven on."""


@dataclass(frozen=True, slots=True)
class Family:
    """Sisters, a sound press like them, and the faults that it may have, each by itself."""

    seed: int
    sisters: tuple[Stranger, ...]
    own: Stranger
    troubles: tuple[Trouble, ...]


def family(seed: int, sisters: int) -> Family:
    """Draw the sisters of the stranger of a seed.

    Parameters
    ----------
    seed : int
        Seed of the stranger and of everything about its sisters.
    sisters : int
        How many there are beside the press that is judged [1].

    Returns
    -------
    Family
        The same for the same seed; a sister more changes none of the others.
    """
    base = draw(seed)
    base = replace(base, logger=replace(base.logger, clocks_apart=0.0), troubles=())
    own = _sister(base, 0, JUDGED_CYCLES)
    rng = _rng(seed, 0, 1)
    kinds = [name for name in TROUBLES if name not in GROSS]
    names = rng.choice(kinds, size=EARLY_FAULTS, replace=False)
    troubles = tuple(
        trouble_of(
            rng,
            str(name),
            str(rng.choice(("medium", "large"))),
            base.logger.sigma,
            int(rng.integers(2, 9)) if k else 1,
        )
        for k, name in enumerate(names)
    )
    others = tuple(_sister(base, k, SISTER_CYCLES) for k in range(1, sisters + 1))
    return Family(seed, others, own, troubles)


def _sister(base: Stranger, number: int, cycles: int) -> Stranger:
    """Return a sister of a stranger: the press that is judged is number 0."""
    rng = _rng(base.seed, number, 0)
    pauses = np.where(rng.random(cycles) < 0.02, rng.uniform(5.0, 40.0, cycles), 0.0)
    return replace(
        base,
        seed=1000 * base.seed + number,
        cycles=cycles,
        press=_press(base.press, rng),
        logger=_logger(base.logger, rng),
        recipe_of=tuple(base.recipe_of[k % len(base.recipe_of)] for k in range(cycles)),
        pauses=tuple(float(s) for s in pauses),
        aging=replace(base.aging, size=_AGED * base.aging.size),
    )


def _press(press: Press, rng: np.random.Generator) -> Press:
    """Return a press that differs from another."""
    grown = {name: float(np.exp(s * rng.standard_normal())) for name, s in SHARES.items()}
    changed = {name: getattr(press, name) * by for name, by in grown.items()}
    changed["breakaway"] = press.breakaway * grown["coulomb"]
    for name in ("offset_in", "offset_out"):
        changed[name] = max(getattr(press, name) + _OFFSET * float(rng.standard_normal()), 0.0)
    return press._replace(**changed)


def _logger(logger: Logger, rng: np.random.Generator) -> Logger:
    """Return a logger that differs from another."""
    return replace(
        logger,
        phase_s=float(rng.uniform(0.0, logger.period_s)),
        noise=logger.noise * float(np.exp(_NOISE * rng.standard_normal())),
        delay_s=logger.delay_s + abs(_DELAY_S * float(rng.standard_normal())),
    )


def _rng(seed: int, number: int, what: int) -> np.random.Generator:
    return np.random.default_rng([20261126, seed, number, what])
