# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a cycle of any valve shows of faults: how its position differs from its model's free run.

Each feature is a plain number for one way in which a position can differ from the response that
is expected: a level, a slope over the level, a time, a width, a share. All lengths are shares of
one span of the response, so that the same numbers mean the same for every valve: that of one cycle
for all of them. What an offset, noise or friction is does not change with what a cycle drives, and
cycles at several levels would scatter by it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import NOISE, UNFOLLOWED, FeatureSet
from valve_twin.core.diagnosis.generic.moves import find_moves
from valve_twin.core.types import Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.diagnosis.generic.moves import Move
    from valve_twin.core.types import BoolArray, FloatArray

MOVE_NOISE, ROUGH_MOVE = "move_noise", "rough_move"
_SPAN = "share of the span"
FEATURES = (
    Parameter(NOISE, "1", f"feature: noise of the position, {_SPAN}", 0.0),
    Parameter("repeats", "1", "feature: share of samples that repeat the one before", 0.0, 1.0),
    Parameter("level_zero", "1", f"feature: position beyond the model's at 0, {_SPAN}"),
    Parameter("level_gain", "1", "feature: growth of this over the position"),
    Parameter("level_bend", "1", f"feature: this in mid-stroke off the line, {_SPAN}"),
    Parameter("gain_up", "1", "feature: way of moves up over the model's", 0.0),
    Parameter("gain_down", "1", "feature: way of moves down over the model's", 0.0),
    Parameter("lag_up", "s", "feature: how much later moves up are than the model's"),
    Parameter("lag_down", "s", "feature: how much later moves down are than the model's"),
    Parameter("slow_up", "1", "feature: how much longer moves up last than the model's"),
    Parameter("slow_down", "1", "feature: how much longer moves down last than the model's"),
    Parameter("short_up", "1", f"feature: what moves up lack from their start, {_SPAN}"),
    Parameter("short_down", "1", f"feature: what moves down lack from their start, {_SPAN}"),
    Parameter("stick", "1", f"feature: what the start of moves lacks beyond this, {_SPAN}"),
    Parameter(MOVE_NOISE, "1", f"feature: noise of the position in moves, {_SPAN}", 0.0),
    Parameter("rough_rest", "1", f"feature: rms about the mean at rest, {_SPAN}", 0.0),
    Parameter(ROUGH_MOVE, "1", f"feature: rms about the fit in moves, {_SPAN}", 0.0),
    Parameter(UNFOLLOWED, "1", "feature: share of the moves that were not followed", 0.0, 1.0),
    Parameter("saturated", "1", "feature: share of samples with a command at its end", 0.0, 1.0),
)
"""What the features of any valve are."""

NAMES = tuple(p.name for p in FEATURES)
ROOTS = (NOISE, MOVE_NOISE, "rough_rest", ROUGH_MOVE)
"""Features that are roots of sums of squares."""

GAINS = ("gain_up", "gain_down")

RELATIVE = frozenset((*ROOTS, *GAINS))

SHARES = ("repeats", UNFOLLOWED, "saturated")

LENGTHS = (*ROOTS, "level_zero", "level_bend", "short_up", "short_down", "stick")
"""Features that are shares of a span."""

DEVIATION = "deviation"
"""Name of the rms of position minus free run over the span, published and not followed [1]."""

SPAN = "span"
"""Name of what lengths are shares of, published and not followed [position]."""

_MOST = 1500
"""Most samples of a cycle that are looked at sample by sample."""

_LEAST_SAMPLES = 30
_LEAST_LEVEL = 5
_LEAST_MOVE = 6
_LEAST_QUIET = 20
"""Fewest samples of a cycle, a level, moves of one direction, and a rest that say something."""

_KEPT = 0.6230
"""Mean square of normal numbers without the largest tenth of them [1]."""

_ONE = 1e-9
"""Share of the span below which two values are one: error of the arithmetic [1]."""

_ROUNDED = 12.0**0.5
"""Step of what is rounded over the standard deviation that this makes [1]."""

_MISSED = 0.5
"""Share of a move by which an end of it is off where it was not followed, assumed [1]."""

_STAYS = 0.2
"""Share of what a move lacks by which a shift may change behind later moves, assumed [1]."""

_ASKED = 0.1
"""Share of the usual span that a cycle asks for at least where it tells anything: a stem at rest
repeats values as a frozen sensor does, and follows no noise of its command, assumed [1]."""

