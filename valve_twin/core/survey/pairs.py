# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which column is a position and which are its commands, from correlations over the lag.

All columns are held on the stamps of the position under test; a long record is thinned for the
search, and the lag is then found among all samples of its liveliest stretch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import FloatArray, IntArray

_MAX_GRID = 16_384  # samples of a search
_MAX_COLUMNS = 24  # columns tried: the work grows with their square
_MAX_LAG_S = 1.0  # longest lag looked for beyond _LEAST_LAGS samples, assumed
_LEAST_LAGS = 16
_ENOUGH = 0.3  # correlation worth proposing, assumed
_CLEAR = 0.6  # correlation that needs no longer increments, assumed
_CHANCE = 5.0  # standard deviations by which it exceeds that of unrelated increments
_OVER = (1, 4, 16, 64)  # samples over which increments are taken
_LEAST_INCREMENTS = 40  # as long as such an increment, the shortest record
_LEVELS_ALIKE = 0.5  # correlation of the levels of a command and what follows it, assumed
_ONE_SIDED = 0.02  # share of its span that a one-sided command may lie below zero
_ACTIVE = 0.1  # share of its largest value above which a command is given
_OVERLAP = 0.3  # share of the wider range that two columns of the same unit have in common
_MIRROR, _MIRROR_LAG = 0.02, 3  # closer than this share of the range, and samples, is no command
_TIE = 0.01  # correlations closer than this decide nothing


@dataclass(frozen=True, slots=True)
class Signal:
    """One numeric column of a record: stamps (N,) [ns] and values (N,) [its own unit]."""

    name: str
    stamp_ns: IntArray
    values: FloatArray


@dataclass(frozen=True, slots=True)
class Driven:
    """A position whose rate two one-sided commands drive.

    Attributes
    ----------
    position, up, down : str
        Columns.
    lag : int
        Command to position [samples].
    rising, falling : float
        Correlations of the commands with the rate [1].
    """

    position: str
    up: str
    down: str
    lag: int
    rising: float
    falling: float


@dataclass(frozen=True, slots=True)
class Followed:
    """A command that a position follows.

    Attributes
    ----------
    position, command : str
        Columns.
    lag : int
        Command to position [samples].
    correlation : float
        Of the increments [1].
    gain, level : float
        The position settles at gain * command + level; 1 and 0 where the unit is the same.
    """

    position: str
    command: str
    lag: int
    correlation: float
    gain: float = 1.0
    level: float = 0.0


@dataclass(frozen=True, slots=True)
class _View:
    """All columns on the stamps of one of them, every `every`-th sample."""

    every: int
    max_lag: int
    columns: dict[str, FloatArray]


class Views:
    """Views of a record by the column under test, made when they are asked for.

    Parameters
    ----------
    signals : mapping
        Columns by name, each with at least two different values.
    """

    def __init__(self, signals: Mapping[str, Signal]) -> None:
        self.signals = dict(list(signals.items())[:_MAX_COLUMNS])
        self._made: dict[str, _View] = {}

    def of(self, target: str) -> _View:
        """Return the view on the stamps of a column."""
        if target not in self._made:
            grid = self.signals[target].stamp_ns
            every = -(-len(grid) // _MAX_GRID)
            self._made[target] = self.part(target, slice(None, None, every), every)
        return self._made[target]

    def part(self, target: str, part: slice, every: int) -> _View:
        """Return the view on part of the stamps of a column.

        Parameters
        ----------
        target : str
            Column whose stamps count.
        part : slice
            Which of them.
        every : int
            Stamps a step [1].
        """
        grid = self.signals[target].stamp_ns
        step_s = float(np.median(np.diff(grid))) / 1e9 * every
        held = {k: hold(s, grid[part]) for k, s in self.signals.items()}
        n = len(grid[part])
        return _View(every, min(max(_LEAST_LAGS, round(_MAX_LAG_S / step_s)), n // 4), held)

    def liveliest(self, target: str) -> _View:
        """Return the consecutive samples in which a column moves most."""
        values = self.signals[target].values
        n = min(len(values), _MAX_GRID)
        way = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(values)))))
        first = int(np.argmax(way[n - 1 :] - way[: len(way) - n + 1]))
        return self.part(target, slice(first, first + n), 1)


