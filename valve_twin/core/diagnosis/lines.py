# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the features of a cycle are compared with: the valve's own line and its own scatter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import NOISE, UNFOLLOWED
from valve_twin.core.diagnosis.table import SignatureTable, held_correlations, whitener, with_floor
from valve_twin.core.estimation.data.one_thread import rows_times
from valve_twin.core.estimation.data.robust import MAD_SCALE, robust_sigma

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.types import BoolArray, FloatArray

_CHANCE = 1e-8
"""Chance at which the quantiles of few and of enough cycles are compared [1]."""

_TAIL, _TAIL_DEVIATIONS = 0.9, 1.645
"""A valve whose tenth cycle is an outlier scatters so: share [1], its normal deviations [1]."""

_ROUNDING = 1e-6
_NEVER_JUDGED = 1e3
"""Deviation of a feature that never changed, so that its scatter is not known [1]."""

_CARRIED = 0.5
"""Share of a signature that the features which cycles show must carry, for its steps to count:
what is left of it else is the scatter of the others [1]."""

_RISE = 0.4
"""Least rise of the logarithm of the noise at rest that is a noisier sensor [1]."""

_LEAST_NOISE = 5
"""Fewest cycles whose noise at rest says what is usual."""

_LEAST_UNFOLLOWED = 5
"""Cycles in a row without a followed command that are no chance."""

REACH = 5
"""Cycles before a cycle whose median it is compared with."""

_MOST = 1e100
"""Beyond it no feature counts as more: squares stay numbers [unit of the feature]."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Whitened signatures: `white` (F, F), `changes` and unit `rays` (S, F).

    A further ray is that of a noisier sensor, which no signature stands for.
    `scatters` (S, F) are the deviations by which faults add to the scatter of a cycle, not
    whitened.
    """

    white: FloatArray
    changes: FloatArray
    rays: FloatArray
    scatters: FloatArray

    def spread(self) -> FloatArray:
        """Return the whitened covariances of these scatters, (S, F, F)."""
        root = self.white * self.scatters[:, None, :]
        return root @ root.transpose(0, 2, 1)

    def whitened(self, rows: FloatArray) -> FloatArray:
        """Return (N, F) features in standard deviations."""
        return rows_times(rows, self.white.T)

    def along(self, rows: FloatArray) -> FloatArray:
        """Return how far (N, F) whitened features lie along each of the rays, (N, S)."""
        return rows_times(rows, self.rays.T)


def filled(vectors: FloatArray, least: int) -> FloatArray:
    """Return the features with the last known value where there is none.

    Before the first one stands that one; a feature that is never there is 0, none is beyond 1e100.
    """
    known = np.isfinite(vectors)
    given = np.count_nonzero(known[:least], axis=0) >= least // 2
    first = vectors[np.argmax(known, axis=0), np.arange(vectors.shape[1])]
    return filled_on(first, vectors, given)


def filled_on(last: FloatArray, vectors: FloatArray, given: BoolArray) -> FloatArray:
    """Return features with the last known value where there is none.

    Parameters
    ----------
    last : (F,) array
        Features of the cycle before, all known [unit by feature].
    vectors : (N, F) array
        Features as they are followed [unit by feature]; NaN where a cycle does not show one.
    given : (F,) bool array
        Which are ever there; others are 0.
    """
    filled = np.where(given, vectors, 0.0)
    for j in np.flatnonzero(~np.isfinite(filled).all(axis=0)):
        known = np.isfinite(filled[:, j])
        index = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
        filled[:, j] = np.where(index < 0, last[j], filled[index, j])
    return np.clip(filled, -_MOST, _MOST)


def whitened_rays(
    y: FloatArray,
    known: FloatArray,
    table: SignatureTable,
    config: DetectionConfig,
    *,
    level: FloatArray | None = None,
) -> Rays:
    """Whiten the signatures by the scatter of the first cycles about their line.

    Standard deviations are the valve's own; correlations are mixed with those of the table.

    Parameters
    ----------
    y : (N, F) array
        Features of the first cycles [unit by feature].
    known : (N, F) array
        Not 0 where a cycle shows the feature [1].
    table : SignatureTable
        Signatures and their correlations.
    config : DetectionConfig
        When to speak.
    level : (F,) array, optional
        What was subtracted from y [unit by feature].
    """
    n = len(y)
    t = np.arange(n) - 0.5 * (n - 1)
    off = y - y.mean(axis=0) - np.outer(t, t @ y / (t @ t))
    wider = _doubt(n - 2, config.learn - 2)
    changes, scatters = table.changes(), table.scatters()
    if level is not None:
        changes, scatters = table.on_levels(level)
    constant = np.ptp(y, axis=0) == 0.0
    shapes = (changes, scatters)
    return _rays(off, n - 2, known, constant, table, config, wider=wider, shapes=shapes)


