# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where a trend stands to its warning limit and its service limit, with hysteresis.

The warning limit is passed where the level is beyond it beyond doubt (`verdict_significance`), the
service limit (threshold) where the level is beyond it and the drift is beyond doubt. Either stays
passed until the level has come back within it by `hysteresis` of the way from the reference to
the threshold (by `SCATTER` standard deviations of a single estimate where that is more), or
maintenance begins a new segment. A level is within the warning limit where it is
beyond doubt or by as much; between is doubt, and no state.

What was passed is told from the history, without any memory of what was said: by the level at
every earlier cycle since the last maintenance, that of the line through the values of its
segment up to there, and by the mean of the `min_segment` values before it, which stays what it is
when more values show other segments. So a monitor that was down says what one says that was not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from valve_twin.core.aging.drift import wanted_limits
from valve_twin.core.aging.trend import quantile
from valve_twin.core.aging.verdict import LimitState, TrendStatus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.config import AgingConfig, Threshold
    from valve_twin.core.aging.drift import Reference
    from valve_twin.core.aging.series import Pieces, Series
    from valve_twin.core.aging.trend import Line
    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.types import BoolArray, FloatArray

SCATTER = 2.0
"""Least hysteresis [standard deviations of a single estimate], assumed."""

_NAN = float("nan")
_SIZES = np.unique(np.geomspace(4.0, 1e6, 48).round())  # samples at which Student's t is taken


class Lost(NamedTuple):
    """What of the way to one threshold is lost beyond doubt.

    Attributes
    ----------
    threshold : Threshold
        The limit.
    share, most : float
        Of the way from the reference to it, and what may be lost at most [1].
    level, band : float
        Where the level stands on the way, and the hysteresis [1].
    """

    threshold: Threshold
    share: float
    most: float
    level: float
    band: float


class Held(NamedTuple):
    """What was passed since the last maintenance, and not left again since.

    Attributes
    ----------
    warning, alarm : tuple of Threshold
        Those whose warning limit was, and those whose service limit was.
    """

    warning: tuple[Threshold, ...] = ()
    alarm: tuple[Threshold, ...] = ()


def lost_shares(
    trend: Trend,
    pieces: Pieces,
    series: Series,
    lines: Sequence[Line | None],
    config: AgingConfig,
) -> list[Lost]:
    """Return for every threshold the share of the way to it that is lost beyond doubt.

    A segment that has just begun knows little: what the segments before it had lost since the last
    maintenance stays lost, as far as the present one does not contradict.

    Parameters
    ----------
    trend : Trend
        Trend with its drift.
    pieces : Pieces
        Its segments.
    series : Series
        Its values.
    lines : sequence of Line or None
        The line of each segment.
    config : AgingConfig
        Thresholds, and what is beyond doubt.
    """
    line, drift, sure = lines[-1], trend.drift_reference, 1.0 - config.verdict_significance
    limits = (trend.drift_reference_lower_95, trend.drift_reference_upper_95)
    if line is None or not np.isfinite(limits).all():
        return []
    wider = quantile(line.freedom, sure) / quantile(line.freedom, 0.95)
    changes = [tuple(0.01 * trend.reference * (drift + wider * (end - drift)) for end in limits)]
    ends = pieces.starts[1:] - 1
    for k in range(len(ends) - 1, -1, -1):
        if pieces.forced[k + 1]:
            break
        past = lines[k]
        if past is not None:
            low, high = past.mean_interval(float(series.axis[ends[k]]), sure)
            changes.append((low - trend.reference, high - trend.reference))
    shares = []
    for threshold in wanted_limits(config, trend.parameter):
        way = _way(threshold, trend.reference)
        if way and np.isfinite(way):
            least = [min(low / way, high / way) for low, high in changes]
            most = max(change / way for change in changes[0])
            lost = max(least[0], min(max(least), most))
            level, band = (
                (trend.level - trend.reference) / way,
                _band(threshold, line, way, config),
            )
            shares.append(Lost(threshold, lost, most, level, band))
    return shares


def held_limits(
    reference: Reference,
    pieces: Pieces,
    series: Series,
    lines: Sequence[Line | None],
    config: AgingConfig,
    parameter: str,
) -> Held:
    """Return which limits of a parameter were passed since the last maintenance and still count.

    Parameters
    ----------
    reference : Reference
        Level when new, with its doubt.
    pieces : Pieces
        The segments.
    series : Series
        The values.
    lines : sequence of Line or None
        The line of each segment.
    config : AgingConfig
        Thresholds, hysteresis, and what is beyond doubt.
    parameter : str
        Whose limits they are.
    """
    if not np.isfinite(reference.value):
        return Held()
    begun = int(np.flatnonzero(np.r_[True, pieces.forced[1:]])[-1])
    sure = 1.0 - config.verdict_significance
    parts = [
        _levels(series, pieces, k, line, sure, config.min_segment)
        for k, line in enumerate(lines[begun:], begun)
        if line is not None
    ]
    if not parts:
        return Held()
    level, half = (np.concatenate([part[i] for part in parts], axis=1) for i in (0, 1))
    level[1] = _running_mean(level[1], config.min_segment)
    half = np.hypot(half, quantile(1e6, sure) * reference.variance**0.5)
    warning, alarm = [], []
    for threshold in wanted_limits(config, parameter):
        way = _way(threshold, reference.value)
        if not (way and np.isfinite(way)):
            continue
        gone, doubt = (level - reference.value) / way, half / abs(way)
        at, moved = config.warning_share(threshold), gone - doubt > 0.0
        band = _band(threshold, lines[-1], way, config)
        if _latched(gone - doubt > at, gone, at - band):
            warning.append(threshold)
        if _latched(moved & (gone > 1.0), gone, 1.0 - band):
            alarm.append(threshold)
    return Held(tuple(warning), tuple(alarm))


