# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Draw a stranger: a press, its PLC, its logger, what it makes, how it ages and what breaks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.validation.strangers.kernel import STEP_S, Plc, Press
from valve_twin.validation.strangers.troubles import (
    AGING_LAWS,
    ATMOSPHERE,
    Aging,
    Trouble,
    draw_troubles,
    steps_of,
)

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Logger:
    """How position and commands are recorded; times in s, positions in strokes.

    `clocks_apart` is the rate of the commands' clock over that of the position, less 1; `clock`
    the rate of both over true time, less 1.
    """

    period_s: float
    phase_s: float
    clock: float
    clocks_apart: float
    filter_s: float
    delay_s: float
    command_delay_s: float
    refresh: int
    bits: int
    noise: float
    outliers: float
    drift: float

    @property
    def sigma(self) -> float:
        """Standard deviation of noise and rounding together [1]."""
        return float(np.hypot(self.noise, 2.0**-self.bits / np.sqrt(12.0)))


@dataclass(frozen=True, slots=True)
class Recipe:
    """One product: levels of the stroke [1], times of its phases [s], load [N]."""

    first: float
    second: float
    rest_s: float
    ramp_s: float
    hold_s: float
    return_s: float
    load: float

    def reference(self, tick_s: float) -> FloatArray:
        """Return the wanted position at each tick of the PLC [1]."""
        parts = [
            np.zeros(round(self.rest_s / tick_s)),
            np.full(round(0.35 * self.hold_s / tick_s), self.first),
            np.linspace(self.first, self.second, round(self.ramp_s / tick_s)),
            np.full(round(self.hold_s / tick_s), self.second),
            np.zeros(round(self.return_s / tick_s)),
        ]
        whole: FloatArray = np.concatenate(parts)
        return whole


@dataclass(frozen=True, slots=True)
class Stranger:
    """A press that the twin has never seen; `recipe_of` names the product of each cycle."""

    seed: int
    cycles: int
    press: Press
    plc: Plc
    control_noise: float
    logger: Logger
    recipes: tuple[Recipe, ...]
    recipe_of: tuple[int, ...]
    pauses: tuple[float, ...]
    supply_scatter: float
    warm_up: float
    aging: Aging
    troubles: tuple[Trouble, ...]


def draw(seed: int, cycles: tuple[int, int] = (40, 60)) -> Stranger:
    """Draw the stranger of a seed.

    Parameters
    ----------
    seed : int
        Seed of everything about it.
    cycles : (int, int)
        Fewest and most production cycles [1].

    Returns
    -------
    Stranger
        The same for the same seed.
    """
    rng = np.random.default_rng([20261122, seed])
    count = int(rng.integers(cycles[0], cycles[1] + 1))
    press = _press(rng)
    logger = _logger(rng)
    plc = _plc(rng)
    recipes, recipe_of = _recipes(rng, count)
    pauses = np.where(rng.random(count) < 0.05, rng.uniform(5.0, 40.0, count), 0.0)
    law = str(rng.choice(AGING_LAWS, p=(0.25, 0.3, 0.15, 0.15, 0.15)))
    part = str(rng.choice(("r_in", "r_out", "leak"), p=(0.6, 0.2, 0.2)))
    size = float(rng.uniform(0.04, 0.22)) * (-1.0 if part != "leak" else 6.0)
    aging = Aging(law, part, size, float(rng.uniform(1.5, 3.5)), steps_of(rng, count))
    return Stranger(
        seed,
        count,
        press,
        plc,
        float(rng.choice((0.0, 1e-4, 1e-3))),
        logger,
        recipes,
        recipe_of,
        tuple(float(s) for s in pauses),
        float(rng.choice((0.0, 0.002, 0.004))),
        float(rng.choice((0.0, 0.0, 0.02))),
        aging,
        draw_troubles(rng, count, logger.sigma),
    )


