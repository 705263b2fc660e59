# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compare like with like: take what the operating conditions do out of a parameter.

A gain that falls because the valve works against more load is not aging. The effect of a condition
is fitted together with the straight pieces of the trend, so that neither takes what belongs to the
other; where a condition moves with time the two cannot be separated, and nothing is taken out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.config import AgingConfig, parse_bin
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.aging.series import Series, cut, events_at, lines_of, part_of
from valve_twin.core.estimation.data.one_thread import dot
from valve_twin.core.estimation.data.robust import robust_sigma

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.past.columns import Rows
    from valve_twin.core.types import FloatArray, Maintenance

MIN_VALUES = 20
"""Fewest values from which an effect is found, assumed."""

MIN_IN_BIN = 5
"""Fewest values that give a bin a level of its own, assumed."""

SIGNIFICANCE = 0.01
"""Error probability of an effect that is taken out, assumed."""

OWN_SHARE = 0.1
"""Least share of a condition's variance that the pieces of the trend do not follow, assumed."""

_ROUNDS = 3
_FAR = 4.0  # robust standard deviations beyond which a value does not count


@dataclass(frozen=True, slots=True)
class Effect:
    """What one condition does to one parameter.

    Attributes
    ----------
    name : str
        The condition.
    applied : bool
        Whether it was taken out.
    slope, standard_error : float
        Change of the parameter a unit of the condition [unit / unit of the condition]; NaN where
        it was binned or is unknown.
    p_value : float
        Probability of so large an effect by chance [1]; NaN where it is unknown.
    span : float
        Difference that the condition makes over its range [unit].
    reason : str
        The finding in one line.
    """

    name: str
    applied: bool
    slope: float
    standard_error: float
    p_value: float
    span: float
    reason: str


@dataclass(frozen=True, slots=True)
class _Condition:
    """One condition of N values as K columns that are zero at the reference."""

    name: str
    columns: FloatArray
    binned: bool


def without_conditions(
    series: Series,
    rows: Rows,
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    memory: Memory | None = None,
) -> tuple[Series, tuple[Effect, ...]]:
    """Take the configured conditions out of a series.

    Parameters
    ----------
    series : Series
        Values of one parameter.
    rows : Rows
        Where the conditions stand: the estimates of the series, and others.
    maintenance : sequence of Maintenance
        Events that cut the series.
    config : AgingConfig
        Which conditions.
    memory : Memory, optional
        What was found before: saves time and changes nothing.

    Returns
    -------
    Series
        As it would be at the median (bins: most frequent) conditions of the reference cycles;
        cycles without a value of a condition, or in a bin of too few, are left out.
    tuple of Effect
        One a condition.
    """
    wanted = [(name, 0.0) for name in config.covariates]
    wanted += [parse_bin(text) for text in config.binned]
    if not wanted or not len(series.values):
        return series, ()
    chosen = series.rows_in(rows)
    known: list[tuple[str, float, FloatArray]] = []
    effects: list[Effect] = []
    for name, width in wanted:
        values = np.where(chosen < 0, np.nan, _values(rows, name)[chosen])
        if width > 0.0:
            values = _binned(values, width)
        if np.count_nonzero(np.isfinite(values)) < MIN_VALUES:
            seen = int(np.count_nonzero(np.isfinite(values)))
            effects.append(
                _unknown(name, f"{name} is known in {seen} cycles, {MIN_VALUES} needed")
            )
        else:
            known.append((name, width, values))
    complete = np.ones(len(series.values), dtype=np.bool_)
    for _, _, values in known:
        complete &= np.isfinite(values)
    series = part_of(series, np.flatnonzero(complete))
    conditions = [
        _condition(name, width, values[complete], config.reference_cycles)
        for name, width, values in known
    ]
    if not conditions:
        return series, tuple(effects)
    columns = np.column_stack([c.columns for c in conditions])
    memory = memory or Memory()
    done = memory.first(series.axis, config)
    if np.any(np.count_nonzero(columns[:done], axis=0) < MIN_IN_BIN):
        done = len(columns)
    head = part_of(series, np.arange(done))
    short = [replace(c, columns=c.columns[:done]) for c in conditions]
    parts = (head.axis, head.values, columns[:done], events_at(head, maintenance))
    weights, found = memory.of(
        "conditions", parts, lambda: _separate(head, short, maintenance, config, memory)
    )
    return replace(series, values=series.values - columns @ weights), (*effects, *found)


def describe_effects(effects: Sequence[Effect]) -> str:
    """Return what is appended to a trend's reason."""
    return "".join(f"; {e.reason}" for e in effects)


def _values(rows: Rows, name: str) -> FloatArray:
    """Return a condition of every cycle, or a parameter that its estimate publishes, (N,)."""
    condition = rows.condition(name)
    return np.where(np.isnan(condition), rows.value(name), condition)


def _condition(name: str, width: float, values: FloatArray, first: int) -> _Condition:
    if width <= 0.0:
        reference = float(np.median(values[:first]))
        return _Condition(name, (values - reference)[:, None], False)
    usual, counts = np.unique(values[:first], return_counts=True)
    others = [b for b in np.unique(values) if b != usual[np.argmax(counts)]]
    columns = np.array([values == b for b in others], np.float64).T.reshape(len(values), -1)
    return _Condition(name, columns, True)