def find_driven(views: Views, targets: Sequence[str]) -> Driven | None:
    """Find the position that two one-sided commands drive; of several, the one that lags most.

    Parameters
    ----------
    views : Views
        The record.
    targets : sequence of str
        Columns that may be the position.
    """
    found = [d for t in targets if t in views.signals and (d := _driven(views, t)) is not None]
    if not found:
        return None
    best = max(found, key=lambda d: min(d.rising, -d.falling))
    family = [d.position for d in found if {d.up, d.down} == {best.up, best.down}]
    last = _last(views, family)
    return next(d for d in found if d.position == last)


def _driven(views: Views, target: str) -> Driven | None:
    """Match what one-sided commands add up to with the position, and its mirror image."""
    view = views.of(target)
    y = view.columns[target]
    up: tuple[float, str] = (0.0, "")
    down: tuple[float, str] = (0.0, "")
    for name, u in view.columns.items():
        if name == target or not _one_sided(u):
            continue
        total = _summed(u)
        for sign in (1.0, -1.0):
            match = match_increments(total, sign * y, view.max_lag, causal=True)
            score = (0.0 if match is None else match.correlation, name)
            if sign > 0.0:
                up = max(up, score)
            else:
                down = max(down, score)
    if not (up[1] and down[1]) or up[1] == down[1]:
        return None
    if not _alternate(view.columns[up[1]], view.columns[down[1]]):
        return None
    near = views.liveliest(target) if view.every > 1 else view
    both = _summed(near.columns[up[1]] - near.columns[down[1]])
    match = match_increments(both, near.columns[target], near.max_lag, causal=True)
    lag = 0 if match is None else match.lag
    return Driven(target, up[1], down[1], lag + 1, up[0], -down[0])


def _summed(u: FloatArray) -> FloatArray:
    """Return the sum of all values before each."""
    total: FloatArray = np.concatenate(([0.0], np.cumsum(u)[:-1]))
    return total


def find_followed(views: Views, targets: Sequence[str]) -> Followed | None:
    """Find a position that follows a command, first among columns of the same unit.

    Parameters
    ----------
    views : Views
        The record.
    targets : sequence of str
        Columns that may be the position.
    """
    for same_unit in (True, False):
        pairs = [
            f
            for t in targets
            if t in views.signals
            for c in views.signals
            if c != t and (f := _followed(views, t, c, same_unit)) is not None
        ]
        if pairs:
            best = max(pairs, key=lambda f: f.correlation)
            family = {best.position} | {
                f.position for f in pairs if best.position in {f.command, f.position}
            }
            last = _last(views, sorted(family)) if same_unit else best.position
            own = [f for f in pairs if f.position == last]
            own = [f for f in own if not _mirrors(views, f)] or own
            enough = max(f.correlation for f in own) - _TIE
            return _exact(views, min((f for f in own if f.correlation >= enough), key=_by_lag))
    return None


def _by_lag(followed: Followed) -> int:
    return followed.lag


def _followed(views: Views, target: str, command: str, same_unit: bool) -> Followed | None:
    view = views.of(target)
    u, y = view.columns[command], view.columns[target]
    if same_unit and not _same_unit(u, y):
        return None
    match = match_increments(u, y, view.max_lag)
    if match is None or match.lag < 0:
        return None
    gain, level = 1.0, 0.0
    before, after = u[: len(u) - match.lag], y[match.lag :]
    if float(np.corrcoef(before, after)[0, 1]) < _LEVELS_ALIKE:
        return None
    if not same_unit:
        gain, level = (float(c) for c in np.polyfit(before, after, 1))
    return Followed(target, command, match.lag * view.every, match.correlation, gain, level)


def _exact(views: Views, found: Followed) -> Followed:
    """Find the lag among all samples, from increments over as long as the search had."""
    coarse = views.of(found.position)
    match = match_increments(
        coarse.columns[found.command], coarse.columns[found.position], coarse.max_lag
    )
    assert match is not None  # it was found before
    view = views.liveliest(found.position)
    u, y = view.columns[found.command], view.columns[found.position]
    over = coarse.every * match.over
    r = _correlations(u[over:] - u[:-over], y[over:] - y[:-over], view.max_lag)
    return replace(found, lag=int(np.argmax(r[view.max_lag :])))


@dataclass(frozen=True, slots=True)
class Match:
    """How the increments of one column, over `over` samples, follow those of another."""

    correlation: float
    lag: int
    over: int