_END = 0.999
"""Share of the full scale from which on a command is at its end [1]."""

_ALIKE = 1e-3
"""Share of the length of a column that must stand out from those before it [1]."""

_EDGE = 0.25
"""Share of the span from its ends that counts as low and as high, assumed [1]."""

_START = 0.15
"""Share of a move that is its start, assumed [1]."""

_LEAST = {"saturated": 5e-3, "rough_rest": 0.1, ROUGH_MOVE: 0.1}
"""Least standard deviations of features between cycles, a fault of small size is four of these.
As a valve ages its controller is at its end for a sample more from some cycle on, and its steps of
rounding fall otherwise: no fault [unit of the feature; roughness is a logarithm]."""

_MOST_GAPS = 0.01
"""Share of samples that may be missing: what is lost on the way is no fault of the valve."""


def feature_set(
    exclude: tuple[str, ...] = (),
    extra: FeatureSet | None = None,
    least: Mapping[str, float] | None = None,
    *,
    by_model: bool = False,
) -> FeatureSet:
    """Return which features a valve is followed by.

    Parameters
    ----------
    exclude : tuple of str
        Names of those that mean nothing for this valve.
    extra : FeatureSet, optional
        Those of its own, which its `features` returns.
    least : mapping of str to float, optional
        Least standard deviation of a feature between cycles, by name [unit of the feature].
    by_model : bool
        Whether signatures are what the model sees of its simulated valve.
    """
    extra = extra or FeatureSet()
    names = tuple(n for n in NAMES if n not in exclude)
    return FeatureSet(
        (*names, *extra.names),
        RELATIVE | extra.relative,
        (*(n for n in SHARES if n in names), *extra.shares),
        extra.first_sizes,
        extra.largest,
        least={n: x for n, x in _LEAST.items() if n in names} | dict(least or {}),
        of_any_valve=True,
        by_model=by_model,
        gains=(*(n for n in GAINS if n in names), *extra.gains),
        slopes=extra.slopes,
    )


FEATURE_SET = feature_set()


@dataclass(frozen=True, slots=True)
class Record:
    """What the features of a cycle are taken from.

    Attributes
    ----------
    position, response : (N,) arrays
        Measured, and the free run of the reference model; NaN where not known [same unit].
    period_s : float
        Sampling time [s].
    commands : (N, M) array
        Commands over their full scale; no columns where that is not known [1].
    missing : float
        Share of samples that are missing [1].
    span : float
        What lengths are shares of; NaN = the span of this response [same unit].
    """

    position: FloatArray
    response: FloatArray
    period_s: float
    commands: FloatArray
    missing: float = 0.0
    span: float = math.nan

    @property
    def known(self) -> BoolArray:
        """Which samples are measured and expected, (N,)."""
        return np.asarray(np.isfinite(self.position) & np.isfinite(self.response))


def span_of(record: Record) -> float:
    """Return the span of a response where the position is known, 0 where too little is.

    Parameters
    ----------
    record : Record
        Measured and expected.
    """
    known = record.known
    return float(np.ptp(record.response[known])) if known.sum() >= _LEAST_SAMPLES else 0.0


def thinned(record: Record) -> Record:
    """Return a cycle with `_MOST` samples at most, one in some of a longer one."""
    step = 1 + len(record.position) // _MOST
    part = slice(None, None, step)
    return replace(
        record,
        position=record.position[part],
        response=record.response[part],
        commands=record.commands[part],
        period_s=record.period_s * step,
    )


def cycle_features(record: Record) -> dict[str, float]:
    """Return the features of one cycle by name, NaN where the cycle does not show one.

    Parameters
    ----------
    record : Record
        Measured and expected.
    """
    found = dict.fromkeys((*NAMES, DEVIATION), float("nan"))
    y = record.position[np.isfinite(record.position)]
    if len(y) < _LEAST_SAMPLES or record.missing > _MOST_GAPS:
        return found
    steered = record.commands[:, ~_switched(record.commands)]
    if steered.shape[1]:
        found["saturated"] = float(np.mean((np.abs(steered) >= _END).any(axis=1)))
    known = record.known
    response, span = record.response[known], span_of(record)
    asked = span >= _ASKED * (span if np.isnan(record.span) else record.span) and span > 0.0
    if asked or not known.any():
        found["repeats"] = float(np.mean(np.diff(y) == 0.0))
    if not asked:
        return found
    off = (record.position[known] - response) / span
    found[DEVIATION] = float(np.sqrt(np.mean(off**2)))
    step = step_of(record.position[known]) / span
    shown = _compared(response / span, off, step, record.period_s)
    over = 1.0 if np.isnan(record.span) else span / record.span
    return found | {n: x * over if n in LENGTHS else x for n, x in shown.items()}


