# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve whose plant drifts over many cycles, and the trend that its aging monitor publishes."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import configure, simulate_cycles, to_frames
from valve_twin.core.types import Cycle, Estimate
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from valve_twin.core.aging.verdict import Trend


CYCLES = 40


@dataclass(frozen=True, slots=True)
class Study:
    """What a campaign found of one parameter, one entry a seed; changes against new [%]."""

    parameter: str
    truth: float
    found: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @property
    def inside(self) -> int:
        """How many 95 % intervals hold the truth."""
        return int(np.count_nonzero((self.lower <= self.truth) & (self.truth <= self.upper)))

    @property
    def half_width(self) -> float:
        """Mean half width of the intervals [%]."""
        return float(0.5 * (self.upper - self.lower).mean())

    @property
    def line(self) -> str:
        """A row for the documentation."""
        return (
            f"| {self.parameter} | {self.truth:+.2f} | {self.found.mean():+.2f} "
            f"| {self.found.std(ddof=1):.2f} | {self.half_width:.2f} "
            f"| {self.inside} of {len(self.found)} |"
        )


def study(
    model_name: str,
    drifts: Mapping[str, float],
    followed: Sequence[str],
    seeds: Iterable[int],
    *,
    given: Mapping[str, object] | None = None,
    options: Mapping[str, object] | None = None,
    cycles: int = CYCLES,
) -> dict[str, Study]:
    """Let plant parameters drift linearly from the second cycle on.

    Parameters
    ----------
    model_name : str
        The valve.
    drifts : mapping
        Relative change over all cycles by parameter of the plant [%].
    followed : sequence of str
        Published parameters; of those that bear the name of a drifting one its law is the truth.
    seeds : iterable of int
        One history each.
    given : mapping, optional
        Further settings of the simulation.
    options : mapping, optional
        Options of the model.
    cycles : int
        Length of a history.
    """
    laws = {
        f"aging.{name}.{key}": value
        for name, drift in drifts.items()
        for key, value in (
            ("law", "linear"),
            ("rate", 0.01 * drift / (cycles - 1)),
            ("start_cycle", 2),
        )
    }
    simulation = configure(get_simulation(model_name), {**(given or {}), **laws})
    model = get_model(model_name)
    complete = complete_options(model, options or {})
    config = AgingConfig(parameters=tuple(followed))
    runs: list[dict[str, Trend]] = []
    for seed in seeds:
        memory, history = Memory.empty(), list[Estimate]()
        for number, block in enumerate(simulate_cycles(simulation, cycles, seed), 1):
            cycle = Cycle(number, simulation.period_s, to_frames(block))
            estimates, memory = estimate_cycle(model, complete, cycle, memory)
            history += estimates
        trends = assess(history, (), config, parameters=model.parameters).trends
        runs.append({t.parameter: t for t in trends})
    return {
        name: _summary(name, of_reference(drifts.get(name, nan), cycles), runs)
        for name in followed
    }


def of_reference(drift: float, cycles: int = CYCLES) -> float:
    """Return a linear drift over all cycles against the mean of the first ten [%]."""
    course = 1.0 + 0.01 * drift * np.arange(cycles) / (cycles - 1)
    reference = course[: AgingConfig().reference_cycles].mean()
    return float(100.0 * (course[-1] / reference - 1.0))


def _summary(name: str, truth: float, runs: list[dict[str, Trend]]) -> Study:
    found = np.array([run[name].drift_reference for run in runs])
    lower = np.array([run[name].drift_reference_lower_95 for run in runs])
    upper = np.array([run[name].drift_reference_upper_95 for run in runs])
    return Study(name, truth, found, lower, upper)