def rays_of_steps(
    parts: Sequence[FloatArray], table: SignatureTable, config: DetectionConfig
) -> Rays:
    """Whiten the signatures by the steps from each cycle to the next, which no level is part of.

    Parameters
    ----------
    parts : sequence of (N, F) arrays
        Features of the cycles of each product as they are followed [unit by feature]; NaN where
        a cycle does not show one.
    table : SignatureTable
        Signatures and their correlations.
    config : DetectionConfig
        When to speak.
    """
    whole = [filled(part, config.least) for part in parts]
    steps = np.concatenate([np.diff(y, axis=0) for y in whole]) / np.sqrt(2.0)
    known = np.isfinite(np.concatenate(parts))
    constant = (steps == 0.0).all(axis=0)
    shapes = (table.changes(), table.scatters())
    found = _rays(steps, len(steps), known, constant, table, config, wider=1.0, shapes=shapes)
    each = table.changes() / np.maximum(table.least(), _ROUNDING)
    shown = np.linalg.norm(each[:, known.any(axis=0)], axis=1)
    lost = np.flatnonzero(shown < _CARRIED * np.linalg.norm(each, axis=1))
    rays, changes = found.rays.copy(), found.changes.copy()
    rays[lost], changes[lost] = 0.0, 0.0
    return replace(found, rays=rays, changes=changes)


def _rays(
    off: FloatArray,
    freedom: int,
    known: FloatArray | BoolArray,
    constant: BoolArray,
    table: SignatureTable,
    config: DetectionConfig,
    *,
    wider: float,
    shapes: tuple[FloatArray, FloatArray],
) -> Rays:
    """Whiten the signatures by what (N, F) cycles are off by, `wider` for their few number.

    `shapes` are their changes and scatters (S, F).
    """
    size = np.sort(np.abs(off), axis=0)
    spread = np.maximum(
        MAD_SCALE * _of_rising(size, 0.5), _of_rising(size, _TAIL) / _TAIL_DEVIATIONS
    )
    off = np.where(spread > 0.0, np.clip(off, -4.0 * spread, 4.0 * spread), off)
    floor = np.array(table.floor)
    constant = constant & (floor < _ROUNDING)
    floor = np.where(constant, _NEVER_JUDGED, floor)
    own = with_floor(off.T @ off / freedom, np.maximum(floor, table.least(config.quiet)))
    scale = config.margin * wider * np.sqrt(np.diag(own))
    prior = with_floor(np.array(table.covariance), floor)
    deviation = np.sqrt(np.diag(prior))
    held = held_correlations(deviation, np.sqrt(np.diag(own)), config.apart)
    mixed = config.trust * held * prior / np.outer(deviation, deviation)
    deviation = np.sqrt(np.diag(own))
    mixed += freedom * own / np.outer(deviation, deviation)
    correlation = mixed / (config.trust + freedom)
    white = whitener(correlation * np.outer(scale, scale))
    absent = np.count_nonzero(known[: config.least], axis=0) < config.least // 2
    absent |= constant
    changes = np.where(absent, 0.0, shapes[0]) @ white.T
    length = np.maximum(np.linalg.norm(changes, axis=1), 1e-12)
    rays = changes / length[:, None]
    if NOISE in table.features and not absent[table.features.index(NOISE)]:
        louder = white[:, table.features.index(NOISE)]
        rays = np.vstack((rays, louder / np.linalg.norm(louder)))
    return Rays(white, changes, rays, np.where(absent, 0.0, shapes[1]))


def _of_rising(rows: FloatArray, share: float) -> FloatArray:
    """Return the quantile of (N, F) rows that rise by column, twenty times as fast as numpy's."""
    place = share * (len(rows) - 1)
    first = int(place)
    step = rows[min(first + 1, len(rows) - 1)] - rows[first]
    return np.asarray(rows[first] + (place - first) * step)