def with_warnings(held: Held, lost: Sequence[Lost], config: AgingConfig) -> Held:
    """Return what counts as passed, with the warning limits that are passed now.

    Parameters
    ----------
    held : Held
        What was passed since the last maintenance.
    lost : sequence of Lost
        What of the way to the thresholds is lost beyond doubt; empty = not known.
    config : AgingConfig
        Where the warning limits lie.
    """
    now = [x.threshold for x in lost if x.share > config.warning_share(x.threshold)]
    return held._replace(warning=(*held.warning, *(t for t in now if t not in held.warning)))


def limit_state(trend: Trend, lost: Sequence[Lost], held: Held, config: AgingConfig) -> LimitState:
    """Return where a trend stands to its two limits: the one decision that every face rests on.

    Parameters
    ----------
    trend : Trend
        With its status: beyond the threshold where it is, or was and has not come back.
    lost : sequence of Lost
        What of the way to its thresholds is lost beyond doubt; empty = not known.
    held : Held
        What counts as passed, the present included.
    config : AgingConfig
        Where the warning limits lie.
    """
    if trend.status is TrendStatus.NOT_ENOUGH_DATA or not np.isfinite(trend.threshold):
        return LimitState.NONE
    sure = bool(held.warning) or not lost or max(x.share for x in lost) > 0.0
    if trend.status is TrendStatus.BEYOND_THRESHOLD:
        return LimitState.ALARM if sure or held.alarm else LimitState.NONE
    if held.warning:
        return LimitState.WARNING
    places = [(x, config.warning_share(x.threshold)) for x in lost]
    within = all(x.most < at or x.level < at - x.band for x, at in places)
    return LimitState.WITHIN if within else LimitState.NONE


def _way(threshold: Threshold, reference: float) -> float:
    """Return the way from the reference to a threshold, with its sign [unit]."""
    relative = 0.01 * threshold.value * reference
    return relative if threshold.relative else threshold.value - reference


def _band(threshold: Threshold, line: Line | None, way: float, config: AgingConfig) -> float:
    """Return the hysteresis, of half the way to the warning limit at most [1]."""
    scatter = SCATTER * line.sigma / abs(way) if line is not None else 0.0
    return min(max(config.hysteresis, scatter), 0.5 * config.warning_share(threshold))


def _latched(entered: BoolArray, gone: FloatArray, within: float) -> bool:
    """Return whether a limit was passed by one of both levels and not left by both since.

    Parameters
    ----------
    entered : (2, M) bool array
        Whether it was passed.
    gone : (2, M) array
        Where the levels stood on the way, NaN = not known [1].
    within : float
        Where they are back [1].
    """
    where = np.flatnonzero(entered.any(axis=0))
    if not len(where):
        return False
    since = gone[:, where[-1] :]
    left = ~(since >= within).any(axis=0) & np.isfinite(since).any(axis=0)
    return not left.any()


def _running_mean(values: FloatArray, size: int) -> FloatArray:
    """Return the mean of so many values up to each one, NaN where they are fewer."""
    if len(values) < size:
        return np.full(len(values), _NAN)
    total = np.cumsum(np.r_[0.0, values - values[0]])
    mean = values[0] + (total[size:] - total[:-size]) / size
    return np.concatenate([np.full(size - 1, _NAN), mean])


def _levels(
    series: Series, pieces: Pieces, k: int, line: Line, sure: float, least: int
) -> tuple[FloatArray, FloatArray]:
    """Return what was known of the level of a segment at each of its M good values.

    Returns
    -------
    levels : (2, M) array
        That of the line up to there, NaN before the `least`-th value, and the value [unit].
    half : (2, M) array
        Half the interval of the line, and of the mean of `least` values [unit]. The scatter is
        that of the whole segment.
    """
    last = pieces.starts[k + 1] if k + 1 < len(pieces.starts) else len(series.values)
    kept = np.arange(pieces.starts[k], last)
    kept = kept[~pieces.outlier[kept]]
    x, y, offsets = series.axis[kept], series.values[kept], series.offsets_at(kept)
    if offsets is not None:
        matrix = np.column_stack([np.ones(len(x)), x - x.mean(), offsets])
        y = y - offsets @ np.linalg.lstsq(matrix, y, rcond=None)[0][2:]
    n = np.arange(1.0, len(x) + 1.0)
    found, variance = _running_lines(x - line.center, y - line.mean)
    level = np.where(n >= least, line.mean + found, _NAN)
    rho = max(line.autocorrelation, 0.0)
    inflated = (1.0 + rho) / (1.0 - rho)
    student = [quantile(max(size / inflated - 2.0, 1.0), sure) for size in _SIZES]
    t = np.interp(n, _SIZES, student)
    half = line.sigma * inflated**0.5
    mean = np.full(len(n), t[-1] * half / least**0.5)
    return np.stack([level, y]), np.stack([t * half * np.sqrt(variance), mean])


@njit(cache=True, error_model="numpy")
def _running_lines(d: FloatArray, e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where the line through the values up to each one stands, and its variance.

    Both (N,), the variance in those of one value; NaN or infinite where there is no line yet.
    """
    level, variance = np.empty(len(d)), np.empty(len(d))
    sd, se, sdd, sde = 0.0, 0.0, 0.0, 0.0
    for i in range(len(d)):
        n = i + 1.0
        sd, se = sd + d[i], se + e[i]
        sdd, sde = sdd + d[i] * d[i], sde + d[i] * e[i]
        sxx = sdd - n * (sd / n) ** 2
        far = d[i] - sd / n
        level[i] = se / n + far * (sde - n * (sd / n) * (se / n)) / sxx
        variance[i] = 1.0 / n + far**2 / sxx
    return level, variance
