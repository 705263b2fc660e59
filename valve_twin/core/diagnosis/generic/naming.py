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

from valve_twin.core.diagnosis.config import detection_of
from valve_twin.core.diagnosis.features import UNFOLLOWED
from valve_twin.core.diagnosis.generic.explained import EXPLAINED, NAMED
from valve_twin.core.diagnosis.generic.features import SPAN
from valve_twin.core.diagnosis.generic.hidden import HIDDEN, frozen_share, noise_of
from valve_twin.core.diagnosis.generic.stands import LOST, REGAINED
from valve_twin.core.diagnosis.table import BY_NAME

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.diagnosis.changes.finding import Finding
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.past.columns import Rows
    from valve_twin.core.types import BoolArray, FloatArray, IntArray
    from valve_twin.core.valves.interface import ValveModel

_KEPT = ("sensor_freeze", "sensor_noise", "sensor_offset", "no_motion", "saturation")
"""Faults that are named by what they are, not by a motion; a level says nothing here."""

_LEAST_BEFORE = 3
"""Fewest cycles before a fault that say what it explains without it."""

_ERRORS = 2.0
"""Standard errors by which a fault must explain more than before, assumed [1]."""

_LEAST = 0.2
"""Least by which it must explain more, as a logarithm: a fifth of what is left, assumed [1]."""

_LITTLE = 0.05
"""The same where the named fault explains no more than before: its motion is not there, and where
a model misses much any other explains little of it, assumed [1]."""

_BETTER = 3.0
"""By how much more it must explain than the fault that the signatures name, assumed [1]."""

_TELLS = 0.05
"""Least share of a change of features that the signatures of a fault must be for its size to be
told, assumed [1]."""

_NEAR = 0.7
"""Share of what the best explains from which on another one may be it as well, assumed [1]."""


_SHAPED = 1.0
"""What must explain more beside what seems to be an offset, as a logarithm, assumed [1]."""

_FROZEN = 0.5
"""Share of its size by which the repeated values of a freezing sensor rise at least [1]."""

_REPEATS, _FREEZE = "repeats", "sensor_freeze"
_ALL = 0.999
"""Share of the values that repeat where all do, assumed [1]."""

_LOST, _OFFSET = "command_loss", "sensor_offset"
_PLAY, _STICKS = "lost_motion", "sticking"

_JUMPS = 0.3
_NO_JUMPS = 0.15
"""Share of the way it lost that what sticks regains at least, what has play at most; between them
it may be either, set on own plants [1]."""


def stands_in(rows: Rows) -> FloatArray:
    """Return what cycles lost by standing still and regained, (N, 2) [span]; NaN = not known."""
    return np.column_stack([rows.usable(n) for n in (LOST, REGAINED)])


_LENGTHS = frozenset(
    {"sensor_offset", _PLAY, _STICKS, "end_stop_upper", "end_stop_lower", "oscillation"}
)
"""Faults whose size is a length."""


def named_by_motion(
    findings: Sequence[Finding],
    shown: Rows,
    own: BoolArray | slice,
    features: FloatArray,
    model: ValveModel,
    table: SignatureTable,
    *,
    restarts: Sequence[int] = (),
) -> tuple[Finding, ...]:
    """Return faults of one product with the names and sizes that the motion of its cycles gives.

    Parameters
    ----------
    findings : sequence of Finding
        Faults, named by their signatures.
    shown : Rows
        Features of all cycles (N,) as they are stored.
    own : (N,) bool array or slice
        Which cycles make the product.
    features : (K, F) array
        Features of these as they are followed [unit by feature].
    model : ValveModel
        The valve's model.
    table : SignatureTable
        Signatures of the valve's faults.
    restarts : sequence of int
        Cycle numbers of maintenance.
    """
    config, cycles = detection_of(model.feature_set), shown.cycle[own]
    ways = explained_in(shown)[own], table, config, restarts, stands_in(shown)[own]
    named = renamed(findings, cycles, features, *ways)
    named = by_repeats(named, cycles, features, table, noise_of(shown), config)
    return in_travel(named, cycles, shown.usable(SPAN)[own], model)


