# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Judge one stroke that somebody else commanded, partial or full, by named criteria.

Way and times are those of the command: way 1 is the commanded stroke, times begin when the command
leaves its first level. What is not reached has infinite time: it never passes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import difference_sigma
from valve_twin.core.operation.way import (
    HELD,
    LEAST_SAMPLES,
    LEFT_SIGMAS,
    WINDOW,
    end_of,
    smooth_way,
)
from valve_twin.core.quantity import assumed, check_quantities

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

LEAST_STROKE = 50.0
"""Least commanded stroke that is judged [standard deviations of the noise at rest], assumed."""

_LEFT = 0.02  # way that is a breakaway [1], assumed
_BAND, _BAND_SIGMAS = 0.01, 6.0  # way within which a valve stands [1], [standard deviations]


class StrokeVerdict(Enum):
    """What is said of a stroke."""

    PASS = "pass"
    FAIL = "fail"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class StrokeLimits:
    """The most that a stroke may need or depart; all assumed until a plant sets its own."""

    breakaway_s: float = assumed(1.0, "s", "Time until the valve has left its rest.", 0.0)
    t63_s: float = assumed(5.0, "s", "Time until 63 % of the commanded way.", 0.0)
    t86_s: float = assumed(8.0, "s", "Time until 86 % of the commanded way.", 0.0)
    travel: float = assumed(0.05, "1", "Way that is missing or too much, of it.", 0.0, 0.5)
    overshoot: float = assumed(0.1, "1", "Way beyond the level that is held, of it.", 0.0)
    stick_s: float = assumed(1.0, "s", "Longest stop on the way to 86 %.", 0.0)
    hunting: float = assumed(0.02, "1", "Standard deviation where it is held, of it.", 0.0)
    early: float = assumed(0.05, "1", "Way before the command, of it.", 0.0)
    return_s: float = assumed(8.0, "s", "Time until 86 % of the way back.", 0.0)
    return_error: float = assumed(0.05, "1", "Way that is missing at the end, of it.", 0.0, 0.5)

    def __post_init__(self) -> None:
        """Refuse what is no limit."""
        check_quantities(self)


@dataclass(frozen=True, slots=True)
class Criterion:
    """One named criterion.

    Attributes
    ----------
    name : str
        Field of `StrokeLimits`.
    value, limit : float
        What was found, infinite where it was not reached, and the most that passes [s or 1].
    """

    name: str
    value: float
    limit: float

    @property
    def passed(self) -> bool:
        """Whether it is kept."""
        return self.value <= self.limit

    @property
    def excess(self) -> float:
        """By how much it is not kept, 0 where it is [s or 1]."""
        return max(self.value - self.limit, 0.0)


@dataclass(frozen=True, slots=True)
class StrokeTest:
    """What is found of a stroke.

    Attributes
    ----------
    verdict : StrokeVerdict
        Pass, fail, or refused with its reason.
    criteria : tuple of Criterion
        What was judged; of a stroke without return the first eight.
    stroke, noise : float
        Commanded stroke and standard deviation of the position at rest [unit of the position].
    reason : str
        Why it is refused; empty otherwise.
    """

    verdict: StrokeVerdict
    criteria: tuple[Criterion, ...] = ()
    stroke: float = math.nan
    noise: float = math.nan
    reason: str = ""

    @property
    def failed(self) -> tuple[Criterion, ...]:
        """The criteria that are not kept."""
        return tuple(c for c in self.criteria if not c.passed)