def fit_changes(
    off: FloatArray,
    rays: Rays,
    line: float,
    limits: Sequence[tuple[float, float]],
    *,
    unlike: float,
    varies: float = 0.0,
) -> list[tuple[float, float, float]]:
    """Fit each signature to what some cycles show.

    Each cycle scatters by 1, by the line's error and by what the fault adds. What is unlike the
    signature in all cycles alike, since the valve is not the simulated one, is one more error of
    their mean.

    Parameters
    ----------
    off : (m, F) array
        Whitened cycles less the line before them [standard deviations].
    rays : Rays
        Whitened signatures.
    line : float
        Variance of the line [1].
    limits : sequence of (float, float)
        Least and greatest size of each [size of the signature].
    unlike : float
        Variance of each feature's mean by which the valve is unlike the simulated one [1].
    varies : float
        Share of the change by which the fault shows more or less from cycle to cycle [1].

    Returns
    -------
    list of (float, float, float)
        Of each: twice the log likelihood, the size [size of the signature], and chi-square
        without what is unlike.
    """
    number = len(limits)
    changes, count, mean = rays.changes[:number], len(off), off.mean(axis=0)
    one = np.eye(changes.shape[1])
    covariance = (1.0 + line) * one + rays.spread()[:number]
    own = covariance / count + unlike * one  # of the mean
    solved = np.linalg.solve(own, changes[:, :, None])[:, :, 0]
    sizes = [
        min(max(float(s @ mean) / max(float(s @ c), 1e-300), low), high)
        for s, c, (low, high) in zip(solved, changes, limits, strict=True)
    ]
    size = np.array(sizes)
    left, about = mean - size[:, None] * changes, off - mean
    scatter = ((varies * size) ** 2)[:, None, None]  # the mean has its size
    each = covariance + changes[:, :, None] * changes[:, None, :] * scatter
    within = [float(np.sum(about * x.T)) for x in np.linalg.solve(each, about.T[None])]
    plain, wider = (np.linalg.solve(c, left[:, :, None])[:, :, 0] for c in (covariance, own))
    logs = [np.linalg.slogdet(c)[1].tolist() for c in (own, each)]
    return [
        (
            -w - float(r @ with_own) - log_own - (count - 1) * log_each,
            s,
            w + count * float(r @ alone),
        )
        for w, r, with_own, log_own, log_each, s, alone in zip(
            within, left, wider, *logs, sizes, plain, strict=True
        )
    ]


def _doubt(freedom: int, settled: int) -> float:
    """Return by how much wider than from `settled` cycles a deviation from few ones must count.

    Student's t at the chance of an alarm.
    """
    from scipy.special import stdtrit  # slow to import

    return float(stdtrit(freedom, 1.0 - _CHANCE) / stdtrit(settled, 1.0 - _CHANCE))


def without_outliers(w: FloatArray, config: DetectionConfig) -> FloatArray:
    """Return the rows with single outliers replaced by the median of the five before.

    A row is an outlier where the next one is back; so a row is never judged by more than the next.
    """
    base = np.array(w)
    if len(w) < REACH + 2:
        return base
    middle = _middle_of_five([w[k : len(w) - REACH - 1 + k] for k in range(REACH)])
    off = np.linalg.norm(w[REACH:-1] - middle, axis=1)
    back = np.linalg.norm(w[REACH + 1 :] - middle, axis=1)
    outlier = (off > config.outlier) & (back < config.outlier)
    base[REACH:-1][outlier] = middle[outlier]
    return base


def _middle_of_five(rows: Sequence[FloatArray]) -> FloatArray:
    """Return the median of five arrays by element, ten times as fast as one of short columns."""
    a, b, c, d, e = rows
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    middle = np.minimum(np.maximum(e, np.minimum(low, high)), np.maximum(low, high))
    return np.asarray(middle, dtype=np.float64)


def more_repeats(vectors: FloatArray, onset: int, table: SignatureTable) -> FloatArray:
    """Return by row the share of samples that repeat though they did not before the onset [1].

    Parameters
    ----------
    vectors : (N, F) array
        Features as they are followed [unit by feature].
    onset : int
        First row that has the change.
    table : SignatureTable
        Names of the features.
    """
    if "repeats" not in table.features:
        return np.zeros(len(vectors))
    repeats = np.nan_to_num(vectors[:, table.features.index("repeats")])
    usual = float(np.median(repeats[:onset]))
    return np.asarray((repeats - usual) / max(1.0 - usual, 1e-9), dtype=np.float64)


def follows_nothing(after: FloatArray, table: SignatureTable) -> bool:
    """Return whether no command was followed in any of the newest cycles.

    Parameters
    ----------
    after : (M, F) array
        Features as they are followed since the change [unit by feature].
    table : SignatureTable
        Names of the features.
    """
    if UNFOLLOWED not in table.features or len(after) < _LEAST_UNFOLLOWED:
        return False
    return bool((after[-_LEAST_UNFOLLOWED:, table.features.index(UNFOLLOWED)] == 1.0).all())


def more_noise(before: FloatArray, after: FloatArray, table: SignatureTable) -> float:
    """Return how many times noisier the position at rest is [1], 0 where not beyond doubt.

    Parameters
    ----------
    before, after : (N, F), (M, F) arrays
        Features as they are followed [unit by feature].
    table : SignatureTable
        Names of the features.
    """
    if NOISE not in table.features:
        return 0.0
    index = table.features.index(NOISE)
    old, new = before[:, index], after[:, index]
    old, new = old[np.isfinite(old)], new[np.isfinite(new)]
    if len(old) < _LEAST_NOISE or not len(new):
        return 0.0
    usual = float(np.median(old))
    spread = robust_sigma(old - usual)
    rise = float(np.median(new)) - usual
    return float(np.exp(rise)) if rise > max(_RISE, 6.0 * spread) else 0.0
