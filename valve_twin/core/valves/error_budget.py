# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The error budget of a valve: what each source of error does to each parameter.

The rows (a) to (k) of paper 002, Table 5, for the user's own valve, cycle, sampling time and
noise. One production cycle is simulated; each source in turn is added to it and the cycle is
estimated again, with everything else and all random numbers the same. Every number is the root
mean square over the realisations of the relative change of a parameter: for noise that holds bias
and scatter of a single cycle, for the other sources the change itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.simulation.block import to_frames
from valve_twin.core.simulation.config import StartFault
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.types import Cycle, EstimateStatus
from valve_twin.core.valves.interface import estimator_choices

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import Estimate, FloatArray, Frames
    from valve_twin.core.valves.interface import Options, ValveModel


@dataclass(frozen=True, slots=True)
class BudgetOptions:
    """Sizes of the sources that the simulation does not state, and how often noise is drawn.

    Attributes
    ----------
    offset : float
        Offset of each command and of the position, where the measurement layer has none: 1e-3 is
        the largest seen in paper 002 [1].
    command_noise : float
        Standard deviation of the noise of each command; 1e-5 is that of paper 002 [1].
    realisations : int
        Draws of every noise.
    seed : int
        Seed of all random numbers.
    """

    offset: float = 1e-3
    command_noise: float = 1e-5
    realisations: int = 8
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse sizes that are not finite and positive."""
        for name in ("offset", "command_noise"):
            value = getattr(self, name)
            if not 0.0 < value <= 0.5:
                message = f"{name} = {value!r}: must be above 0 and at most 0.5 [1]"
                raise ValueError(message)
        if self.realisations < 2:
            message = f"realisations = {self.realisations!r}: must be 2 or more"
            raise ValueError(message)


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """One source of error.

    Attributes
    ----------
    letter, text : str
        Row as in paper 002, Table 5, and what it is.
    size : float
        Offset, standard deviation of the noise, or that of the error of position [1].
    errors : tuple of float
        Relative change of each parameter, not negative [1]; NaN where the estimator refuses.
    """

    letter: str
    text: str
    size: float
    errors: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class BudgetColumn:
    """One parameter: its name, the estimator it comes from and its mean under the own noise."""

    parameter: str
    estimator: str
    value: float


@dataclass(frozen=True, slots=True)
class Budget:
    """All sources and parameters.

    Attributes
    ----------
    columns : tuple of BudgetColumn
        The parameters; empty where no estimator accepts the cycle.
    rows : tuple of BudgetRow
        The sources, in the order of the paper.
    reason : str
        Why there is no budget; else empty.
    """

    columns: tuple[BudgetColumn, ...]
    rows: tuple[BudgetRow, ...]
    reason: str = ""

    def total(self, column: int) -> float:
        """Return the sum of all rows, as in paper 002 [1]; what a row refuses counts as 0."""
        return float(np.nansum([row.errors[column] for row in self.rows]))

    def root_sum_square(self, column: int) -> float:
        """Return the root of the sum of squares: for sources that do not go together [1]."""
        return float(np.sqrt(np.nansum([row.errors[column] ** 2 for row in self.rows])))

    def largest(self, column: int) -> BudgetRow:
        """Return the row that contributes most to a parameter."""
        return max(self.rows, key=lambda row: np.nan_to_num(row.errors[column]))


@dataclass(slots=True)
class _Bench:
    """Estimates changed copies of a few cycles; `columns` once the first is estimated."""

    model: ValveModel
    options: Options
    period_s: float
    columns: tuple[BudgetColumn, ...] = field(default=())

    def estimates(self, frames: Frames) -> tuple[Estimate, ...]:
        """Estimate one cycle."""
        return self.model.estimate(Cycle(1, self.period_s, frames), self.options)

    def values(self, frames: Frames) -> FloatArray:
        """Return the value of each column; NaN where refused."""
        found = {e.estimator: e for e in self.estimates(frames)}
        return np.array([found[c.estimator].value(c.parameter) for c in self.columns])

    def relative(self, changes: list[FloatArray]) -> tuple[float, ...]:
        """Return the root mean square of changes over the value of each column."""
        size = np.sqrt(np.mean(np.square(changes), axis=0))
        return tuple((size / np.abs([c.value for c in self.columns])).tolist())


def error_budget(
    model: ValveModel,
    options: Options,
    simulation: SimulationConfig,
    budget: BudgetOptions | None = None,
    advance: Callable[[], None] = lambda: None,
) -> Budget:
    """Compute the error budget of a simulated valve.

    Parameters
    ----------
    model : ValveModel
        What is estimated.
    options : ModelOptions
        The model's options.
    simulation : SimulationConfig
        The valve, its cycle, sampling time and measurement layer; aging, scatter and faults are
        left out.
    budget : BudgetOptions, optional
        Sizes of the other sources.
    advance : callable
        Called once a row.

    Returns
    -------
    Budget
        Without columns, and with the reason, where the estimator refuses the cycle.
    """
    budget = budget or BudgetOptions()
    clean, noisy = _cycles(simulation, budget)
    bench = _Bench(model, _with_second(model, options), simulation.period_s)
    first = bench.estimates(clean[0])
    bench.columns = _columns(model, first)
    if not bench.columns:
        return Budget((), (), "; ".join(dict.fromkeys(e.reason for e in first)))
    bench.options = _with_lag(bench.options, first)
    base = [bench.values(frames) for frames in noisy]
    means = np.mean(base, axis=0).tolist()
    bench.columns = tuple(
        replace(c, value=value) for c, value in zip(bench.columns, means, strict=True)
    )
    rows = []
    for row in (
        *_offsets(bench, simulation, budget, noisy),
        *_noises(bench, simulation, budget, clean, noisy, base),
        *_approximations(bench, simulation, first, noisy, base),
    ):
        rows.append(row)
        advance()
    return Budget(bench.columns, tuple(sorted(rows, key=lambda row: row.letter)))


def row_count(model: ValveModel, simulation: SimulationConfig) -> int:
    """Return about how many rows a budget has."""
    return 2 * len(simulation.plant.inputs) + 2 + model.approximation_rows


def _cycles(
    simulation: SimulationConfig, budget: BudgetOptions
) -> tuple[list[Frames], list[Frames]]:
    """Return the same cycle without and with position noise, once a realisation."""
    layer = replace(simulation.measurement, position_offset=0.0, command_offsets=())
    plain = replace(
        simulation,
        controller="cycles",
        aging=(),
        scatter=(),
        fault=StartFault(),
        measurement=layer,
    )
    quiet = replace(plain, measurement=replace(layer, noise=0.0))
    seeds = range(budget.seed, budget.seed + budget.realisations)
    both = [
        [
            to_frames(SimulatedValve(config, seed).advance(config.cycle_samples))
            for config in (quiet, plain)
        ]
        for seed in seeds
    ]
    return [a for a, _ in both], [b for _, b in both]


def _with_second(model: ValveModel, options: Options) -> Options:
    """Return the options with the model's second estimator beside the trend's, if it has one."""
    second, known = model.budget_estimator, estimator_choices(model)
    if second not in known:
        return options
    needed = [name for name in (model.trend_estimator, second) if name in known]
    return replace(options, estimators=tuple(needed))


def _with_lag(options: Options, first: tuple[Estimate, ...]) -> Options:
    """Return the options with the lag that was found: a budget is that of one known lag."""
    return replace(options, lag=first[-1].lag) if options.lag == -1 else options


def _columns(model: ValveModel, first: tuple[Estimate, ...]) -> tuple[BudgetColumn, ...]:
    """Return what is trended, and all of the second estimator; only what the cycle shows."""
    trended = {p.name for p in model.parameters if p.trend}
    return tuple(
        BudgetColumn(p.name, e.estimator, p.value)
        for e in first
        for p in e.parameters
        if e.status is not EstimateStatus.REFUSED
        and (
            e.estimator == model.budget_estimator
            or (e.estimator == model.trend_estimator and p.name in trended)
        )
        and math.isfinite(p.value)
        and p.value != 0.0
    )


def _offsets(
    bench: _Bench, simulation: SimulationConfig, budget: BudgetOptions, noisy: list[Frames]
) -> Iterator[BudgetRow]:
    """Rows (a) to (c): half the difference between plus and minus the offset."""
    names = simulation.plant.inputs
    layer = simulation.measurement
    own = (*(layer.command_offsets or (0.0,) * len(names)), layer.position_offset)
    for k, name in enumerate((*names, "position")):
        size = abs(own[k]) or budget.offset
        letter = "c" if name == "position" else _letter("a", k)
        changes = [
            0.5
            * (
                bench.values(_shifted(frames, k, names, size))
                - bench.values(_shifted(frames, k, names, -size))
            )
            for frames in noisy
        ]
        yield BudgetRow(letter, f"offset of {name}", size, bench.relative(changes))


def _noises(
    bench: _Bench,
    simulation: SimulationConfig,
    budget: BudgetOptions,
    clean: list[Frames],
    noisy: list[Frames],
    base: list[FloatArray],
) -> Iterator[BudgetRow]:
    """Rows (d) to (f): noise of each command, and the sensor's own."""
    names = simulation.plant.inputs
    rng = np.random.default_rng([budget.seed, len(noisy)])
    for k, name in enumerate(names):
        changes = []
        for frames, known in zip(noisy, base, strict=True):
            noise = budget.command_noise * rng.standard_normal(len(frames))
            changes.append(bench.values(_shifted(frames, k, names, noise)) - known)
        letter, size = _letter("d", k), budget.command_noise
        yield BudgetRow(letter, f"noise of {name}", size, bench.relative(changes))
    changes = [known - bench.values(quiet) for quiet, known in zip(clean, base, strict=True)]
    size = simulation.measurement.noise
    yield BudgetRow("f", "noise of position", size, bench.relative(changes))


