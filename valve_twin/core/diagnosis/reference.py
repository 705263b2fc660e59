# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether a valve's own past is a reference: enough cycles, and its first ones like those since.

What was wrong from the first cycle on does not show in any comparison with the own past. What
began or ended in the first few cycles does, when these are compared with those that follow; but
not which of the two are right. Nor does what came while the scatter was hardly known raise an
alarm, which few cycles must show: all of them on either side of a step show it later.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.changes.jumps import BEYOND
from valve_twin.core.diagnosis.changes.kept import kept
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.detection import telling
from valve_twin.core.diagnosis.direct.noise import first_quieter
from valve_twin.core.diagnosis.lines import filled, rays_of_steps
from valve_twin.core.diagnosis.table import BY_NAME
from valve_twin.core.diagnosis.watch.alarm import first_alarm
from valve_twin.core.diagnosis.watch.whitened import Whitened, known_by

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.diagnosis.changes.finding import Finding
    from valve_twin.core.diagnosis.lines import Rays
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import BoolArray, FloatArray, IntArray


class NotYet(str):
    """Why the cycles are no reference where more of them are all that is needed."""

    __slots__ = ()


_STEP = 8
"""Cycles after which the first ones are compared again: each look may err by chance."""

_FEW = 10
"""Fewest cycles that may be a reference: as many as a trend needs."""

_FEW_BESIDE = 8
"""The same where the scatter is known from other products."""

_LEAST_FIRST = 2
"""Fewest first cycles that are held against the rest."""

_STEP_SHOWN = 4.5
"""Standard deviations of a step that withholds the reference; set on strangers [1]."""

_STEP_WITHDRAWS = 6.5
"""Standard deviations of a step that withdraws it again; set on strangers [1]."""

_STEP_ALONE = 8.0
"""Those of a single step that all cycles hold and no alarm told; set on strangers [1]."""

_SUDDEN = 0.7
"""Share of a step by which the cycles on its either side must differ: aging is none [1]."""

_BESIDE = 3
"""Cycles on either side of a step that show it, and fewest that a step lies between."""

_OFF_BENT = 4.0
"""Standard deviations by which a step lies off aging that bends; set on strangers [1]."""

_OFF_AGING = (5.0, 3.5)
"""Those off aging that is straight and off one that bends, which are as much together [1]."""


def measure(
    cycles: IntArray, findings: Sequence[Finding], since: int, config: DetectionConfig
) -> IntArray:
    """Return the first cycles since a start that may be a reference.

    Those of an early fault that is over may not. Where it was there from the first cycle on they
    stay: which of the two are right is not known.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers of a product, rising.
    findings : sequence of Finding
        Faults that were found in it.
    since : int
        First cycle since start or maintenance.
    config : DetectionConfig
        How many may be.

    Returns
    -------
    (M,) int array
        Their rows.
    """
    kept = cycles >= since
    first = cycles[kept][: config.settled]
    for f in findings:
        if f.end >= 0 and len(first) and int(first[0]) < f.onset <= int(first[-1]):
            kept &= (cycles < f.onset) | (cycles >= f.end)
    return np.flatnonzero(kept)[: max(config.learn + config.recent, config.settled)]


def unnamed(cycles: IntArray, findings: Sequence[Finding], since: int) -> IntArray:
    """Return the rows of the cycles since a start in which no fault was found, (M,).

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising.
    findings : sequence of Finding
        Faults that were found.
    since : int
        First cycle since start or maintenance.
    """
    kept = cycles >= since
    for f in findings:
        kept &= (cycles < f.onset) | (cycles >= (f.end if f.end >= 0 else np.inf))
    return np.flatnonzero(kept)


