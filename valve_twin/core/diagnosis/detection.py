# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find sudden changes of a valve's features against its own aging, and name the fault.

Each cycle is compared with the line through the features of the cycles before it, so that aging
is no fault. What is left is whitened by the valve's own scatter and projected on the signatures:
the generalised likelihood ratio of "a fault of unknown size since m cycles" over "only aging".
An alarm needs a ratio beyond chance in a thousand years and two cycles among the last eight that
each show it, or one that the valve's own past could not give (`changes.alone`).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.changes.alone import passed
from valve_twin.core.diagnosis.changes.beyond import nearer_before
from valve_twin.core.diagnosis.changes.ends import (
    first_alike,
    first_unlike,
    healed,
    jumped_back,
    over,
)
from valve_twin.core.diagnosis.changes.finding import UNKNOWN, Diagnosis, Finding
from valve_twin.core.diagnosis.changes.match import Match, fits_an_end, match
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.lines import (
    Rays,
    filled,
    follows_nothing,
    more_noise,
    more_repeats,
)
from valve_twin.core.diagnosis.table import BY_NAME, SignatureTable, partner
from valve_twin.core.diagnosis.watch.alarm import Named, Step
from valve_twin.core.diagnosis.watch.memory import Found, Memory, Part, Record
from valve_twin.core.diagnosis.watch.straight import lines_through

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.diagnosis.watch.alarm import Alarm, Seen
    from valve_twin.core.diagnosis.watch.whitened import View
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_BEHIND = 16
"""Cycles behind those that tell whether a fault is over from which on that is not asked again."""

RIVAL = 6.0
"""Difference of twice the log likelihood below which two faults are not distinguished [1]."""

PAIR_RIVAL = 2.0
"""The same beside a pair that no data tell apart, of which both are named [1]."""


def detect(
    cycles: IntArray,
    vectors: FloatArray,
    table: SignatureTable,
    config: DetectionConfig | None = None,
    *,
    restarts: Sequence[int] = (),
    judged: int = -1,
    memory: Memory | None = None,
) -> Diagnosis:
    """Find the faults in a history of features; a pure function of it.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising.
    vectors : (N, F) array
        Features as they are followed [unit by feature]; NaN where a cycle does not show one.
    table : SignatureTable
        Signatures of the valve's faults.
    config : DetectionConfig, optional
        When to speak.
    restarts : sequence of int
        Cycle numbers of maintenance: what was before is no measure for what comes after.
    judged : int
        Number of the last cycle in which nothing is sought any more: it is only a measure.
    memory : Memory, optional
        What was found before in the first of these cycles: saves time and changes nothing.

    Returns
    -------
    Diagnosis
        Faults, oldest first.
    """
    config, memory = config or DetectionConfig(), memory or Memory()
    looked_at = len(cycles)
    told = telling(vectors)
    if told is not None:
        cycles, vectors = cycles[told], vectors[told]  # what shows nothing confirms nothing
    edges = [0, *sorted({int(np.searchsorted(cycles, c)) for c in restarts}), len(cycles)]
    findings: list[Finding] = []
    ready, far = False, 0.0
    for first, last in pairwise(edges):
        if last > first:
            part = slice(first, last)
            start = int(np.searchsorted(cycles[part], judged, side="right"))
            record = Record(cycles[part], vectors[part], table, config, start)
            found, ready, far = memory.of(first).found(record, _search)
            ready = ready or start > 0
            maintained = int(cycles[last]) if last < len(cycles) else -1
            findings += [
                f if f.end >= 0 or maintained < 0 else replace(f, end=maintained) for f in found
            ]
    memory.keep(edges)
    newest = int(cycles[-1]) if len(cycles) else 0
    return Diagnosis(tuple(findings), looked_at, ready, departs=far, newest=newest)