def _approximations(
    bench: _Bench,
    simulation: SimulationConfig,
    first: tuple[Estimate, ...],
    noisy: list[Frames],
    base: list[FloatArray],
) -> Iterator[BudgetRow]:
    """Rows (g) to (k), where the model knows them: their error of position is added."""
    second = bench.model.budget_estimator
    paper = next((e for e in first if e.estimator == second), first[0])
    values = {p.name: p.value for p in paper.parameters}
    delay = simulation.measurement.delay
    made = bench.model.approximations(simulation, noisy[0].inputs, values)
    for one in made:
        seen = np.concatenate([np.zeros(delay), one.error])[: len(one.error)]
        changes = [
            bench.values(replace(frames, position=frames.position + seen)) - known
            for frames, known in zip(noisy, base, strict=True)
        ]
        yield BudgetRow(one.letter, one.text, float(seen.std()), bench.relative(changes))


def _shifted(frames: Frames, k: int, names: tuple[str, ...], change: FloatArray | float) -> Frames:
    """Return frames with command k, or beyond the last the position, changed."""
    if k == len(names):
        return replace(frames, position=frames.position + change)
    inputs = frames.inputs.copy()
    inputs[:, k] += change
    return replace(frames, inputs=inputs)


def _letter(first: str, k: int) -> str:
    """Return the letter of the paper for the first two commands, the second's with a number on."""
    return chr(ord(first) + min(k, 1)) + (str(k) if k > 1 else "")
