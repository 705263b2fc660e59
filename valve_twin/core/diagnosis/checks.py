# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which checks the newest estimates fail: what their numbers rest on is then in doubt."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import NEXT_CYCLE
from valve_twin.core.past.columns import past_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.past.columns import Past
    from valve_twin.core.types import Estimate, Guard, Maintenance

_GRAVE = ("bounds", "identifiability", "noise at rest", "excitation", "condition number",
          "dimension", NEXT_CYCLE)  # fmt: skip
"""Beginnings of the names of checks that an estimate must pass; others only inform."""

_NEWEST = 20
_LEAST = 5
_SHARE = 0.5
"""Share of the newest cycles that must fail a check before it is told, assumed [1]."""


def begun_anew(maintenance: Sequence[Maintenance]) -> int:
    """Return the first cycle of the newest reference by maintenance, 0 = there was none."""
    return max((m.cycle for m in maintenance if m.new_reference), default=0)


def failed_checks(history: Iterable[Estimate] | Past, since: int = 0) -> str:
    """Return which grave checks at least half of the newest estimates fail, empty = none.

    Parameters
    ----------
    history : iterable of Estimate, or Past
        Estimates of all estimators; those that feed the trend count, refused ones do not.
    since : int
        First cycle that counts, by maintenance with a new reference.

    Returns
    -------
    str
        A clause for each, with the finding of the newest cycle that fails it.
    """
    rows = past_of(history).trend
    given = np.flatnonzero(rows.given & (rows.cycle >= since))
    newest = rows.key[given[np.argsort(rows.end_ns[given], kind="stable")[-_NEWEST:]]]
    if len(newest) < _LEAST:
        return ""
    failed: dict[str, list[Guard]] = {}
    for guard in (g for row in newest.tolist() for g in rows.failed.get(row, ())):
        if guard.name.startswith(_GRAVE):
            failed.setdefault(guard.name, []).append(guard)
    return "; ".join(
        f"check of {name} failed in {len(guards)} of the newest {len(newest)} cycles: "
        f"{guards[-1].reason}"
        for name, guards in failed.items()
        if len(guards) >= _SHARE * len(newest)
    )