def match_increments(
    u: FloatArray, y: FloatArray, max_lag: int, *, causal: bool = False
) -> Match | None:
    """Return the best match, None where none is beyond chance.

    A slow valve answers a step over many samples: increments over more samples show it, but fewer
    of them are independent. The shortest that show it well give the lag best.

    Parameters
    ----------
    u, y : (N,) arrays
        Columns on one grid [their units].
    max_lag : int
        Longest lag tried, both ways [samples].
    causal : bool
        Whether u comes first.
    """
    best: Match | None = None
    for over in _OVER:
        if len(y) < _LEAST_INCREMENTS * over:
            break
        r = _correlations(u[over:] - u[:-over], y[over:] - y[:-over], max_lag)
        r[: max_lag if causal else 0] = -1.0
        found = Match(float(r.max()), int(np.argmax(r)) - max_lag, over)
        chance = _CHANCE * np.sqrt(over / len(y))
        if found.correlation < max(_ENOUGH, chance):
            continue
        if best is None or found.correlation > best.correlation:
            best = found
        if best.correlation >= _CLEAR:
            break
    return best


def match_levels(u: FloatArray, y: FloatArray, max_lag: int) -> Match | None:
    """Return how the levels of one column follow those of another that comes first.

    Parameters
    ----------
    u, y : (N,) arrays
        Columns on one grid [their units].
    max_lag : int
        Longest lag tried [samples].
    """
    r = _correlations(u, y, max_lag)[max_lag:]
    lag = int(np.argmax(r))
    return Match(float(r[lag]), lag, 0) if r[lag] > 0.0 else None


def _mirrors(views: Views, found: Followed) -> bool:
    """Whether the "command" is the position itself, seen by another sensor."""
    view = views.of(found.position)
    lag = found.lag // view.every
    u, y = view.columns[found.command], view.columns[found.position]
    miss = y[lag:] - found.gain * u[: len(u) - lag]
    return lag <= _MIRROR_LAG and float(np.std(miss)) < _MIRROR * float(np.ptp(y))


def _last(views: Views, names: Sequence[str]) -> str:
    """Return the column that comes after the others; of equals the noisier, a sensor has noise."""

    def rank(name: str) -> tuple[int, float]:
        view = views.of(name)
        y = view.columns[name]
        after = 0
        for other in names:
            match = match_increments(view.columns[other], y, view.max_lag)
            after += 0 if match is None else int(np.sign(match.lag))
        steps = np.diff(y)
        return after, float(np.var(np.diff(steps)) / max(float(np.var(steps)), 1e-300))

    return max(names, key=rank)


def _correlations(a: FloatArray, b: FloatArray, max_lag: int) -> FloatArray:
    """Return the correlation of b[n] with a[n - lag], -max_lag <= lag <= max_lag."""
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt(np.sum(a**2) * np.sum(b**2)))
    if scale == 0.0:
        return np.zeros(2 * max_lag + 1)
    n = 1 << (len(a) + max_lag).bit_length()
    r = np.fft.irfft(np.conj(np.fft.rfft(a, n)) * np.fft.rfft(b, n), n) / scale
    both: FloatArray = np.concatenate((r[n - max_lag :], r[: max_lag + 1]))
    return both


def hold(signal: Signal, at_ns: IntArray) -> FloatArray:
    """Return the last value of a column at some times, (N,) [its own unit].

    Parameters
    ----------
    signal : Signal
        The column.
    at_ns : (N,) array
        Times [ns].
    """
    index = np.searchsorted(signal.stamp_ns, at_ns, side="right") - 1
    held: FloatArray = signal.values[np.maximum(index, 0)]
    return held


def _one_sided(u: FloatArray) -> bool:
    span = float(np.ptp(u))
    return bool(span > 0 and u.min() >= -_ONE_SIDED * span and np.median(u) < 0.5 * u.max())


def _alternate(u: FloatArray, v: FloatArray) -> bool:
    """Whether two commands are seldom given at once."""
    first, second = u > _ACTIVE * u.max(), v > _ACTIVE * v.max()
    shorter = min(np.count_nonzero(first), np.count_nonzero(second))
    return bool(np.count_nonzero(first & second) < 0.5 * shorter)


def _same_unit(u: FloatArray, y: FloatArray) -> bool:
    low, high = max(u.min(), y.min()), min(u.max(), y.max())
    return bool(high - low > _OVERLAP * max(np.ptp(u), np.ptp(y)))