def telling(vectors: FloatArray) -> BoolArray | None:
    """Return which cycles show anything, None = all do.

    Parameters
    ----------
    vectors : (N, F) array
        Features as they are followed [unit by feature]; NaN where a cycle does not show one.
    """
    for column in vectors.T:
        if np.isfinite(column).all():
            return None
    told = np.isfinite(vectors).any(axis=1)
    return None if told.all() else np.asarray(told, dtype=np.bool_)


def _search(record: Record, memory: Part) -> Found:
    """Return the faults between two maintenance events, whether one could be found, `departs`.

    Nothing is sought in the first `start` rows. Cycles with a fault that is over are left out:
    those before it stay the measure.
    """
    cycles, vectors, table, config, start = record
    findings: list[Finding] = []
    while len(cycles) >= config.least + config.confirm:
        seen = memory.seen(len(findings), vectors, table, config, start)
        alarm = seen.alarm
        if alarm is None:
            return findings, len(cycles) > start, seen.departs()
        step = seen.step or _step(seen, cycles, vectors, table, config)
        findings.append(step.finding)
        if step.last is None:
            return findings, True, 0.0
        rest = np.r_[0 : step.first, step.last : len(cycles)]
        cycles, vectors, start = cycles[rest], vectors[rest], step.start
    return findings, False, 0.0


def _step(
    seen: Seen,
    cycles: IntArray,
    vectors: FloatArray,
    table: SignatureTable,
    config: DetectionConfig,
) -> Step:
    """Return the fault that raised the first alarm, and the rows that it takes."""
    assert seen.alarm is not None
    view, at = seen.whitened.view, seen.alarm[0]
    named = seen.named or _named(view, table, config, seen.alarm)
    onset, finding, back = named
    settled = len(vectors) > max(onset + config.isolate, at) + config.confirm
    seen.named = named if settled else None
    ended = _ended(view, table, config, onset, (finding, back))
    every = len(vectors) > at + config.extrapolate + config.heal + config.recent + _BEHIND
    if ended is not None:
        part, fit = ended
        seen_at = int(cycles[at])
        found = _finding(fit, int(cycles[part.start]), seen_at, seen_at)
        step = Step(found, part.start, part.stop, min(seen.start, part.start))
    else:
        near = nearer_before(vectors, table, config, seen.alarm)
        end = -1 if seen.lasts else _over(view, config, named, at, near)
        seen.lasts = every and end < 0
        repeats = more_repeats(vectors, onset, table)
        if (repeats[onset : at + 1] > 0.5).any():
            end = over(repeats > 0.5, at, config)
        seen_over = int(cycles[end]) if end >= 0 else -1
        found = _finding(finding, int(cycles[onset]), int(cycles[at]), seen_over)
        last = None if end < 0 else end - config.heal + 1
        found = _gross(found, vectors, slice(onset, last), repeats[onset : at + 1], table)
        step = Step(found, onset, None if last is None else max(last, onset + 1), onset)
    seen.step = step if every and step.last is not None else None
    return step


def _onset(
    w: FloatArray, base: FloatArray, rays: Rays, config: DetectionConfig, alarm: int, first: int
) -> int:
    """Return the first row since when, up to the alarm, most rows show half the change."""
    early = max(alarm - config.recent, config.least - 1)
    line = lines_through(base, np.array([min(early, first - 1)]), config.window)
    rows = np.arange(early + 1, min(alarm + config.confirm, len(w)))
    off = w[rows] - line.at(rows.astype(np.float64))[0]
    newest = off[-config.confirm :].mean(axis=0)
    shown = off @ rays.rays[int(np.argmax(rays.rays @ newest))]
    half = 0.5 * float(np.median(shown[-config.confirm :]))
    marked = shown[: alarm - early] >= half
    share = np.cumsum(marked[::-1])[::-1] / np.arange(len(marked), 0, -1)
    since = np.flatnonzero(marked & (share >= 0.5))
    return early + 1 + int(since[0]) if len(since) else alarm


