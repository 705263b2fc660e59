# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compare a parameter across products: what another product does to its level is not aging.

Products are told apart by the duration of the program and by when it returns; a cycle of an odd
duration (a pause) by its stroke. Every product but the first has a factor of its own on the level,
found together with the trend. The values are brought to the first product; that the factors are
not known exactly stays in every fit as `Series.offsets`, one column a product.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.aging.series import Series, cut, events_at, lines_of, part_of, systematic_of
from valve_twin.core.aging.trend import MAX_FACTOR
from valve_twin.core.diagnosis.features import PERIOD, RETURNS
from valve_twin.core.diagnosis.products import products, with_returns
from valve_twin.core.estimation.data.robust import MAD_SCALE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.core.past.columns import Rows
    from valve_twin.core.types import FloatArray, IntArray, Maintenance

FEWEST = 4
"""Fewest values of a product that give it a level of its own."""

STROKE = "stroke"
"""Condition by which a cycle of odd duration is told."""

_MARGIN = 0.01  # of the stroke, about those of a product
_ROUNDS = 3
_FAR = 4.5  # robust standard deviations


def same_product(
    series: Series,
    rows: Rows,
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    *,
    parameter: str = "",
    numbers: IntArray | None = None,
    memory: Memory | None = None,
) -> tuple[Series, str]:
    """Bring the values of all products to the level of the first.

    Parameters
    ----------
    series : Series
        Values of one parameter.
    rows : Rows
        The estimates of the trend, refused ones included.
    maintenance : sequence of Maintenance
        Events that cut the series.
    config : AgingConfig
        Rules of the pieces. Nothing is done where conditions are configured, or cycles differ in
        something else than age.
    parameter : str
        Its name, by which what is wrong in all values alike is brought to that level, too.
    numbers : (M,) int64 array, optional
        The `product_numbers` of the rows.
    memory : Memory, optional
        What was found before: saves time and changes nothing.

    Returns
    -------
    Series
        As it would be with the first product, with its `offsets`; cycles of no known product are
        left out.
    str
        What was done, empty for one product.
    """
    if config.covariates or config.binned or config.label or not len(series.values):
        return series, ""
    if numbers is None:
        numbers = product_numbers(rows)
    if series.row is not None and not numbers.any():
        return series, ""
    place = series.rows_in(rows)
    number = np.where(place < 0, -1, numbers[place])
    counts = np.bincount(number + 1)
    known = np.flatnonzero(counts[1:])
    used = [int(k) for k in known if counts[k + 1] >= FEWEST]
    if (len(known) == 1 and not counts[0]) or not used:
        return series, ""
    kept = np.flatnonzero(np.isin(number, used))
    left_out = len(number) - len(kept)
    series, number = part_of(series, kept), number[kept]
    if len(used) < 2:
        return series, f"; {left_out} cycles of another product left out" if left_out else ""
    first = int(np.bincount(number[: config.reference_cycles]).argmax())
    others = [k for k in used if k != first]
    offsets = np.array([number == k for k in others], np.float64).T
    memory = memory or Memory()
    done = memory.first(series.axis, config)
    if np.any(np.count_nonzero(offsets[:done], axis=0) < FEWEST):
        done = len(offsets)
    head, columns = part_of(series, np.arange(done)), offsets[:done]
    parts = (head.axis, head.values, columns, events_at(head, maintenance))
    factors = memory.of(
        "products", parts, lambda: _factors(head, columns, maintenance, config, memory)
    )
    level = 1.0 + offsets @ (factors - 1.0)
    told = ", ".join(f"{100.0 * (f - 1.0):+.1f} %" for f in factors)
    what = f"; the level of another product taken out ({told})"
    wrong = series.systematic
    if parameter:
        wrong = systematic_of(rows, parameter, series.rows_in(rows), 1.0 / level)
    cleared = series.values / level
    return replace(series, values=cleared, offsets=offsets, systematic=wrong), what