def by_repeats(
    findings: Sequence[Finding],
    cycles: IntArray,
    features: FloatArray,
    table: SignatureTable,
    noise: float,
    config: DetectionConfig,
) -> tuple[Finding, ...]:
    """Return faults, a sensor said to be frozen where its noise tells it.

    A sensor that repeats everything and never shows noise may be right: nothing moves.

    Parameters
    ----------
    findings : sequence of Finding
        Faults of one product, as they are named by all else.
    cycles : (N,) int array
        Cycle numbers, rising.
    features : (N, F) array
        Features as they are followed [unit by feature].
    table : SignatureTable
        Signatures of the valve's faults.
    noise : float
        Noise of the sensor over its step, NaN where not known [1].
    config : DetectionConfig
        How many cycles name a fault.
    """
    if _FREEZE not in table.faults or _REPEATS not in table.features:
        return tuple(findings)
    repeats, named = features[:, table.features.index(_REPEATS)], []
    for f in findings:
        until = f.end if f.end >= 0 else np.inf
        before = repeats[cycles < f.onset]
        with_it = repeats[(cycles >= f.onset) & (cycles < until)][: config.isolate + 1]
        with_it = with_it[1:] if len(with_it) > 1 else with_it
        before, with_it = before[np.isfinite(before)], with_it[np.isfinite(with_it)]
        if len(before) < _LEAST_BEFORE or not len(with_it):
            named.append(f)
            continue
        rivals: tuple[str, ...] = ()
        now = float(with_it.mean())
        share = frozen_share(noise, float(before.max()), now)
        if f.fault == _FREEZE and noise <= HIDDEN and now > _ALL:
            name, rivals, size = "no_motion", (_FREEZE,), float("nan")
        elif share > 0.0:
            name, size = _FREEZE, share
        else:
            named.append(f)
            continue
        part = BY_NAME[name].part
        named.append(replace(f, fault=name, rivals=rivals, part=part, severity=size))
    return tuple(named)


def in_travel(
    findings: Sequence[Finding], cycles: IntArray, spans: FloatArray, model: ValveModel
) -> tuple[Finding, ...]:
    """Return faults with lengths as shares of the travel, where they are of what cycles made.

    Features are shares of the way that the model makes in a cycle: a zero that is off by 6 % of
    the travel is 0.6 of cycles that use a tenth of it. As given where no position is a share of a
    travel, or features are the valve's own.

    Parameters
    ----------
    findings : sequence of Finding
        Faults of the valve.
    cycles : (N,) int array
        Cycle numbers, rising.
    spans : (N,) array
        Way that the model makes in each [share of the travel]; NaN where not known.
    model : ValveModel
        The valve's model.
    """
    if not (model.normalised and model.feature_set.of_any_valve):
        return tuple(findings)
    config, sized = detection_of(model.feature_set), []
    for f in findings:
        until = f.end if f.end >= 0 else np.inf
        own = spans[(cycles >= f.onset) & (cycles < until)][: config.isolate + 1]
        own = own[np.isfinite(own) & (own > 0.0)]
        of_travel = f.fault in _LENGTHS and len(own) > 0
        scale = 1.0 / float(np.mean(1.0 / own)) if of_travel else 1.0
        sized.append(replace(f, severity=f.severity * scale))
    return tuple(sized)


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
    stood: FloatArray | None = None,
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
    stood : (N, 2) array, optional
        What each cycle lost by standing still and regained [span]; NaN where not known.
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
        change = _mean(vectors[with_it]) - _mean(vectors[before])
        frozen = _repeats_more(f, vectors[before], vectors[with_it], table)
        found = _named(f, more, change, table, frozen=frozen)
        if stood is not None and found.fault in (_PLAY, _STICKS):
            jumps = _jumps(stood[before], stood[with_it])
            found = _by_jumps(found, jumps, more, change, table)
        named.append(found)
    return tuple(named)


def _named(
    finding: Finding,
    more: FloatArray,
    change: FloatArray,
    table: SignatureTable,
    *,
    frozen: bool,
) -> Finding:
    """Return a fault by what explains (K,) more since it began; `change` (F,) of the features.

    A sensor that repeats no more values than before is not frozen, an offset that comes with a
    change of shape is what makes that, and a motion that explains nothing more names no fault
    while another does.
    """
    best = int(np.argmax(more))
    shown = finding.fault in NAMED
    now = more[NAMED.index(finding.fault)] if shown else 0.0
    least = _LITTLE if shown and now <= 0.0 else _LEAST
    shaped = finding.fault == "sensor_offset" and more[best] > _SHAPED
    if finding.fault in _KEPT and frozen and not shaped:  # level and noise have no shape
        return finding
    if not more[best] > max(least, _BETTER * now):
        if finding.fault == _LOST and -np.inf < now <= 0.0:
            return _by_level(finding, change, table)
        return _beside(finding, more) if now > _LEAST else finding
    name = NAMED[best]
    part, size = BY_NAME[name].part, _size(name, change, table)
    told = replace(finding, fault=name, rivals=(), part=part, severity=size)
    return _beside(told, more)


