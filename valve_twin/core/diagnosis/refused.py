# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What cycles that gave no estimate say of a valve."""

from __future__ import annotations

from statistics import median
from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.detection import Finding
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.types import EstimateStatus

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.types import Estimate

LEAST_REFUSED = 5
"""Newest cycles in a row without an estimate after which what was said before is withdrawn."""

_LEAST_USUAL = 5
_OVERDUE = 2.5  # usual lengths of a cycle in which nothing answered the command, assumed


def refused_lately(history: Iterable[Estimate]) -> str:
    """Return why the newest cycles say nothing, empty where one of them gave an estimate.

    Parameters
    ----------
    history : iterable of Estimate
        Estimates of all estimators.
    """
    newest = _newest_refused(history)
    if len(newest) < LEAST_REFUSED:
        return ""
    return f"the newest {len(newest)} cycles gave no estimate: {newest[-1].reason}"


def overdue(history: Sequence[Estimate]) -> Finding | None:
    """Return that nothing moves: the newest cycle did not end, and its position stayed.

    Parameters
    ----------
    history : sequence of Estimate
        Estimates of all estimators.

    Returns
    -------
    Finding or None
        None where the newest cycle moved or was as long as usual.
    """
    newest = _newest_refused(history)
    if not newest or newest[-1].reason_code != RefusalCode.NO_MOTION:
        return None
    last = newest[-1]
    lengths = [_length(e) for e in history if e.used_by_trend and e.cycle < last.cycle]
    if len(lengths) < _LEAST_USUAL or _length(last) < _OVERDUE * median(lengths):
        return None
    nan = float("nan")
    return Finding("no_motion", (), "valve", nan, nan, last.cycle, last.cycle)


def _length(estimate: Estimate) -> int:
    return estimate.end_ns - estimate.start_ns


def _newest_refused(history: Iterable[Estimate]) -> list[Estimate]:
    """Return the estimates for the trend of the newest cycles, all of which were refused."""
    shown = sorted((e for e in history if e.used_by_trend), key=lambda e: e.end_ns)
    given = [i for i, e in enumerate(shown) if e.status is not EstimateStatus.REFUSED]
    return shown[given[-1] + 1 if given else 0 :]