def _switched(commands: FloatArray) -> BoolArray:
    """Return which of (N, M) commands are switched off and on to their end: none is saturated."""
    size = np.abs(commands)
    off, on = size <= 1.0 - _END, size >= _END
    known = np.isnan(size) | off | on
    return np.asarray(known.all(axis=0) & off.any(axis=0) & on.any(axis=0), dtype=np.bool_)


def _compared(s: FloatArray, off: FloatArray, step: float, period_s: float) -> dict[str, float]:
    """Return what position minus response `off` shows of a response `s`, both over its span.

    So is `step`, by which the position is rounded.
    """
    every, rest = find_moves(s)
    found: dict[str, float] = {}
    odd = {m for m in every if abs(_gain(m, off) - 1.0) > _MISSED}
    shifts = {m for n, m in enumerate(every) if m in odd and _lasts(m, every[n + 1 :], odd, off)}
    lost = sum(_is_off(off[m.behind], m) for m in odd - shifts)
    if every:
        found[UNFOLLOWED] = lost / len(every)
    if lost or (odd and not shifts):  # tells nothing else
        return found
    moves = tuple(m for m in every if m not in odd)
    found |= _levels(s, off, rest)
    found |= _noise(off, rest, step)
    found["rough_rest"] = _rough(off, every, rest)
    rough, stick = [], []
    for way, name in ((1.0, "up"), (-1.0, "down")):
        chosen = [m for m in moves if m.way * way > 0.0]
        if chosen:
            found[f"gain_{name}"] = float(np.mean([_gain(m, off) for m in chosen]))
        fit = _motion(chosen, s, off)
        if fit is not None:
            found[f"lag_{name}"] = fit.lag * period_s
            found[f"slow_{name}"], found[f"short_{name}"] = fit.slow, fit.short
            rough.append(fit.left)
            stick.append(fit.start)
    if rough:
        found[ROUGH_MOVE] = float(np.sqrt(np.mean(np.concatenate(rough) ** 2)))
        starts = np.concatenate(stick)
        found["stick"] = float(starts.mean()) if len(starts) else np.nan
    return found


def step_of(position: FloatArray) -> float:
    """Return the step of a rounded position, 0 where it never changes.

    Parameters
    ----------
    position : (N,) array
        Measured, all finite [any unit].
    """
    values = np.unique(position)
    steps = np.diff(values)
    steps = steps[steps > _ONE * (values[-1] - values[0])]
    return float(steps.min()) if len(steps) else 0.0


def _is_off(off: FloatArray, move: Move) -> bool:
    """Return whether a move does not begin or end where it should."""
    return bool(abs(np.median(off)) > _MISSED * abs(move.way))


def _gain(move: Move, off: FloatArray) -> float:
    """Return the way of a move over that of the model [1]."""
    return 1.0 + _lack(move, off) / move.way


def _lack(move: Move, off: FloatArray) -> float:
    """Return by how much more the position is off behind a move than before it [1]."""
    return float(np.mean(off[move.behind])) - float(np.mean(off[move.before]))


def _lasts(move: Move, later: tuple[Move, ...], odd: set[Move], off: FloatArray) -> bool:
    """Return whether what a move lacks is still there behind all later ones that were made.

    A valve that lost a command is right again by then. One whose zero is shifted is not: the
    model is set on what is measured first, and leaves it for where the command wants it. One that
    oscillates is not as far off from sample to sample.
    """
    lacks, here = abs(_lack(move, off)), float(np.mean(off[move.behind]))
    if float(np.ptp(off[move.behind])) > _MISSED * lacks:
        return False
    since = [abs(float(np.mean(off[m.behind])) - here) for m in later if m not in odd]
    return bool(since) and max(since) < _STAYS * lacks


