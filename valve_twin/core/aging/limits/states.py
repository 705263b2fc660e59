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

from valve_twin.core.aging.drift import wanted_limits
from valve_twin.core.aging.series import Part
from valve_twin.core.aging.trend import line_sums, quantile
from valve_twin.core.aging.verdict import LimitState, TrendStatus
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.config import AgingConfig, Threshold
    from valve_twin.core.aging.drift import Reference
    from valve_twin.core.aging.series import Pieces, Series
    from valve_twin.core.aging.trend import Line
    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.types import FloatArray

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
    parts: Sequence[Part],
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
    parts : sequence of Part
        The good values of each.
    lines : sequence of Line or None
        The line of each.
    config : AgingConfig
        Thresholds, hysteresis, and what is beyond doubt.
    parameter : str
        Whose limits they are.
    """
    if not np.isfinite(reference.value):
        return Held()
    begun = int(np.flatnonzero(np.r_[True, pieces.forced[1:]])[-1])
    sure = 1.0 - config.verdict_significance
    known_lines = zip(lines[begun:], parts[begun:], strict=True)
    fitted = [(line, _good(part)) for line, part in known_lines if line is not None]
    if not fitted:
        return Held()
    newest = _newest(fitted, config.min_segment)
    known = None
    doubt = quantile(1e6, sure) * reference.variance**0.5
    held: tuple[list[Threshold], list[Threshold]] = ([], [])
    for threshold in wanted_limits(config, parameter):
        way = _way(threshold, reference.value)
        if not (way and np.isfinite(way)):
            continue
        at, band = config.warning_share(threshold), _band(threshold, lines[-1], way, config)
        for enter, moved in ((at, False), (1.0, True)):
            within = enter - band
            gone = (newest - reference.value) / way
            if np.isfinite(gone).any() and not np.any(gone >= within):
                continue  # neither level is past it now
            known = known or _levels(fitted, sure, config.min_segment)
            if _latched(*known, reference.value, doubt, way, enter, within, moved):
                held[moved].append(threshold)
    return Held(tuple(held[0]), tuple(held[1]))


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


def _good(part: Part) -> Part:
    """Return the good values of a segment, other products' offsets taken out."""
    if part.offsets is None:
        return part
    x, offsets = part.x, part.offsets
    matrix = np.column_stack([np.ones(len(x)), x - x.mean(), offsets])
    y = part.y - offsets @ np.linalg.lstsq(matrix, part.y, rcond=None)[0][2:]
    return Part(x, y, None, line_sums(x, y))


def _newest(parts: Sequence[tuple[Line, Part]], least: int) -> FloatArray:
    """Return the two levels at the newest value, see `_latched`, (2,) [unit]."""
    level = mean = _NAN
    x, _, _, sums = parts[-1][1]
    if len(x) >= least:
        level = sums.mean + sums.slope * (x[-1] - sums.center)
    values = np.concatenate([part.y[-least:] for _, part in parts[-least:]])
    if len(values) >= least:
        mean = float(values[-least:].mean())
    return np.array([level, mean])


def _levels(
    parts: Sequence[tuple[Line, Part]], sure: float, least: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what was known of the level at each of the M good values of some segments.

    Returns
    -------
    sums : (M, 6) array
        Of what lies before each value and itself: places and values about the line of its segment,
        squares and products of them, values of the segments together; and its place.
    segments : (P, 5) array
        Values in it, its line's mean [unit], standard deviation of a mean value [unit], its
        quantile, and `least`.
    student : (P, S) array
        Quantiles of Student's t at `_SIZES`.
    """
    rows, tables = [], []
    for line, part in parts:
        rho = max(line.autocorrelation, 0.0)
        inflated = (1.0 + rho) / (1.0 - rho)
        table = _quantiles(np.maximum(_SIZES / inflated - 2.0, 1.0), sure)
        newest = np.interp(len(part.x), _SIZES, table)
        rows.append([len(part.x), line.mean, line.sigma * inflated**0.5, newest, least])
        tables.append(table)
    d = np.concatenate([part.x - line.center for line, part in parts])
    segments = np.array(rows, np.float64)
    sums = _sums(d, np.concatenate([part.y for _, part in parts]), segments)
    return sums, segments, np.stack(tables)


def _quantiles(freedom: FloatArray, confidence: float) -> FloatArray:
    """Return two-sided quantiles of Student's t, see `quantile`."""
    from scipy.special import stdtrit  # slow to import

    return np.asarray(stdtrit(freedom, 0.5 + 0.5 * confidence))


@njit(cache=True)
def _sums(d: FloatArray, y: FloatArray, segments: FloatArray) -> FloatArray:
    out = np.empty((len(d), 6))
    i, total = 0, 0.0
    for p in range(len(segments)):
        sd, se, sdd, sde = 0.0, 0.0, 0.0, 0.0
        for _ in range(int(segments[p, 0])):
            e = y[i] - segments[p, 1]
            sd, se = sd + d[i], se + e
            sdd, sde = sdd + d[i] * d[i], sde + d[i] * e
            total += y[i] - y[0]
            out[i, 0], out[i, 1], out[i, 2], out[i, 3] = sd, se, sdd, sde
            out[i, 4], out[i, 5] = total, d[i]
            i += 1
    return out


@njit(cache=True, error_model="numpy")
def _latched(
    sums: FloatArray,
    segments: FloatArray,
    student: FloatArray,
    reference: float,
    doubt: float,
    way: float,
    enter: float,
    within: float,
    moved: bool,
) -> bool:
    """Return whether a limit was passed by one of two levels and not left by both since.

    The levels at a value are that of the line up to there, from the `least`-th on, and the mean of
    the `least` values up to there. The scatter is that of the whole segment.

    Parameters
    ----------
    sums, segments, student : arrays
        What `_levels` returned.
    reference, doubt : float
        Level when new, and half its interval [unit].
    way : float
        From it to the threshold, with its sign [unit].
    enter, within : float
        Where on the way the limit is passed, and where the levels are back [1].
    moved : bool
        Whether the level has to be past it as it is found, and moved beyond doubt; else past it
        beyond doubt.
    """
    begun = len(sums)
    p = len(segments)
    for i in range(len(sums) - 1, -1, -1):
        if i < begun:
            p -= 1
            begun -= int(segments[p, 0])
        _, mean, scatter, newest, least = segments[p]
        n = i - begun + 1.0
        size = int(least)
        level, half = np.nan, np.nan
        if n >= least:
            sd, se, sdd, sde = sums[i, 0], sums[i, 1], sums[i, 2], sums[i, 3]
            sxx = sdd - n * (sd / n) ** 2
            far = sums[i, 5] - sd / n
            level = mean + se / n + far * (sde - n * (sd / n) * (se / n)) / sxx
            half = np.interp(n, _SIZES, student[p]) * scatter * np.sqrt(1.0 / n + far**2 / sxx)
        last = np.nan
        if i >= size:
            last = (sums[i, 4] - sums[i - size, 4]) / size
        elif i == size - 1:
            last = sums[i, 4] / size
        last += sums[0, 1] + segments[0, 1]  # the first value
        gone = (level - reference) / way, (last - reference) / way
        off = np.hypot(half, doubt), np.hypot(newest * scatter / least**0.5, doubt)
        known = np.isfinite(gone[0]) or np.isfinite(gone[1])
        if known and not (gone[0] >= within or gone[1] >= within):
            return False
        for k in range(2):
            sure = gone[k] - off[k] / abs(way)
            if (sure > 0.0 and gone[k] > enter) if moved else sure > enter:
                return True
    return False