def _shown_of(rows: Rows, shown: Rows) -> tuple[FloatArray, FloatArray]:
    """Return when each estimate's cycle returned and its period, NaN where not known [s]."""
    at = shown.at(rows.cycle, rows.end_ns)
    returns_s, period_s = (
        np.where(at < 0, np.nan, shown.usable(n)[at]) for n in (RETURNS, PERIOD)
    )
    return returns_s, period_s


def product_numbers(rows: Rows, shown: Rows | None = None) -> IntArray:
    """Return the product of every estimate, (N,), -1 = not known.

    Parameters
    ----------
    rows : Rows
        The estimates, N.
    shown : Rows, optional
        What their cycles show of faults, which tells when each returned.
    """
    if not len(rows):
        return np.zeros(0, np.int64)
    found = products(np.asarray((rows.end_ns - rows.start_ns) * 1e-9, np.float64))
    if shown is not None and len(shown):
        found = with_returns(found, *_shown_of(rows, shown))
    groups = np.flatnonzero(np.bincount(found + 1)[1:])
    if not len(groups):
        return np.zeros(len(rows), np.int64)
    if len(groups) == 1 and not np.any(found < 0):
        return found
    stroke = rows.condition(STROKE)
    ranges = {int(k): _range(stroke[found == k]) for k in groups}
    for i in np.flatnonzero(found < 0):
        fits = [k for k, (low, high) in ranges.items() if low <= stroke[i] <= high]
        if len(fits) == 1:
            found[i] = fits[0]
        elif len(groups) == 1 and not np.isfinite(stroke[i]):
            found[i] = groups[0]
    return found


def _range(stroke: FloatArray) -> tuple[float, float]:
    """Return the range of the strokes of one product, with a margin; all where unknown."""
    own = stroke[np.isfinite(stroke)]
    if not len(own):
        return -np.inf, np.inf
    low, high = np.quantile(own, (0.1, 0.9))
    margin = max(_MARGIN * abs(low), high - low)
    return float(low - margin), float(high + margin)


def _factors(
    series: Series,
    offsets: FloatArray,
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    memory: Memory,
) -> FloatArray:
    """Return the level of every product over that of the first, beside the trend, (Z,) [1]."""
    x, y = series.axis, series.values
    lines = np.column_stack([np.ones(len(x)), x - x.mean()])
    factors = _fit(lines, y, offsets)
    for _ in range(_ROUNDS):
        cleared = replace(series, values=y / (1.0 + offsets @ (factors - 1.0)))
        pieces = cut(cleared, maintenance, config, memory)
        kept = np.flatnonzero(~pieces.outlier)
        kept = kept[kept >= pieces.starts[0]]
        lines = lines_of(x, pieces)[kept]
        if np.linalg.matrix_rank(np.column_stack([lines, offsets[kept]])) < (
            lines.shape[1] + offsets.shape[1]
        ):
            break
        factors = _fit(lines, y[kept], offsets[kept])
    return factors


def _fit(lines: FloatArray, y: FloatArray, offsets: FloatArray) -> FloatArray:
    """Return the factors of the products on a trend of some lines, far values left out."""
    good = np.ones(len(y), np.bool_)
    matrix = np.column_stack([lines, offsets])
    level = np.ones(len(y))
    for _ in range(_ROUNDS):
        scale = np.maximum(np.sqrt(np.sum(matrix[good] ** 2, axis=0)), 1e-300)
        weights = np.linalg.lstsq(matrix[good] / scale, y[good], rcond=1e-9)[0] / scale
        off = np.abs(y - matrix @ weights)
        good = off <= _FAR * MAD_SCALE * np.median(off) + 1e-300
        level = lines @ weights[: lines.shape[1]]
    size = float(np.median(level))
    factors = 1.0 + weights[lines.shape[1] :] / size if size else np.ones(offsets.shape[1])
    return np.asarray(np.clip(factors, 1.0 / MAX_FACTOR, MAX_FACTOR))