def _levels(s: FloatArray, off: FloatArray, rest: BoolArray) -> dict[str, float]:
    """Return level, slope and bend of the difference at rest low, in the middle and high."""
    low, share = float(s.min()), s - float(s.min())
    parts = [rest & (share < _EDGE), rest & (np.abs(share - 0.5) <= 0.5 - _EDGE)]
    parts.append(rest & (share > 1.0 - _EDGE))
    shown = [np.count_nonzero(t) >= _LEAST_LEVEL for t in parts]
    at = [float(s[t].mean()) if ok else np.nan for t, ok in zip(parts, shown, strict=True)]
    value = [float(off[t].mean()) if ok else np.nan for t, ok in zip(parts, shown, strict=True)]
    if not (shown[0] and shown[2]):
        known = [v for v in value if np.isfinite(v)]
        return {"level_zero": float(np.mean(known))} if known else {}
    pivot = 0.0 if -1.0 <= low <= 1.0 else at[0]  # a signal far from its 0 tells no gain there
    slope = (value[2] - value[0]) / (at[2] - at[0])
    line = value[0] - slope * at[0]
    found = {"level_zero": line + slope * pivot, "level_gain": slope}
    if shown[1]:
        found["level_bend"] = value[1] - line - slope * at[1]
    return found


def _noise(off: FloatArray, rest: BoolArray, step: float) -> dict[str, float]:
    """Return the noise from second differences at rest and in moves, at least that of rounding.

    In moves they show what the model errs there, too, and jerks. Where too little is at rest, all
    count as rest.
    """
    bends = np.diff(off, 2) ** 2
    quiet = rest[:-2] & rest[1:-1] & rest[2:]
    found = {NOISE: _trimmed(bends[quiet] if quiet.sum() >= _LEAST_QUIET else bends)}
    if np.count_nonzero(~quiet) >= _LEAST_QUIET:
        found[MOVE_NOISE] = _trimmed(bends[~quiet])
    return {n: max(x, step / _ROUNDED) for n, x in found.items()}


def _trimmed(bends: FloatArray) -> float:
    """Return the noise by squared second differences without the largest tenth [1]."""
    bends = np.sort(bends)
    kept = bends[: max(len(bends) - len(bends) // 10, 1)]
    return float(np.sqrt(kept.mean() / (6.0 * _KEPT)))


def _rough(off: FloatArray, moves: tuple[Move, ...], rest: BoolArray) -> float:
    """Return the rms about the mean of each stretch of rest [1]."""
    edges = [0, *(m.first for m in moves), len(off)]
    total, count = 0.0, 0
    for a, b in pairwise(edges):
        part = off[a:b][rest[a:b]]
        if len(part) >= _LEAST_LEVEL:
            total += float(np.sum((part - part.mean()) ** 2))
            count += len(part) - 1
    return float(np.sqrt(total / count)) if count else float("nan")


@dataclass(frozen=True, slots=True)
class _Motion:
    """Moves of one way: `lag` [samples], `slow`, `short`; what is left, and of the start."""

    lag: float
    slow: float
    short: float
    left: FloatArray
    start: FloatArray


def _motion(moves: list[Move], s: FloatArray, off: FloatArray) -> _Motion | None:
    """Fit lag, stretch and width to what moves of one way lack, each beyond those before.

    So they scatter by themselves.
    """
    speed = np.gradient(s)
    rows, lacks, early = [], [], []
    for move in moves:
        part = move.whole
        sign = np.sign(move.way)
        begun = off[move.before].mean()
        t = np.arange(part.stop - part.start, dtype=np.float64)
        pace = sign * speed[part]
        rows.append(np.stack((pace, pace * t, np.ones(len(t))), axis=1))
        lacks.append(-sign * (off[part] - begun))
        early.append(np.abs(s[part] - s[move.first]) < _START * abs(move.way))
    if sum(map(len, lacks)) < _LEAST_MOVE:
        return None
    columns, lack, start = np.concatenate(rows), np.concatenate(lacks), np.concatenate(early)
    q, r = np.linalg.qr(columns)
    if (np.abs(np.diag(r)) <= _ALIKE * np.linalg.norm(columns, axis=0)).any():
        return None
    along = q.T @ lack
    left = lack - q @ along
    found = along / np.diag(r)
    return _Motion(float(found[0]), float(found[1]), float(found[2]), left, left[start])
