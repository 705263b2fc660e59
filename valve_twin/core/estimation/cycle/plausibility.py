# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Recognise signals that are not what the configuration says, before anything is fitted to them.

A fit to exchanged commands, an inverted position or percent gives numbers, often with small
errors. Each check looks for one mistake whose effect no working valve shows, and answers with one
line that names it and what to write; an empty line means that nothing speaks against the signals.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.lag_kernels import effects_at_lag, equals, varies
from valve_twin.core.gaps import PERIOD_TOLERANCE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import Cycle, FloatArray, Frames, IntArray

LARGEST = 1.5
"""A signal that is 0..1 does not go beyond this, overshoot and offset included [1], assumed."""

FEWEST_STEPS = 20
"""Fewest steps between samples, to know their distance or a direction [1]."""

_FAR = 3.0  # speeds and pressures may exceed their full scale more than positions [1]
_FEWEST_BEYOND = 3  # samples: fewer are outliers, not a unit
_GAP, _BUNCH = 1.5, 10.0  # median steps, periods; a step longer than both is a gap
SURE = 6.0
"""Effect that decides a direction [standard errors]."""

EXPLAINED = 0.2
"""Least share of the motion that the commands explain, to decide its direction [1]."""

_AT_SEAT = 0.05  # distance from a seat that counts as resting there [1]
_AGAINST = -0.5  # correlation at which a position runs against its command ...
_WEAKER = 0.5  # ... if none at another delay is stronger than this share of it
_LEADS = 0.6  # least correlation at which a position can be said to come before its command
_MOST_LAGS = 64  # tried, evenly up to the longest
_LEADS_BY = 0.5  # what is unexplained with the position first, over that with the command first


def wrong_step(stamp_ns: IntArray, period_s: float) -> float:
    """Return the distance of samples where it is not the configured one [s], else 0.

    Both the median step and the mean step without gaps must disagree: lost samples and messages
    that come in bunches are no wrong sampling time.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Stamps [ns].
    period_s : float
        Configured sampling time [s].
    """
    if len(stamp_ns) <= FEWEST_STEPS:
        return 0.0
    steps = np.diff(stamp_ns) * 1e-9
    median = float(np.median(steps))
    mean = float(steps[steps <= max(_GAP * median, _BUNCH * period_s)].mean())
    lower, upper = period_s * (1.0 - PERIOD_TOLERANCE), period_s * (1.0 + PERIOD_TOLERANCE)
    return median if max(median, mean) < lower or min(median, mean) > upper else 0.0


def unit_fault(signal: str, values: FloatArray, lower: float, upper: float) -> str:
    """Name a signal that leaves the range that a normalised one can have.

    Parameters
    ----------
    signal : str
        Its name.
    values : (N,) array
        Its finite values [1].
    lower, upper : float
        The range [1].
    """
    if lower <= values.min() and values.max() <= upper:
        return ""
    beyond = (values < lower) | (values > upper)
    if np.count_nonzero(beyond) < _FEWEST_BEYOND:
        return ""
    hint = "a negative one where it is inverted" if values.mean() < 0.0 else "0.01 for percent"
    return (
        f"{signal} runs from {values.min():.4g} to {values.max():.4g}, it is to be 0 to 1: "
        f"correct signals.{signal}.scale ({hint}) and .offset"
    )


def same_fault(names: Sequence[str], columns: Sequence[FloatArray]) -> str:
    """Name two signals that move and are equal in every sample: one topic was mapped twice.

    Parameters
    ----------
    names : sequence of str
        The signals.
    columns : sequence of (N,) arrays
        Their values, finite [1].
    """
    for i, first in enumerate(columns):
        for j in range(i):
            if equals(first, columns[j]) and varies(first):
                return (
                    f"{names[j]} and {names[i]} carry the same values: correct "
                    f"signals.{names[j]} or signals.{names[i]}"
                )
    return ""


def still_fault(names: Sequence[str], commands: Sequence[FloatArray]) -> str:
    """Name commands that all stay where they are, other than off.

    Parameters
    ----------
    names : sequence of str
        The commands.
    commands : sequence of (N,) arrays
        Their values, finite [1].
    """
    if any(varies(u) for u in commands) or not any(u[0] for u in commands):
        return ""
    where = " and ".join(f"{n} at {u[0]:.4g}" for n, u in zip(names, commands, strict=True))
    topics = " and ".join(f"signals.{n}.topic" for n in names)
    return f"nothing is commanded, {where} all the time: correct {topics}"


def known_rows(frames: Frames) -> Frames:
    """Return only the samples whose position and commands are valid and finite."""
    if frames.valid.all() and np.isfinite(frames.position.sum() + frames.inputs.sum()):
        return frames  # a sum is finite only where all it is made of are
    known = frames.valid & np.isfinite(frames.position) & np.isfinite(frames.inputs).all(axis=1)
    return frames if known.all() else frames[known]


