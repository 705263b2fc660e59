# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve that does not open or close on demand: limit switches say so in every cycle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.changes.finding import LATELY, Finding
from valve_twin.core.past.columns import past_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.core.past.columns import Past
    from valve_twin.core.types import Estimate

OPENED, CLOSED = "opened", "closed"
"""Names of what an estimate says of the two ends: 1 = reached, 0 = not reached [1]."""

_LEAST = 2
"""Newest cycles in a row that miss an end: one may be a command that was too short, assumed."""

_LEAST_BEFORE = 5
_USUALLY = 0.9
"""Cycles before, and their share that reached both ends: a valve that is stroked in part usually
misses none, assumed [1]."""


def unreached(history: Iterable[Estimate] | Past, since: int = 0) -> Finding | None:
    """Return that the newest cycles miss an end which those before them reached.

    Parameters
    ----------
    history : iterable of Estimate, or Past
        Estimates of all estimators.
    since : int
        First cycle since the last maintenance, which may have mended what was missed before.

    Returns
    -------
    Finding or None
        `no_opening` or `no_closing`, by what the first of them missed; None where both ends are
        reached, or nothing tells.
    """
    rows = past_of(history).trend
    order = np.argsort(rows.end_ns, kind="stable")
    opened, closed = rows.value(OPENED)[order], rows.value(CLOSED)[order]
    told = np.isfinite(opened) | np.isfinite(closed)
    opened, closed, cycle = opened[told], closed[told], rows.cycle[order][told]
    misses = (opened == 0.0) | (closed == 0.0)
    reached = np.flatnonzero(~misses)
    first = int(reached[-1]) + 1 if len(reached) else 0
    before = misses[max(first - LATELY, 0) : first]
    first = max(first, int(np.searchsorted(cycle, since)))
    if len(misses) - first < _LEAST or len(before) < _LEAST_BEFORE:
        return None
    if float(np.mean(~before)) < _USUALLY:
        return None
    name = "no_opening" if opened[first] == 0.0 else "no_closing"
    nan = float("nan")
    alarm = int(cycle[first + _LEAST - 1])
    return Finding(name, (), "valve", nan, nan, int(cycle[first]), alarm)
