# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Score a valve on strangers: simulated valves that are not as the options say.

Some differ in one written way, `ValveModel.strangers`; others in all known constants at once, each
drawn inside its tolerance. Right is an interval that holds the truth, or no value.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, cast

import numpy as np

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.quantity import replaced
from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.simulation.settings import configure
from valve_twin.core.types import Cycle, EstimateStatus
from valve_twin.core.valves.kit.tolerances import tolerated
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import Estimate
    from valve_twin.core.valves.interface import Options, ValveModel

SEED_BASE = 880_000
"""First seed of the scored strangers: they are never tuned on."""

DRAWN = "constants drawn inside their tolerances"

_MOST_CYCLES = 12  # an interval from the scatter between cycles needs ten before it
_HOPELESS = 2  # refused cycles from the first on after which no more is expected


@dataclass(frozen=True, slots=True)
class Score:
    """What the twin said of a stranger.

    Attributes
    ----------
    name : str
        How the valve differs.
    inside, outside, withheld : int
        Followed parameters whose interval holds the truth, does not, and without a value.
    wrong : str
        Name and error of the worst value outside, empty if none.
    """

    name: str
    inside: int
    outside: int
    withheld: int
    wrong: str


def score_strangers(
    name: str, *, drawn: int, seed_base: int = SEED_BASE, only: tuple[str, ...] = ("",)
) -> Iterator[Score]:
    """Yield the scores of a valve's strangers.

    Parameters
    ----------
    name : str
        Name of the valve's model.
    drawn : int
        How many valves have their constants drawn.
    seed_base : int
        First seed.
    only : tuple of str
        Beginnings of the names of those that are scored; each keeps its seed.

    Raises
    ------
    ValueError
        If there is no such model, or it cannot be simulated.
    """
    model, simulation = get_model(name), get_simulation(name)
    options = complete_options(model, {})
    for i, (how, changes) in enumerate(model.strangers().items()):
        if how.startswith(only):
            yield _score(model, options, configure(simulation, changes), how, seed_base + i)
    if options.tolerances is None or not DRAWN.startswith(only):
        return
    constants, plant = tolerated(options), simulation.plant
    if not constants.names:
        return
    own = [plant.constants.get(name, name) for name in constants.names]
    for seed in range(seed_base, seed_base + drawn):
        share = np.random.default_rng(seed).uniform(-1.0, 1.0, len(constants.names))
        values = {
            f"plant.{key}": cast("float", getattr(plant, key)) * (1.0 + float(off))
            for key, off in zip(own, share * constants.widths, strict=True)
        }
        yield _score(model, options, replaced(simulation, values), DRAWN, seed)


def _score(
    model: ValveModel, options: Options, stranger: SimulationConfig, name: str, seed: int
) -> Score:
    truth = model.truth(stranger, stranger.first_cycle)
    said = _last_estimate(model, options, stranger, seed)
    inside, withheld, off = 0, 0, {}
    for key, true in truth.items():
        value = next((p for p in said.parameters if p.name == key), None) if said else None
        if value is None or not isfinite(value.value) or not isfinite(value.upper_95):
            withheld += 1
        elif value.lower_95 <= true <= value.upper_95:
            inside += 1
        else:
            off[key] = 100.0 * (value.value / true - 1.0) if true else value.value
    worst = max(off, key=lambda key: abs(off[key]), default="")
    return Score(name, inside, len(off), withheld, f"{worst} {off[worst]:+.2g} %" if worst else "")


def _last_estimate(
    model: ValveModel, options: Options, stranger: SimulationConfig, seed: int
) -> Estimate | None:
    """Return the first estimate with intervals; None where every cycle is refused."""
    memory, said = Memory.empty(), None
    for i, block in enumerate(simulate_cycles(stranger, _MOST_CYCLES, seed)):
        cycle = Cycle(i + 1, stranger.period_s, to_frames(block))
        found, memory = estimate_cycle(model, options, cycle, memory)
        now = next(e for e in found if e.estimator == model.trend_estimator)
        if now.status is not EstimateStatus.REFUSED:
            said = now
            known = (p for p in now.parameters if isfinite(p.standard_error + p.upper_95))
            if any(p.trend for k in known for p in model.parameters if p.name == k.name):
                break
        elif said is None and i + 1 >= _HOPELESS:
            break
    return said