def _by_level(finding: Finding, change: FloatArray, table: SignatureTable) -> Finding:
    """Return a loss of commands that no cycle shows as an offset, where the levels (F,) are one.

    A move counts as not followed as well where the level jumps by half of it.
    """
    if _OFFSET not in table.faults:
        return finding
    levels = np.where([n == UNFOLLOWED for n in table.features], np.nan, change)
    left, size = _nearest(_OFFSET, levels, table)
    if not left < _nearest(_LOST, levels, table)[0]:
        return finding
    return replace(finding, fault=_OFFSET, rivals=(), part=BY_NAME[_OFFSET].part, severity=size)


def _jumps(before: FloatArray, with_it: FloatArray) -> float:
    """Return which share of the way that it lost since it began is regained; (N, 2) rows [span].

    NaN where it did not lose more than before.
    """
    then, now = (rows[np.isfinite(rows).all(axis=1)] for rows in (before, with_it))
    if len(then) < _LEAST_BEFORE or not len(now):
        return float("nan")
    lost, regained = now.mean(axis=0) - then.mean(axis=0)
    error = then[:, 0].std(ddof=1) * np.sqrt(1.0 / len(then) + 1.0 / len(now))
    return float(max(regained / lost, 0.0)) if lost > _ERRORS * error else float("nan")


def _by_jumps(
    finding: Finding, jumps: float, more: FloatArray, change: FloatArray, table: SignatureTable
) -> Finding:
    """Return what sticks or has play by the share of way regained; by what explains where unsure.

    Behind it stands the other one only where it is unsure; `more` (K,) explains, `change` (F,) is
    that of the features.
    """
    play, sticks = (more[NAMED.index(n)] for n in (_PLAY, _STICKS))
    sure = jumps >= _JUMPS or jumps <= _NO_JUMPS
    if not sure and not max(play, sticks) > _LEAST:
        return finding
    name = _STICKS if (jumps >= _JUMPS if sure else sticks > play) else _PLAY
    rivals = tuple(n for n in finding.rivals if n not in (_PLAY, _STICKS))
    if name not in table.faults:
        return finding
    if not sure:
        rivals = (*rivals, _PLAY if name == _STICKS else _STICKS)
    size = finding.severity if name == finding.fault else _size(name, change, table)
    return replace(finding, fault=name, rivals=rivals, severity=size)


def _repeats_more(
    finding: Finding, before: FloatArray, with_it: FloatArray, table: SignatureTable
) -> bool:
    """Return whether a sensor that is said to freeze repeats more values, (N, F) features."""
    if finding.fault != "sensor_freeze" or _REPEATS not in table.features:
        return True
    place = table.features.index(_REPEATS)
    then, now = (rows[np.isfinite(rows[:, place]), place] for rows in (before, with_it))
    if len(then) < _LEAST_BEFORE or not len(now):
        return True
    error = then.std(ddof=1) * np.sqrt(1.0 / len(then) + 1.0 / len(now))
    least = max(_ERRORS * error, _FROZEN * finding.severity * (1.0 - then.mean()))
    return bool(now.mean() - then.mean() > least)


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
    """Return the size of a fault by a change of features (F,); NaN = its signatures tell none.

    They tell none, either, of a change that is nearly all left at the size nearest to it.
    """
    left, size = _nearest(name, change, table)
    whole = float(np.sum(_in_least(change, table)[2] ** 2))
    return size if size and left < (1.0 - _TELLS) * whole else float("nan")


def _nearest(name: str, change: FloatArray, table: SignatureTable) -> tuple[float, float]:
    """Return what the signatures of a fault leave of a change (F,) at the size nearest to it."""
    known, least, off = _in_least(change, table)
    found: list[tuple[float, float]] = []
    for k, signature in enumerate(table.signatures):
        if signature.fault == name:
            ray = np.array(signature.change)[known] / least
            size = float(np.clip((ray @ off) / max(float(ray @ ray), 1e-300), *table.range(k)))
            left = float(np.sum((off - size * ray) ** 2))
            found.append((left, signature.severity * size))
    return min(found)


def _in_least(
    change: FloatArray, table: SignatureTable
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return which features of a change (F,) are known, their least deviations, it in these."""
    spread = table.least()
    known = np.isfinite(change) & (spread > 0.0)
    return known, spread[known], change[known] / spread[known]