def _press(rng: np.random.Generator) -> Press:
    bottom = rng.uniform(1.2e-3, 3e-3)
    top = bottom * rng.uniform(0.94, 0.97)
    stroke, supply, density = rng.uniform(0.4, 1.0), rng.uniform(1.6e7, 3.15e7), 1000.0
    into = np.sqrt(2.0 * supply * (1.0 - top / bottom) / density)
    r_in = rng.uniform(0.22, 0.5) * bottom * stroke / into
    leak = rng.uniform(2e-4, 1.4e-3) * bottom * stroke / np.sqrt(supply * top / bottom)
    volume = rng.uniform(5e-4, 2e-3)
    coulomb = rng.uniform(0.0, 1.5e-3) * top * supply
    return Press(
        mass=rng.uniform(40.0, 150.0),
        damping=rng.uniform(800.0, 5000.0),
        area_bottom=bottom,
        area_top=top,
        stroke=stroke,
        density=density,
        supply=supply,
        bulk=rng.uniform(1.4e9, 2.2e9),
        volume=volume,
        gas=rng.uniform(0.0, 2e-3) * volume * supply / ATMOSPHERE,
        r_in=r_in,
        r_out=r_in * rng.uniform(0.7, 1.3),
        saturation_in=rng.uniform(0.0, 0.2),
        saturation_out=rng.uniform(0.05, 0.4),
        lag_in=rng.uniform(4e-3, 18e-3),
        lag_out=rng.uniform(4e-3, 18e-3),
        rate=rng.uniform(20.0, 80.0),
        offset_in=rng.uniform(0.0, 0.004),
        offset_out=rng.uniform(0.0, 0.004),
        leak=leak,
        coulomb=coulomb,
        breakaway=coulomb * rng.uniform(1.0, 2.0),
        stribeck=rng.uniform(0.01, 0.05),
        smooth=rng.uniform(4e-3, 1e-2),
        seat=rng.uniform(0.8e8, 2e8),
        seat_damping=rng.uniform(5e4, 1.5e5),
        load=0.0,
        play=rng.uniform(0.0, 0.002),
        preload=0.0,
        coil=1.0,
        command_offset=0.0,
    )


def _plc(rng: np.random.Generator) -> Plc:
    period = float(rng.choice((0.004, 0.005, 0.008, 0.01, 0.01, 0.012, 0.016)))
    off = rng.uniform(0.0015, 0.004)
    return Plc(
        ticks=round(period / STEP_S),
        gain_in=rng.uniform(4.0, 9.0),
        integral_in=rng.choice((0.0, 1.0, 2.0)),
        gain_out=rng.uniform(2.0, 4.0),
        integral_out=rng.choice((0.0, 0.5)),
        limit=rng.choice((0.7, 0.8, 0.8)),
        band_off=off,
        band_on=off + rng.uniform(0.008, 0.02),
        filter_share=rng.choice((1.0, 1.0, 0.5)),
    )


def _logger(rng: np.random.Generator) -> Logger:
    period = float(rng.choice((0.02, 0.03, 0.03, 0.04)))
    apart = float(rng.choice((-1.0, 1.0)) * rng.uniform(50e-6, 500e-6))
    return Logger(
        period_s=period,
        phase_s=float(rng.uniform(0.0, period)),
        clock=float(rng.uniform(-200e-6, 200e-6)) if rng.random() < 0.5 else 0.0,
        clocks_apart=apart if rng.random() < 0.2 else 0.0,
        filter_s=float(rng.choice((0.0, 0.005, 0.015))),
        delay_s=float(rng.uniform(0.0, 0.03)),
        command_delay_s=float(rng.uniform(0.0, 0.01)),
        refresh=int(rng.choice((1, 1, 1, 2, 4))),
        bits=int(rng.choice((6, 8, 10, 12, 12, 14, 16))),
        noise=float(10.0 ** rng.uniform(-5.0, -2.0)),
        outliers=float(rng.choice((0.0, 0.0, 1e-3, 3e-3))),
        drift=float(rng.choice((0.0, 0.0, 2e-4, 1e-3))),
    )


def _recipes(rng: np.random.Generator, cycles: int) -> tuple[tuple[Recipe, ...], tuple[int, ...]]:
    """Draw the products: one, another from some cycle on, or two in turn."""

    def one() -> Recipe:
        first = rng.uniform(0.18, 0.4)
        return Recipe(
            first,
            first + rng.uniform(0.05, 0.25),
            rng.uniform(0.8, 1.5),
            rng.uniform(1.5, 4.0),
            rng.uniform(3.0, 6.0),
            rng.uniform(1.5, 3.0),
            0.0,
        )

    plan = str(rng.choice(("one", "changed", "turns"), p=(0.6, 0.25, 0.15)))
    recipe = one()
    if plan == "one":
        return (recipe,), (0,) * cycles
    other = one()
    other = Recipe(
        recipe.first * rng.uniform(0.75, 1.25),
        recipe.second * rng.uniform(0.95, 1.25),
        other.rest_s,
        recipe.ramp_s * rng.uniform(0.7, 1.4),
        other.hold_s,
        other.return_s,
        float(rng.uniform(-400.0, 800.0)),
    )
    if plan == "turns":
        return (recipe, other), tuple(k % 2 for k in range(cycles))
    since = int(rng.integers(5, cycles - 5))
    return (recipe, other), tuple(int(k >= since) for k in range(cycles))