def _binned(values: FloatArray, width: float) -> FloatArray:
    """Return the number of the bin of each of N values; NaN where a bin has too few to compare."""
    place = np.floor(values / width)
    bins, counts = np.unique(place[np.isfinite(place)], return_counts=True)
    return np.where(np.isin(place, bins[counts >= MIN_IN_BIN]), place, np.nan)


def _separate(
    series: Series,
    conditions: list[_Condition],
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    memory: Memory,
) -> tuple[FloatArray, list[Effect]]:
    """Fit pieces and conditions in turns, then judge each; return what is to be taken out."""
    columns = np.column_stack([c.columns for c in conditions])
    weights = _from_differences(series.values, columns)
    for _ in range(_ROUNDS):
        cleared = replace(series, values=series.values - columns @ weights)
        pieces = cut(cleared, maintenance, config, memory)
        kept = np.flatnonzero(~pieces.outlier)
        kept = kept[kept >= pieces.starts[0]]  # older ones are outside the window
        lines = lines_of(series.axis, pieces)
        weights = _fit(series.values[kept], columns[kept], lines[kept])
    applied, effects = np.zeros_like(weights), []
    first = 0
    for condition in conditions:
        own = slice(first, first + condition.columns.shape[1])
        first = own.stop
        others = np.delete(columns, np.arange(own.start, own.stop), axis=1)
        nuisance = np.column_stack([lines, others])[kept]
        effect = _judge(condition, series.values[kept], columns[kept, own], nuisance, weights[own])
        if effect.applied:
            applied[own] = weights[own]
        effects.append(effect)
    return applied, effects


def _from_differences(values: FloatArray, columns: FloatArray) -> FloatArray:
    """Return a first guess of the effects: differences of neighbours see no trend, few steps."""
    y, z = np.diff(values), np.diff(columns, axis=0)
    keep = np.ones(len(y), dtype=np.bool_)
    weights = np.zeros(columns.shape[1])
    for _ in range(_ROUNDS):
        weights = np.asarray(np.linalg.lstsq(z[keep], y[keep], rcond=None)[0], np.float64)
        off = np.abs(y - z @ weights)
        keep = off <= _FAR * robust_sigma(off) + 1e-300
    return weights


def _fit(values: FloatArray, columns: FloatArray, lines: FloatArray) -> FloatArray:
    matrix = np.column_stack([columns, lines])
    scale = np.maximum(np.sqrt(np.sum(matrix**2, axis=0)), 1e-300)
    solution = np.linalg.lstsq(matrix / scale, values, rcond=1e-9)[0] / scale
    return np.asarray(solution[: columns.shape[1]])


def _judge(
    condition: _Condition,
    values: FloatArray,
    columns: FloatArray,
    nuisance: FloatArray,
    weights: FloatArray,
) -> Effect:
    """Test one condition by the residuals with and without it (F test)."""
    name, count = condition.name, columns.shape[1]
    spread = columns - columns.mean(axis=0)
    total = float(np.sum(spread**2))
    if count == 0 or total <= 1e-24 * float(np.sum(columns**2)):
        what = "is all in one bin" if condition.binned else "never changes"
        return _unknown(name, f"{name} {what}")
    own = _off(columns, nuisance)
    if float(np.sum(own**2)) < OWN_SHARE * total:
        return _unknown(name, f"{name} moves with time as aging does, not taken out")
    without, within = _off(values, nuisance), _off(values, np.column_stack([nuisance, columns]))
    before, after = dot(without, without), dot(within, within)
    freedom = len(values) - nuisance.shape[1] - count
    if freedom < 2:
        return _unknown(name, f"{name}: too few values")
    from scipy.special import fdtrc  # slow to import

    variance = max(after / freedom, np.finfo(np.float64).tiny)
    p_value = float(fdtrc(count, freedom, max(before - after, 0.0) / count / variance))
    made = columns @ weights
    span = float(np.ptp(made))
    applied = p_value < SIGNIFICANCE
    slope = error = float("nan")
    if not condition.binned:
        slope, error = float(weights[0]), float(np.sqrt(variance / np.sum(own**2)))
    size = f"{slope:.3g} +- {error:.2g} a unit" if not condition.binned else f"{count + 1} bins"
    scatter = (before / max(freedom + count, 1)) ** 0.5, variance**0.5
    if applied:
        reason = (
            f"effect of {name} taken out ({size}, {span:.3g} over its range, "
            f"scatter {scatter[0]:.2g} -> {scatter[1]:.2g})"
        )
    else:
        reason = f"no effect of {name} ({size}, p = {p_value:.2g})"
    return Effect(name, applied, slope, error, p_value, span, reason)


def _off(values: FloatArray, columns: FloatArray) -> FloatArray:
    """Return what a least-squares fit by columns (N, C) leaves of (N,) or (N, K) values."""
    scale = np.maximum(np.sqrt(np.sum(columns**2, axis=0)), 1e-300)
    matrix = columns / scale
    left: FloatArray = values - matrix @ np.linalg.lstsq(matrix, values, rcond=1e-9)[0]
    return left


def _unknown(name: str, reason: str) -> Effect:
    nothing = float("nan")
    return Effect(name, False, nothing, nothing, nothing, nothing, reason)