def doubt_of(
    cycles: IntArray,
    vectors: FloatArray,
    table: SignatureTable,
    config: DetectionConfig | None = None,
    *,
    others: Sequence[FloatArray] | None = None,
) -> str:
    """Return why the cycles of one product are no reference, empty where they are.

    Where `others` are given, fewer than `settled` cycles are enough if none of them, first or
    last, differ from the rest by a sudden step: a change of all states that the cycles are
    compared with would show as one.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers since start or maintenance, rising.
    vectors : (N, F) array
        Features as they are followed [unit by feature].
    table : SignatureTable
        Signatures of the valve's faults.
    config : DetectionConfig, optional
        When to speak.
    others : sequence of (M, F) arrays, optional
        Features of the cycles of all other products: from step to step they scatter alike.

    Returns
    -------
    str
        One line; `NotYet` where more cycles are needed. Once the first cycles were found to
        differ, they do in every longer history.
    """
    config = config or DetectionConfig()
    told = telling(vectors)
    if told is not None:
        cycles, vectors = cycles[told], vectors[told]
    if len(cycles) < config.settled:
        if others is not None and _is_steady(vectors, others, table, config):
            return ""
        return NotYet(
            f"no reference yet: {len(cycles)} of {config.settled} cycles of this product, "
            "from which on a fault would show"
        )
    most = config.learn + config.recent
    for count in range(config.settled, min(len(cycles), most) + 1, _STEP):
        last = _last_unlike(vectors[:count], table, config)
        if last:
            return _differ(cycles, last)
    return ""


def doubt_of_step(
    cycles: IntArray,
    vectors: FloatArray,
    table: SignatureTable,
    config: DetectionConfig | None = None,
    *,
    rows: IntArray | None = None,
    left: int = -1,
) -> str:
    """Return that the cycles of one product hold a step that raised no alarm, or "".

    An alarm is raised by the newest few cycles alone, by a scatter that counts wider while few
    cycles tell it; once they are past, the step is part of the line and of the scatter. Here all
    cycles on either side of it count. Aging leads to no step off the line through all cycles,
    and what wanders or moves in steps makes other jumps beside it.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising.
    vectors : (N, F) array
        Features as they are followed [unit by feature].
    table : SignatureTable
        Signatures of the valve's faults.
    config : DetectionConfig, optional
        When to speak.
    rows : (M,) int array, optional
        Those that count, see `unnamed`: what lies behind others is no step of one cycle.
    left : int
        Number of the newest cycle behind which others were made for long, -1 = none: when no more
        come fewer must do, and what was told then stays when the product is made again.

    Returns
    -------
    str
        One line, which every longer history with the same rows says.
    """
    config = config or DetectionConfig()
    rows = np.arange(len(cycles)) if rows is None else rows
    most = min(len(rows), config.learn + config.recent)
    behind = (np.flatnonzero(np.diff(rows) > 1) + 1).tolist()
    few = int(np.searchsorted(cycles[rows], left, side="right"))
    for count in range(_FEW, most + 1):
        if few < count < config.settled:
            continue
        apart = tuple(k for k in behind if k < count)
        first = _stepped(vectors[rows[:count]], table, config, apart)
        if first:
            return _differ(cycles[rows], first)
    return ""


def doubt_of_noise(cycles: IntArray, noise: FloatArray) -> str:
    """Return that all cycles but the first few are noisier at rest, or "".

    No alarm tells it, since too few cycles came before.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers since start or maintenance, rising.
    noise : (N,) array
        Standard deviation of the position at rest [unit of the position]; NaN where unknown.
    """
    first = first_quieter(noise)
    return _differ(cycles, first) if first else ""


def _differ(cycles: IntArray, count: int) -> str:
    """Return that the first of some cycles differ from those since."""
    return (
        f"no reference: cycles {cycles[0]} to {cycles[count - 1]} differ from those since, "
        "and nothing tells which are right: look at the valve, then mark maintenance"
    )


@kept
def _stepped(
    vectors: FloatArray, table: SignatureTable, config: DetectionConfig, apart: tuple[int, ...]
) -> int:
    """Return how many of the first cycles lie a sudden and single step off the rest, 0 = none.

    `apart` are rows that do not follow the row before them.
    """
    rays = rays_of_steps([vectors], table, config)
    shown = rays.along(rays.whitened(filled(vectors, config.least)))
    count = len(shown)
    at = _parted(count)
    total, k = np.cumsum(shown, axis=0), at[:, None]
    gap = (total[-1] - total[at - 1]) / (count - k) - total[at - 1] / k
    one, two, three = (shown[j : count - _BESIDE + 1 + j] for j in range(_BESIDE))
    middle = np.maximum(np.minimum(one, two), np.minimum(np.maximum(one, two), three))
    jump = middle[at] - middle[at - _BESIDE]  # medians: one outlier is no step
    apart_from = np.abs(k - at) >= _BESIDE
    other = np.where(apart_from[:, :, None], np.abs(jump), 0.0).max(axis=1)
    sure = jump * np.sign(gap) > np.maximum(_SUDDEN * np.abs(gap), BEYOND * other)
    straight, bent = _off_aging(count) @ shown * np.sign(gap)
    sure &= (bent > _OFF_BENT) | ((straight > _OFF_AGING[0]) & (bent > _OFF_AGING[1]))
    sure &= (np.abs(k - np.array(apart)) >= _BESIDE).all(axis=1)[:, None]
    far = np.where(sure, np.abs(gap), 0.0).max(axis=1) * (at * (count - at) / count) ** 0.5
    first = int(np.argmax(far))
    return int(at[first]) if far[first] > _STEP_ALONE else 0