def judge_stroke(
    time_s: FloatArray, command: FloatArray, position: FloatArray, *, limits: StrokeLimits
) -> StrokeTest:
    """Judge one commanded stroke, with or without its return.

    Parameters
    ----------
    time_s : (N,) array
        Times, increasing [s].
    command : (N,) array
        Command that is in force at those times [unit of the position].
    position : (N,) array
        Measured position [any unit].
    limits : StrokeLimits
        What passes.

    Returns
    -------
    StrokeTest
        Refused where the record does not let it be judged.

    Raises
    ------
    ValueError
        If the arrays do not fit each other or the times do not increase.
    """
    if not len(time_s) == len(command) == len(position):
        msg = f"{len(time_s)} times, {len(command)} commands, {len(position)} positions"
        msg += ": give one of each a sample"
        raise ValueError(msg)
    known = np.isfinite(time_s) & np.isfinite(command) & np.isfinite(position)
    time_s, command, position = time_s[known], command[known], position[known]
    if (np.diff(time_s) <= 0.0).any():
        msg = "the times do not increase: sort the samples and leave out repeated stamps"
        raise ValueError(msg)
    if len(time_s) < 2 * LEAST_SAMPLES:
        return _refused(f"{len(time_s)} samples, needed are {2 * LEAST_SAMPLES}")
    off = np.abs(command - command[0])
    stroke = float(off.max())
    if stroke == 0.0:
        return _refused("the command does not change: no stroke was commanded")
    if np.allclose(position, command, rtol=0.0, atol=1e-9 * stroke):
        return _refused("the position is a copy of the command: it tells nothing of the valve")
    level = float(command[off.argmax()])
    begin = int((off > HELD * stroke).argmax())
    there = np.abs(command - level) <= HELD * stroke
    arrived = int(there.argmax())
    gone = np.flatnonzero(~there[arrived:])
    back = arrived + int(gone[0]) if len(gone) else len(command)
    returns = back < len(command)
    if returns and (
        off[-1] > HELD * stroke or (np.diff((off > HELD * stroke)[back:].astype(int)) > 0).any()
    ):
        return _refused("the command is no single stroke, away and back: cut one out")
    for samples, where in (
        (begin, "before the command"),
        (back - arrived, "away"),
        (len(command) - back if returns else LEAST_SAMPLES, "after the return"),
    ):
        if samples < LEAST_SAMPLES:
            return _refused(f"{samples} samples {where}, needed are {LEAST_SAMPLES}")
    rest = position[:begin]
    start = float(np.median(rest))
    noise = difference_sigma(np.diff(rest, 2), 2)  # a valve that moves there is early, not noisy
    if stroke < LEAST_STROKE * noise:
        least = LEAST_STROKE * noise
        return _refused(f"a stroke of {stroke:.3g} is too small beside the noise: {least:.3g}")
    way = (position - start) * np.sign(level - command[0]) / stroke
    smooth = smooth_way(way)
    found = _away(time_s, way, smooth, (begin, back), noise / stroke)
    if returns:
        end = end_of(way[back:])
        found["return_s"] = _reached(-smooth[back:], time_s[back:], -0.14)
        found["return_error"] = abs(float(np.median(end)))
    criteria = tuple(Criterion(n, value, getattr(limits, n)) for n, value in found.items())
    passed = all(c.passed for c in criteria)
    verdict = StrokeVerdict.PASS if passed else StrokeVerdict.FAIL
    return StrokeTest(verdict, criteria, stroke, noise)


def _refused(reason: str) -> StrokeTest:
    return StrokeTest(StrokeVerdict.REFUSED, reason=reason)


def _away(
    time_s: FloatArray, way: FloatArray, smooth: FloatArray, between: tuple[int, int], noise: float
) -> dict[str, float]:
    """Return what is judged of the way there, by the names of the limits."""
    begin, back = between
    times, moved = time_s[begin:back], smooth[begin:back]
    end = end_of(way[begin:back])
    held = float(np.median(end))
    left = _reached(moved, times, max(_LEFT, LEFT_SIGMAS * noise))
    t86 = _reached(moved, times, 0.86)
    under_way = (times - times[0] >= left) & (times - times[0] <= t86)
    return {
        "breakaway_s": left,
        "t63_s": _reached(moved, times, 0.63),
        "t86_s": t86,
        "travel": abs(held - 1.0),
        "overshoot": max(float(moved.max()) - held, 0.0),
        "stick_s": _longest_stop(
            times[under_way], moved[under_way], max(_BAND, _BAND_SIGMAS * noise)
        ),
        "hunting": math.sqrt(max(float(end.var()) - noise**2, 0.0)),
        "early": float(np.abs(smooth[: begin - WINDOW // 2]).max()),
    }


def _reached(moved: FloatArray, times: FloatArray, level: float) -> float:
    """Return the time until a way is passed, infinite where it is not [s]."""
    beyond = moved > level
    return float(times[beyond.argmax()] - times[0]) if beyond.any() else math.inf


def _longest_stop(times: FloatArray, moved: FloatArray, band: float) -> float:
    """Return the longest time within a band of way [s]."""
    longest, first = 0.0, 0
    for last in range(len(times)):
        while np.ptp(moved[first : last + 1]) > band:
            first += 1
        longest = max(longest, float(times[last] - times[first]))
    return longest