def _named(view: View, table: SignatureTable, config: DetectionConfig, raised: Alarm) -> Named:
    """Match the first cycles behind the onset, and the change the other way round.

    The cycle of the onset is a mixture and is left out.
    """
    w, base, rays = view
    alarm, onset = raised[0], _onset(*view, config, *raised)
    before = lines_through(base, np.array([onset - 1]), config.window)
    last = min(max(onset + config.isolate, alarm), len(w) - 1)
    rows = np.arange(min(onset, len(w) - 2) + 1, last + 1)
    if alarm == onset < last and passed(w, rays, before, onset, rows):
        rows = np.array([onset])
    line = float(before.at(np.array([rows.mean()]))[1][0])
    off = w[rows] - before.at(rows.astype(np.float64))[0]
    found = match(off, rays, table, config, line=line)
    return Named(onset, found, match(-off, rays, table, config, line=line))


def _over(
    view: View, config: DetectionConfig, named: Named, alarm: int, near: BoolArray | None
) -> int:
    """Return the row where a change is over, -1 = it lasts; `near` are rows that may be back."""
    w, base, rays = view
    before = lines_through(base, np.array([named.onset - 1]), config.window)
    ends = (
        healed(w, rays.rays[named.found.ray], before, config, alarm, near),
        jumped_back(w, named.onset, alarm, config),
    )
    return min((end for end in ends if end >= 0), default=-1)


def _ended(
    view: View,
    table: SignatureTable,
    config: DetectionConfig,
    onset: int,
    fits: tuple[Match, Match],
) -> tuple[slice, Match] | None:
    """Return the rows of a fault whose end a change is, and what it was; None = it is none.

    Only in the first `settled` cycles, of which none are known to be right. `fits` are those of
    the change and of the change the other way round.
    """
    w, _, rays = view
    if onset >= config.settled:
        return None
    first, last = first_alike(w, onset), onset
    if not first:
        if fits_an_end(*fits, config, least=RIVAL):
            return slice(0, onset), fits[1]
        last = first_unlike(w, onset)
    if not last:
        return None
    right = np.vstack((w[:first], w[last + 1 :][: config.recent]))
    off = w[min(first + 1, last - 1) : last] - right.mean(axis=0)
    return slice(first, last), match(off, rays, table, config, line=1.0 / len(right))


def _gross(
    found: Finding,
    vectors: FloatArray,
    later: slice,
    repeats: FloatArray,
    table: SignatureTable,
) -> Finding:
    """Name what takes most features away: a frozen sensor, gains fallen to less than a tenth."""
    before, after = vectors[: later.start], vectors[later]
    newest = after[-1]
    gains = [table.features.index(name) for name in table.gains]
    fallen = newest[gains] - np.median(filled(before, len(before))[:, gains], axis=0)
    fallen = fallen[np.isfinite(fallen)]
    noise = 0.0 if "sensor_noise" in table.faults else more_noise(before, after, table)
    if repeats.max() > 0.5:
        name, severity = "sensor_freeze", float(repeats.max())
    elif noise > 0.0:
        name, severity = "sensor_noise", noise
    elif (len(fallen) and fallen.max() < -np.log(10.0)) or follows_nothing(after, table):
        name, severity = "no_motion", float("nan")
    else:
        return found
    return replace(found, fault=name, rivals=(), part=BY_NAME[name].part, severity=severity)


def _finding(fit: Match, onset: int, alarm: int, end: int) -> Finding:
    """Name the fault."""
    names = sorted(fit.likelihood, key=lambda name: -fit.likelihood[name])
    best, other = names[0], partner(names[0])
    behind = {n: fit.likelihood[best] - fit.likelihood[n] for n in names[1:]}
    near = RIVAL if not other else PAIR_RIVAL
    also = (n for n in behind if behind[n] < near)
    rivals = tuple(dict.fromkeys(n for n in (other, *also) if n))
    if fit.is_unknown(DetectionConfig()):
        return Finding(UNKNOWN, (), "valve", float("nan"), fit.deviation, onset, alarm, end)
    return Finding(
        best, rivals, BY_NAME[best].part, fit.severity, fit.deviation, onset, alarm, end
    )
