# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Name a fault of any valve by what explains the motion of its cycles.

What raised the alarm are features, and their signatures name it roughly: in a valve that is not
the simulated one several faults change the same features. The cycles themselves say it better:
which fault, put on the model's response, gives what was measured since, and did not before.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.generic.explained import EXPLAINED, NAMED
from valve_twin.core.diagnosis.table import BY_NAME

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.diagnosis.changes.finding import Finding
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.past.columns import Rows
    from valve_twin.core.types import FloatArray, IntArray

_KEPT = ("sensor_freeze", "sensor_noise", "sensor_offset", "no_motion", "saturation")
"""Faults that are named by what they are, not by a motion; a level says nothing here."""

_LEAST_BEFORE = 3
"""Fewest cycles before a fault that say what it explains without it."""

_ERRORS = 2.0
"""Standard errors by which a fault must explain more than before, assumed [1]."""

_LEAST = 0.2
"""Least by which it must explain more, as a logarithm: a fifth of what is left, assumed [1]."""

_BETTER = 3.0
"""By how much more it must explain than the fault that the signatures name, assumed [1]."""

_NEAR = 0.7
"""Share of what the best explains from which on another one may be it as well, assumed [1]."""


def explained_in(rows: Rows) -> FloatArray:
    """Return how much each of `NAMED` explains in each cycle, (N, K) [1]; NaN where not known."""
    return np.column_stack([rows.usable(f"{EXPLAINED}{n}") for n in NAMED])


def renamed(
    findings: Sequence[Finding],
    cycles: IntArray,
    vectors: FloatArray,
    shown: FloatArray,
    table: SignatureTable,
    config: DetectionConfig,
    restarts: Sequence[int] = (),
) -> tuple[Finding, ...]:
    """Return faults of one product with the names that explain the motion of their cycles.

    Parameters
    ----------
    findings : sequence of Finding
        Faults, named by their signatures.
    cycles : (N,) int array
        Cycle numbers, rising.
    vectors : (N, F) array
        Features as they are followed [unit by feature].
    shown : (N, K) array
        How much each of `NAMED` explains, as a logarithm [1]; NaN where not known.
    table : SignatureTable
        Signatures of the valve's faults.
    config : DetectionConfig
        How many cycles name a fault.
    restarts : sequence of int
        Cycle numbers of maintenance.
    """
    free = np.ones(len(cycles), dtype=np.bool_)
    for f in findings:
        free &= (cycles < f.onset) | ((cycles >= f.end) if f.end >= 0 else False)
    known = np.array([n in table.faults for n in NAMED])
    named = []
    for f in findings:
        since = max((c for c in restarts if c <= f.onset), default=0)
        until = f.end if f.end >= 0 else np.inf
        before = np.flatnonzero(free & (cycles >= since) & (cycles < f.onset))[-config.settled :]
        with_it = np.flatnonzero((cycles >= f.onset) & (cycles < until))[: config.isolate + 1]
        with_it = with_it[1:] if len(with_it) > 1 else with_it  # that of the onset is a mixture
        more = np.where(known, _more(shown[before], shown[with_it]), -np.inf)
        named.append(_named(f, more, vectors[before], vectors[with_it], table))
    return tuple(named)


def _named(
    finding: Finding,
    more: FloatArray,
    before: FloatArray,
    with_it: FloatArray,
    table: SignatureTable,
) -> Finding:
    """Return a fault by what explains (K,) more since it began; features before and with it."""
    best = int(np.argmax(more))
    now = more[NAMED.index(finding.fault)] if finding.fault in NAMED else 0.0
    if finding.fault in _KEPT:
        return finding
    if not more[best] > max(_LEAST, _BETTER * now):
        return _beside(finding, more) if now > _LEAST else finding
    name, near = NAMED[best], more > _NEAR * more[best]
    rivals = tuple(n for k, n in enumerate(NAMED) if near[k] and k != best)
    change = _mean(with_it) - _mean(before)
    part, size = BY_NAME[name].part, _size(name, change, table)
    return replace(finding, fault=name, rivals=rivals, part=part, severity=size)


def _beside(finding: Finding, more: FloatArray) -> Finding:
    """Return a fault with those beside it that explain (K,) nearly as much or more."""
    least = _NEAR * more[NAMED.index(finding.fault)]
    others = (NAMED[k] for k in np.argsort(-more) if more[k] > least)
    rivals = dict.fromkeys((*finding.rivals, *(n for n in others if n != finding.fault)))
    return replace(finding, rivals=tuple(rivals))


def _more(before: FloatArray, with_it: FloatArray) -> FloatArray:
    """Return by how much each fault explains more than before, less its standard errors, (K,)."""
    then, now = (rows[np.isfinite(rows).all(axis=1)] for rows in (before, with_it))
    if len(then) < _LEAST_BEFORE or not len(now):
        return np.full(len(NAMED), -np.inf)
    error = then.std(axis=0, ddof=1) * np.sqrt(1.0 / len(then) + 1.0 / len(now))
    return np.asarray(now.mean(axis=0) - then.mean(axis=0) - _ERRORS * error)


def _mean(rows: FloatArray) -> FloatArray:
    """Return the mean of each feature over the cycles that show it, (F,); NaN where none does."""
    known = np.isfinite(rows)
    total, count = np.where(known, rows, 0.0).sum(axis=0), known.sum(axis=0)
    return np.where(count, total / np.maximum(count, 1), np.nan)


def _size(name: str, change: FloatArray, table: SignatureTable) -> float:
    """Return the size of a fault whose signatures are nearest to a change of features (F,)."""
    spread = table.least()
    known = np.isfinite(change) & (spread > 0.0)
    off = change[known] / spread[known]
    found: list[tuple[float, float]] = []
    for k, signature in enumerate(table.signatures):
        if signature.fault == name:
            ray = np.array(signature.change)[known] / spread[known]
            size = float(np.clip((ray @ off) / max(float(ray @ ray), 1e-300), *table.range(k)))
            left = float(np.sum((off - size * ray) ** 2))
            found.append((left, signature.severity * size))
    size = min(found)[1]
    return size if size else float("nan")