def _parted(count: int) -> IntArray:
    """Return how many of some cycles may lie before a step, (K,)."""
    return np.arange(_BESIDE, count - _BESIDE + 1)


@lru_cache(maxsize=64)
def _off_aging(count: int) -> FloatArray:
    """Return what (count, S) cycles are times, to tell steps off line and parabola, (2, K, count).

    Aging may bend. The K steps are those of `_parted`, the size of each is in deviations.
    """
    t = np.linspace(-1.0, 1.0, count)
    bent, _ = np.linalg.qr(np.column_stack((np.ones_like(t), t, t**2)))
    steps = np.asarray(np.arange(count) >= _parted(count)[:, None], np.float64)
    off = np.stack([steps - steps @ law @ law.T for law in (bent[:, :2], bent)])
    return np.asarray(off / np.linalg.norm(off, axis=2)[:, :, None])


def _is_steady(
    vectors: FloatArray,
    others: Sequence[FloatArray],
    table: SignatureTable,
    config: DetectionConfig,
) -> bool:
    """Return whether few cycles of a product show no sudden step.

    Once that is said, it takes a larger one to withdraw it: each look may err by chance.
    """
    known = sum(len(o) for o in others)
    beside = [o for o in others if len(o) > 1]
    steady = False
    for count in range(_FEW_BESIDE if known >= config.settled else _FEW, len(vectors) + 1):
        rays = rays_of_steps([vectors[:count], *beside], table, config)
        shown = rays.along(rays.whitened(filled(vectors[:count], config.least)))
        step = _largest_step(shown, _two_sided(table, shown.shape[1]))
        steady = step < (_STEP_WITHDRAWS if steady else _STEP_SHOWN)
        steady = steady and _would_show(rays, table, count)
    return steady


def _would_show(rays: Rays, table: SignatureTable, count: int) -> bool:
    """Return whether medium faults of at least half of the kinds would show in two cycles."""
    length = np.linalg.norm(rays.changes, axis=1) * np.sqrt(2.0 * (count - 2) / count)
    medium = [
        np.median([length[k] for k, s in enumerate(table.signatures) if s.fault == fault])
        for fault in table.faults
    ]
    return float(np.median(medium)) > _STEP_SHOWN


def _two_sided(table: SignatureTable, number: int) -> BoolArray:
    """Return which of some rays are of faults that come in both directions, (S,)."""
    either = np.zeros(number, dtype=np.bool_)  # the last may be that of a noisier sensor
    either[: len(table.signatures)] = [BY_NAME[s.fault].two_sided for s in table.signatures]
    return either


def _largest_step(shown: FloatArray, either: BoolArray) -> float:
    """Return the largest sudden step between some first of (N, S) cycles and the rest [1].

    Any number of first cycles is held against the rest along every signature; the way back along
    one of a fault that comes in one direction counts only where it is one of `either`, (S,).
    """
    count, largest = len(shown), 0.0
    total = np.cumsum(shown, axis=0)
    for k in range(_LEAST_FIRST, count):
        gap = (total[-1] - total[k - 1]) / (count - k) - total[k - 1] / k
        beside = shown[k : k + _BESIDE].mean(axis=0) - shown[max(k - _BESIDE, 0) : k].mean(axis=0)
        sudden = beside * np.sign(gap) > _SUDDEN * np.abs(gap)
        sudden &= either | (gap > 0.0)
        far = np.where(sudden, np.abs(gap), 0.0).max() * np.sqrt(k * (count - k) / count)
        largest = max(largest, float(far))
    return largest


@kept
def _last_unlike(vectors: FloatArray, table: SignatureTable, config: DetectionConfig) -> int:
    """Return how many of the first cycles lie off the line through those that follow, 0 = none."""
    back = vectors[::-1].copy()
    seen = Whitened(back, known_by(len(back), config), table, config)
    alarm = first_alarm(seen, config, first=len(back) - config.recent)
    return len(back) - alarm[1] if alarm is not None else 0