def normalised_fault(
    names: Sequence[str], cycle: Cycle, *, follows: str = "", reach_s: float = 0.0
) -> str:
    """Check a cycle of a valve all of whose signals are parts of their full scale.

    Parameters
    ----------
    names : sequence of str
        The position, then the inputs in the order of the frames.
    cycle : Cycle
        At least one sample.
    follows : str
        The input that the position follows; empty = none.
    reach_s : float
        Longest delay between the two [s].
    """
    known = known_rows(cycle.frames)
    if len(known) == 0:
        return ""
    columns = (known.position, *known.inputs.T)
    limits = (LARGEST - 2.0, LARGEST), (-_FAR, _FAR)
    faults = [
        unit_fault(name, values, *limits[min(i, 1)])
        for i, (name, values) in enumerate(zip(names, columns, strict=True))
    ]
    faults.append(same_fault(names, columns))
    if follows:
        max_lag = max(1, round(reach_s / cycle.period_s))
        command = columns[list(names).index(follows)]
        pair = (names[0], follows)
        faults.append(
            follow_fault(pair, columns[0], command, period_s=cycle.period_s, max_lag=max_lag)
        )
    return next((fault for fault in faults if fault), "")


def drive_fault(
    names: Sequence[str],
    position: FloatArray,
    inputs: FloatArray,
    *,
    seats: tuple[float, float],
    max_lag: int,
) -> str:
    """Tell whether a position falls with the command that is to raise it, and the other way.

    The increments of the position are explained by both commands, at the lag that explains them
    best. A command that does not speak clearly says nothing.

    Parameters
    ----------
    names : sequence of str
        The position, the command that raises it, the command that lowers it.
    position : (N,) array
        Position [1].
    inputs : (N, 2) array
        The command that raises it and the one that lowers it [1].
    seats : tuple of float
        Lower and upper seat [1].
    max_lag : int
        Longest lag tried [samples].
    """
    rising, falling = _driven_by(position, inputs, max_lag)
    wrong = [rising < -SURE, falling > SURE]
    if not any(wrong) or rising > SURE or falling < -SURE:
        return ""
    what = [f"falls while {names[1]} is on", f"rises while {names[2]} is on"]
    seen = " and ".join(text for text, is_so in zip(what, wrong, strict=True) if is_so)
    exchanged = (
        f"exchange signals.{names[1]} and signals.{names[2]} (or the record runs backwards)"
    )
    inverted = (
        f"the position is inverted: turn the sign of signals.{names[0]}.scale and correct .offset"
    )
    low, high = (float(q) for q in np.quantile(position, (0.01, 0.99)))
    at_lower = abs(low - seats[0]) < _AT_SEAT
    at_upper = abs(high - seats[1]) < _AT_SEAT
    if at_lower != at_upper:
        return f"{names[0]} {seen}: {exchanged if at_lower else inverted}"
    if high < seats[0] + _AT_SEAT:
        return f"{names[0]} {seen}: {inverted}"
    return f"{names[0]} {seen}: {exchanged}, or {inverted}"


def _driven_by(position: FloatArray, inputs: FloatArray, max_lag: int) -> tuple[float, float]:
    """Return t of both commands' effects on the increments, at the lag that explains most.

    One lag at which both act as they should is enough: no lag shows that of a wrong mapping.
    """
    best, found = EXPLAINED, (0.0, 0.0)
    for lag in range(max_lag + 1):
        if len(position) - 1 - lag < FEWEST_STEPS:
            break
        explained, rising, falling = effects_at_lag(position, inputs, lag)
        if explained > best:
            best, found = explained, (rising, falling)
        if explained > EXPLAINED and rising > SURE and falling < -SURE:
            return rising, falling
    return found


def follow_fault(
    names: Sequence[str],
    position: FloatArray,
    command: FloatArray,
    *,
    period_s: float,
    max_lag: int,
) -> str:
    """Tell whether a position runs against its command, or comes before it.

    Parameters
    ----------
    names : sequence of str
        The position and the command.
    position, command : (N,) arrays
        Position and command [1], without gaps.
    period_s : float
        Sampling time [s].
    max_lag : int
        Longest delay tried [samples].
    """
    reach = min(max_lag, len(position) // 8)
    lags = np.unique(np.linspace(0, reach, min(reach, _MOST_LAGS) + 1).astype(np.int64)).tolist()
    after = [_correlation(command, position, lag) for lag in lags]
    before = [_correlation(position, command, lag) for lag in lags]
    follows, leads = max(after), max(before)
    if min(after) < _AGAINST and follows < _WEAKER * -min(after):
        return (
            f"{names[0]} falls as {names[1]} rises (correlation {min(after):.2f}): one of them is "
            f"inverted: turn the sign of signals.{names[0]}.scale and correct .offset"
        )
    lag = lags[before.index(leads)]
    if lag > 1 and leads > _LEADS and 1.0 - leads < _LEADS_BY * (1.0 - follows):
        return (
            f"{names[0]} moves {lag * period_s:.3g} s before {names[1]}: exchange "
            f"signals.{names[0]} and signals.{names[1]}, or the record runs backwards"
        )
    return ""


def _correlation(first: FloatArray, second: FloatArray, lag: int) -> float:
    """Return the correlation of second[n] with first[n - lag]; 0 where one of them rests."""
    a, b = first[: len(first) - lag], second[lag:]
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0.0 else 0.0
