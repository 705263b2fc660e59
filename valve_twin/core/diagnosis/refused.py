# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What cycles that gave no estimate say of a valve."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.changes.finding import CLOCK, FRESH, Finding, Stale
from valve_twin.core.diagnosis.features import NOISE
from valve_twin.core.diagnosis.generic.hidden import is_hidden
from valve_twin.core.diagnosis.generic.programs import asked
from valve_twin.core.past.columns import past_of
from valve_twin.core.types import EstimateStatus

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.past.columns import Past, Rows
    from valve_twin.core.types import Estimate, IntArray

LEAST_REFUSED = 5
"""Newest cycles in a row without an estimate after which what was said before is withdrawn."""

_CAME_LAST = 4 * LEAST_REFUSED  # features among which those of the newest cycles usually are
_LEAST_USUAL = 5
_OVERDUE = 2.5  # usual lengths of a cycle in which nothing answered the command, assumed
_STILL = 0.1  # share of the usual stroke below which a cycle did not move, assumed
_LEAST_STILL = 2  # still cycles in a row that are no accident, assumed
_FROZEN = 0.999  # share of samples that repeat the one before: not even noise is left, assumed


_ONE_CAUSE = 5
"""Cycles within which a fault and that nothing moves any more have one cause, assumed."""

_SAYS_IT = ("command_loss", "sensor_freeze", "no_motion")
"""Faults that say why nothing moves."""


def refused_lately(history: Iterable[Estimate] | Past) -> Stale:
    """Return why the newest cycles say nothing.

    Parameters
    ----------
    history : iterable of Estimate, or Past
        Estimates of all estimators.
    """
    rows = past_of(history).trend
    newest = _newest_refused(rows)
    if len(newest) < LEAST_REFUSED:
        return FRESH
    unusable = bool(rows.implausible[newest[-LEAST_REFUSED:]].all())
    reason = rows.reasons[int(rows.key[newest[-1]])]
    why = f"the newest {len(newest)} cycles gave no estimate: {reason}"
    return Stale(why, unusable, int(rows.cycle[newest[0]]))


def featureless(rows: Rows, features: Rows) -> str:
    """Return that the newest cycles show no features, so that no fault is seen; "" = they do.

    Parameters
    ----------
    rows : Rows
        The estimates that feed the trend, one a cycle, in the order of time.
    features : Rows
        The features of cycles, in any order; those that came last are looked at first.
    """
    newest = rows.end_ns[-LEAST_REFUSED:]
    if len(newest) < LEAST_REFUSED:
        return ""
    for last in (_CAME_LAST, len(features)):
        end_ns, status = features.end_ns[-last:], features.status[-last:]
        theirs = np.isin(end_ns, newest)
        if len(np.unique(end_ns[theirs])) == len(newest):
            break
    else:  # they are not asked for
        return ""
    if (status[theirs] != EstimateStatus.REFUSED).any():
        return ""
    return (
        f"the newest {LEAST_REFUSED} cycles show no features, so nothing is said of sudden "
        "faults: too few samples, or more than 1 % of them are missing"
    )


def still(history: Iterable[Estimate] | Past) -> Finding | None:
    """Return that nothing moves: the newest cycles were refused, and their position stayed.

    One such cycle is enough where it did not end either. Cycles that ask for no motion tell
    nothing.

    Parameters
    ----------
    history : iterable of Estimate, or Past
        Estimates of all estimators.

    Returns
    -------
    Finding or None
        `sensor_freeze` where not even the noise is left that was there, else `no_motion`; None
        where a newest cycle moved, or nothing is known of how far usual ones move.
    """
    past = past_of(history)
    rows = past.trend
    newest = _newest_refused(rows)
    if not len(newest):
        return None
    stroke, length = rows.condition("stroke"), rows.end_ns - rows.start_ns
    before = rows.cycle < rows.cycle[newest[0]]
    usual = stroke[before & rows.given]
    usual = usual[usual > 0.0]
    if len(usual) < _LEAST_USUAL:
        return None
    moved = ~(stroke[newest[::-1]] < _STILL * np.median(usual))
    run = newest[::-1][: int(np.argmax(moved)) if moved.any() else len(moved)]
    run = run[asked(past.features, rows.cycle[run], int(rows.cycle[newest[0]]))]
    late = length[run] > _OVERDUE * np.median(length[before])
    overdue = len(run) and bool(late[0])
    if not overdue and len(run) < _LEAST_STILL:
        return None
    cycle = rows.cycle[run]
    repeats = past.features.value("repeats")[np.isin(past.features.cycle, cycle)]
    repeats = repeats[repeats >= 0.0]
    frozen = bool(len(repeats)) and bool(repeats.min() > _FROZEN)
    frozen = frozen and not (overdue and _is_noiseless(past.features, int(rows.cycle[newest[0]])))
    rivals: tuple[str, ...] = ()
    if frozen and is_hidden(past.features):
        frozen, rivals = False, ("sensor_freeze",)
    name, part = ("sensor_freeze", "sensor") if frozen else ("no_motion", "valve")
    size = 1.0 if frozen else float("nan")
    alarm = cycle[-1] if late[-1] else cycle[-_LEAST_STILL]  # the first that told it
    return Finding(name, rivals, part, size, float("nan"), int(cycle[-1]), int(alarm))


def with_still(findings: Sequence[Finding], stuck: Finding | None) -> tuple[Finding, ...]:
    """Return faults and that nothing moves, one for one cause.

    A fault that lasts and says it is enough. One that was seen just before, of which few cycles
    were left to name it, is that nothing moves, and so are lost commands where nothing moved from
    their first cycle on; clocks that run apart are something else.

    Parameters
    ----------
    findings : sequence of Finding
        Faults that features show.
    stuck : Finding or None
        What the newest cycles show that were refused, see `still`.
    """
    if stuck is None:
        return tuple(findings)
    near = [
        f
        for f in findings
        if f.end < 0 and f.fault != CLOCK and abs(stuck.onset - f.onset) <= _ONE_CAUSE
    ]
    if any(_says_it(f, stuck) for f in near) or any(
        f.fault == stuck.fault and f.end < 0 for f in findings
    ):
        return tuple(findings)
    first = min((f.onset for f in near), default=stuck.onset)
    alarm = min((stuck.alarm, *(f.alarm for f in near)))
    others = (f for f in findings if f not in near)
    return (*others, replace(stuck, onset=min(first, stuck.onset), alarm=alarm))


def _says_it(fault: Finding, stuck: Finding) -> bool:
    """Return whether a fault says why nothing moves.

    Lost commands do not where nothing moved from their first cycle on, or the one behind it, whose
    first is a mixture: the spool may be stuck.
    """
    since = fault.onset >= stuck.onset - 1 and stuck.fault == "no_motion"
    return fault.fault in _SAYS_IT and not (since and fault.fault == "command_loss")


def _is_noiseless(features: Rows, cycle: int) -> bool:
    """Return whether the sensor showed no noise at rest before a cycle, so that it may show none.

    Where the command does not end either, a stuck spool then looks like a frozen sensor.
    """
    silent = ~(features.value(NOISE)[features.cycle < cycle] > 0.0)
    return len(silent) >= _LEAST_USUAL and float(np.mean(silent)) > 0.5


def _newest_refused(rows: Rows) -> IntArray:
    """Return the newest rows, all of which were refused, oldest first."""
    order = np.argsort(rows.end_ns, kind="stable")
    given = np.flatnonzero(rows.given[order])
    return np.asarray(order[given[-1] + 1 if len(given) else 0 :])
