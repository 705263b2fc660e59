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
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from valve_twin.core.diagnosis.changes.alone import departs, first_alone, passed
from valve_twin.core.diagnosis.changes.ends import (
    first_alike,
    first_unlike,
    healed,
    jumped_back,
    over,
)
from valve_twin.core.diagnosis.changes.finding import UNKNOWN, Diagnosis, Finding
from valve_twin.core.diagnosis.changes.jumps import BESIDE, BEYOND, jumps_made
from valve_twin.core.diagnosis.changes.kept import kept
from valve_twin.core.diagnosis.changes.match import Match, fits_an_end, match
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.lines import (
    Rays,
    Sums,
    filled,
    follows_nothing,
    lines_through,
    more_noise,
    more_repeats,
    strayed,
    whitened_rays,
    without_outliers,
)
from valve_twin.core.diagnosis.table import BY_NAME, SignatureTable, partner

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_OF_LARGEST = 0.3
"""Share of the largest deviation that another cycle must show: one outlier is no fault [1]."""

_ABRUPT = 0.5
"""Share of a change by which the cycles behind its onset must lie off those just before it, since
what wanders away is no sudden change; and off the mean of few cycles: they are no line yet [1]."""

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

    Returns
    -------
    Diagnosis
        Faults, oldest first.
    """
    config = config or DetectionConfig()
    looked_at, told = len(cycles), np.isfinite(vectors).any(axis=1)
    cycles, vectors = cycles[told], vectors[told]  # what shows nothing confirms nothing
    edges = [0, *sorted({int(np.searchsorted(cycles, c)) for c in restarts}), len(cycles)]
    findings: list[Finding] = []
    ready, far = False, 0.0
    for first, last in pairwise(edges):
        if last > first:
            part = slice(first, last)
            start = int(np.searchsorted(cycles[part], judged, side="right"))
            found, ready, far = _search(cycles[part], vectors[part], table, config, start)
            ready = ready or start > 0
            maintained = int(cycles[last]) if last < len(cycles) else -1
            findings += [
                f if f.end >= 0 or maintained < 0 else replace(f, end=maintained) for f in found
            ]
    newest = int(cycles[-1]) if len(cycles) else 0
    return Diagnosis(tuple(findings), looked_at, ready, departs=far, newest=newest)


def _search(
    cycles: IntArray,
    vectors: FloatArray,
    table: SignatureTable,
    config: DetectionConfig,
    start: int,
) -> tuple[list[Finding], bool, float]:
    """Return the faults between two maintenance events, whether one could be found, `departs`.

    Nothing is sought in the first `start` rows. Cycles with a fault that is over are left out:
    those before it stay the measure.
    """
    findings: list[Finding] = []
    while len(cycles) >= config.least + config.confirm:
        view, alarm = _first_seen(vectors, table, config, start)
        if alarm is None:
            return findings, len(cycles) > start, departs(*view, config)
        at = alarm[0]
        onset = _onset(*view, config, *alarm)
        finding, back, end = _isolate(view, table, config, onset, at)
        ended = _ended(view, table, config, onset, (finding, back))
        if ended is not None:
            part, fit = ended
            seen_at = int(cycles[at])
            findings.append(_finding(fit, int(cycles[part.start]), seen_at, seen_at))
            rest = np.r_[0 : part.start, part.stop : len(cycles)]
            cycles, vectors, start = cycles[rest], vectors[rest], min(start, part.start)
            continue
        repeats = more_repeats(vectors, onset, table)[onset : at + 1]
        if (repeats > 0.5).any():
            end = over(more_repeats(vectors, onset, table) > 0.5, at, config)
        seen_over = int(cycles[end]) if end >= 0 else -1
        found = _finding(finding, int(cycles[onset]), int(cycles[at]), seen_over)
        last = None if end < 0 else end - config.heal + 1
        findings.append(_gross(found, vectors, slice(onset, last), repeats, table))
        if last is None:
            return findings, True, 0.0
        rest = np.r_[0:onset, max(last, onset + 1) : len(cycles)]
        cycles, vectors, start = cycles[rest], vectors[rest], onset
    return findings, False, 0.0


View: TypeAlias = "tuple[FloatArray, FloatArray, Rays]"
"""Whitened cycles, the same without outliers, and the whitened signatures."""


def _first_seen(
    vectors: FloatArray, table: SignatureTable, config: DetectionConfig, start: int
) -> tuple[View, tuple[int, int] | None]:
    """Return what the first alarm from row `start` on was raised in, and its rows; None = none.

    Each cycle is judged by the scatter of cycles known by then: what comes later is never taken
    for the valve's own, so that an alarm once raised is raised in every longer history.
    """
    count, settled = len(vectors), config.learn + config.recent
    least = max(config.least + config.confirm, start + 1)
    for end in range(least, min(count, settled - 1) + 1):
        alarm = _early_alarm(vectors[:end], table, config)
        if alarm is not None:
            return whitened(vectors, known_by(end, config), count, table, config), alarm
    view = whitened(vectors, known_by(count, config), count, table, config)
    if count < settled:
        return view, None
    return view, first_alarm(*view, config, first=max(settled - 1, start))


@kept
def _early_alarm(
    vectors: FloatArray, table: SignatureTable, config: DetectionConfig
) -> tuple[int, int] | None:
    """Return the alarm that the last of few cycles raises, see `first_alarm`."""
    count = len(vectors)
    view = whitened(vectors, known_by(count, config), count, table, config)
    return first_alarm(*view, config, first=count - 1)


def known_by(count: int, config: DetectionConfig) -> int:
    """Return how many of the first cycles say how a valve scatters.

    Parameters
    ----------
    count : int
        Cycles that are there [1].
    config : DetectionConfig
        When to speak.
    """
    return min(config.learn, max(count - config.recent, config.least))


def whitened(
    vectors: FloatArray, known: int, end: int, table: SignatureTable, config: DetectionConfig
) -> View:
    """Return the first `end` cycles whitened by the scatter of the first `known`.

    Parameters
    ----------
    vectors : (N, F) array
        Features as they are followed [unit by feature].
    known, end : int
        Numbers of cycles.
    table : SignatureTable
        Signatures of the valve's faults.
    config : DetectionConfig
        When to speak.
    """
    y = filled(vectors[:end], config.least)
    level = y[:known].mean(axis=0)
    y -= level
    rays = whitened_rays(y[:known], np.isfinite(vectors[:end]), table, config, level=level)
    w = rays.whitened(y)
    return w, without_outliers(w, config), rays


def first_alarm(
    w: FloatArray, base: FloatArray, rays: Rays, config: DetectionConfig, *, first: int
) -> tuple[int, int] | None:
    """Return the row from `first` on that raises an alarm and that of its onset, None = none.

    Parameters
    ----------
    w, base : (N, F) arrays
        Whitened features, and the same without outliers [standard deviations].
    rays : Rays
        Whitened signatures.
    config : DetectionConfig
        When to speak.
    first : int
        First row that is judged.
    """
    total = np.concatenate((np.zeros((1, w.shape[1])), np.cumsum(w, axis=0)))
    past = Sums.of(base)
    best: tuple[int, float, int] | None = None
    for m in range(config.confirm, config.recent + 1):
        end = np.arange(config.least + m - 1, len(w))
        judged = end >= first
        if not judged.any():
            continue
        lines = past.lines(end - m, config.window)
        line, variance = lines.at(end.astype(np.float64) - 0.5 * (m - 1))
        mean = (total[end + 1] - total[end + 1 - m]) / m - line
        ratio = rays.along(mean / np.sqrt(1.0 / m + variance)[:, None])
        least = np.sqrt(config.threshold)
        if not (ratio > least).any():  # as in nearly all histories of a sound valve
            continue
        shown = ratio > least * strayed(ratio, config)
        far = np.flatnonzero(shown.any(axis=1) & judged)
        if not len(far):
            continue
        shown = shown[far] & _lasts((w, base, rays), config, end[far], m, mean[far], line[far])
        hits = np.flatnonzero(shown.any(axis=1))
        if not len(hits):
            continue
        score = float(np.where(shown, ratio[far], 0.0)[hits[0]].max())
        row = int(end[far[hits[0]]])
        if best is None or (row, -score) < (best[0], -best[1]):
            best = (row, score, m)
    alone = first_alone(w, base, rays, config, first=first)
    if alone >= 0 and (best is None or alone < best[0]):
        return alone, alone
    return None if best is None else (best[0], best[0] - best[2] + 1)


def _lasts(
    view: View,
    config: DetectionConfig,
    end: IntArray,
    m: int,
    mean: FloatArray,
    line: FloatArray,
) -> BoolArray:
    """Return along which signatures a change is sudden and shown by more than one cycle, (K, S).

    Parameters
    ----------
    view : View
        See `whitened`.
    config : DetectionConfig
        When to speak.
    end : (K,) int array
        Last rows of the changes.
    m : int
        Cycles that show each [1].
    mean, line : (K, F) arrays
        By how much they lie off the line before them in the mean, and that line there [standard
        deviations].
    """
    w, base, rays = view
    begun = end - m + 1
    off = _ABRUPT * rays.along(mean)
    made = jumps_made(rays.along(base), config.window)[begun]
    jump = rays.along(_jumps(w, base, begun, m))
    shown = (jump > off) & (jump > BEYOND * made)
    lines = lines_through(base, end - m, config.window)
    young = lines.count < config.settled
    shown &= ~young[:, None] | (rays.along(mean + line - lines.level) > off)
    cycles = np.empty((m, *shown.shape))
    for back in range(m):
        before, variance = lines.at((end - back).astype(np.float64))
        each = (w[end - back] - before) / np.sqrt(1.0 + variance)[:, None]
        cycles[back] = rays.along(each)
    least = np.maximum(config.each, _OF_LARGEST * cycles.max(axis=0))
    shown &= np.count_nonzero(cycles > least, axis=0) >= config.confirm
    return np.asarray(shown, dtype=np.bool_)


def _jumps(w: FloatArray, base: FloatArray, first: IntArray, cycles: int) -> FloatArray:
    """Return by how much the first of some cycles lie off those just before them, (K, F)."""
    after = min(cycles, BESIDE)
    begun = np.stack([w[first + k] for k in range(after)]).mean(axis=0)
    before = np.stack([base[np.maximum(first - 1 - k, 0)] for k in range(BESIDE)]).mean(axis=0)
    return np.asarray(begun - before, dtype=np.float64)


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


def _isolate(
    view: View, table: SignatureTable, config: DetectionConfig, onset: int, alarm: int
) -> tuple[Match, Match, int]:
    """Match the first cycles behind the onset, and the change the other way round.

    The last is the row where it is over, -1. The cycle of the onset is a mixture and is left out.
    """
    w, base, rays = view
    before = lines_through(base, np.array([onset - 1]), config.window)
    last = min(max(onset + config.isolate, alarm), len(w) - 1)
    rows = np.arange(min(onset, len(w) - 2) + 1, last + 1)
    if alarm == onset < last and passed(w, rays, before, onset, rows):
        rows = np.array([onset])
    line = float(before.at(np.array([rows.mean()]))[1][0])
    off = w[rows] - before.at(rows.astype(np.float64))[0]
    found = match(off, rays, table, config, line=line)
    ended = match(-off, rays, table, config, line=line)
    ends = (
        healed(w, rays.rays[found.ray], before, config, alarm),
        jumped_back(w, onset, alarm, config),
    )
    return found, ended, min((end for end in ends if end >= 0), default=-1)


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
    gains = [i for i, n in enumerate(table.features) if n.startswith("gain_")]
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
