# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What cycles that gave no estimate say of a valve."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.detection import Finding
from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.types import EstimateStatus

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.types import Estimate

LEAST_REFUSED = 5
"""Newest cycles in a row without an estimate after which what was said before is withdrawn."""

_LEAST_USUAL = 5
_OVERDUE = 2.5  # usual lengths of a cycle in which nothing answered the command, assumed
_STILL = 0.1  # share of the usual stroke below which a cycle did not move, assumed
_LEAST_STILL = 2  # still cycles in a row that are no accident, assumed
_FROZEN = 0.999  # share of samples that repeat the one before: not even noise is left, assumed


@dataclass(frozen=True, slots=True)
class Stale:
    """Why the newest cycles say nothing: an empty `reason` = they do.

    `unusable` where the signals themselves are why: they cannot be those of a valve, or are too
    coarse.
    """

    reason: str = ""
    unusable: bool = False


FRESH = Stale()
"""The newest cycles say something."""


def refused_lately(history: Iterable[Estimate]) -> Stale:
    """Return why the newest cycles say nothing.

    Parameters
    ----------
    history : iterable of Estimate
        Estimates of all estimators.
    """
    newest = _newest_refused(history)
    if len(newest) < LEAST_REFUSED:
        return FRESH
    unusable = all(e.reason_code == RefusalCode.IMPLAUSIBLE for e in newest[-LEAST_REFUSED:])
    why = f"the newest {len(newest)} cycles gave no estimate: {newest[-1].reason}"
    return Stale(why, unusable)


def still(history: Sequence[Estimate]) -> Finding | None:
    """Return that nothing moves: the newest cycles were refused, and their position stayed.

    One such cycle is enough where it did not end either.

    Parameters
    ----------
    history : sequence of Estimate
        Estimates of all estimators.

    Returns
    -------
    Finding or None
        `sensor_freeze` where not even noise is left, else `no_motion`; None where a newest cycle
        moved, or nothing is known of how far usual ones move.
    """
    newest = _newest_refused(history)
    if not newest:
        return None
    before = [e for e in history if e.used_by_trend and e.cycle < newest[0].cycle]
    usual = [_stroke(e) for e in before if e.status is not EstimateStatus.REFUSED]
    usual = [stroke for stroke in usual if stroke > 0.0]
    if len(usual) < _LEAST_USUAL:
        return None
    run: list[Estimate] = []
    for e in reversed(newest):
        if not _stroke(e) < _STILL * median(usual):
            break
        run.append(e)
    overdue = run and _length(run[0]) > _OVERDUE * median(_length(e) for e in before)
    if not overdue and len(run) < _LEAST_STILL:
        return None
    cycle = {e.cycle for e in run}
    features = [e for e in history if e.estimator == ESTIMATOR and e.cycle in cycle]
    repeats = [e.value("repeats") for e in features]
    frozen = min((r for r in repeats if r >= 0.0), default=0.0) > _FROZEN
    name, part = ("sensor_freeze", "sensor") if frozen else ("no_motion", "valve")
    size = 1.0 if frozen else float("nan")
    return Finding(name, (), part, size, float("nan"), run[-1].cycle, run[0].cycle)


def _stroke(estimate: Estimate) -> float:
    """Return how far the position ran in a cycle [1], NaN = not known."""
    return next((c.value for c in estimate.conditions if c.name == "stroke"), float("nan"))


def _length(estimate: Estimate) -> int:
    return estimate.end_ns - estimate.start_ns


def _newest_refused(history: Iterable[Estimate]) -> list[Estimate]:
    """Return the estimates for the trend of the newest cycles, all of which were refused."""
    shown = sorted((e for e in history if e.used_by_trend), key=lambda e: e.end_ns)
    given = [i for i, e in enumerate(shown) if e.status is not EstimateStatus.REFUSED]
    return shown[given[-1] + 1 if given else 0 :]
