# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When a stroke was last tested, and when the next test is due: from the event log.

Who commanded the stroke does not matter. Days are those of the data's clock, up to the last stored
cycle, so that the same history always says the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.operation.events import Event
from valve_twin.core.operation.stroke_test import StrokeVerdict

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.core.operation.stroke_test import StrokeTest

_VERDICTS = {f"stroke_test.{v.value}": v for v in (StrokeVerdict.PASS, StrokeVerdict.FAIL)}
STROKE_CODES = tuple(_VERDICTS)
"""Codes of the entries of stroke tests."""

_DAY_NS = 86_400 * 10**9


@dataclass(frozen=True, slots=True)
class StrokeDue:
    """The last stroke test of a valve.

    Attributes
    ----------
    stamp_ns : int
        When it began [ns], 0 = none is known.
    verdict : str
        pass or fail, empty = none is known.
    since_days, until_days : float
        Days since it and until the next one is due, below 0 = overdue; NaN = not known, or no
        interval is set [d].
    """

    stamp_ns: int = 0
    verdict: str = ""
    since_days: float = math.nan
    until_days: float = math.nan

    @property
    def words(self) -> str:
        """Days since and until in words; empty where no test is known."""
        if not self.stamp_ns:
            return ""
        since = f"{self.since_days:.1f} days ago"
        if math.isnan(self.until_days):
            return since
        late = self.until_days < 0.0
        return f"{since}, {'overdue by' if late else 'next in'} {abs(self.until_days):.1f} days"


def stroke_event(stamp_ns: int, found: StrokeTest) -> Event:
    """Return the entry of a stroke that was judged.

    Parameters
    ----------
    stamp_ns : int
        When its recording begins [ns].
    found : StrokeTest
        What was found; not refused.
    """
    wrong = ", ".join(f"{c.name} {c.value:.3g} of {c.limit:.3g}" for c in found.failed)
    passed = found.verdict is StrokeVerdict.PASS
    text = f"a stroke of {found.stroke:.4g} was tested: {found.verdict.value}"
    text += f", not kept: {wrong}" if wrong else ""
    status = Ne107.GOOD if passed else Ne107.FAILURE
    code = next(code for code, verdict in _VERDICTS.items() if verdict is found.verdict)
    return Event(stamp_ns, 0, code, status.value, text)


def stroke_due(events: Iterable[Event], now_ns: int, interval_days: float) -> StrokeDue:
    """Return when the last stroke test was and when the next one is due.

    Parameters
    ----------
    events : iterable of Event
        Entries of the event log; those of stroke tests count.
    now_ns : int
        End of the last cycle [ns].
    interval_days : float
        Most days between two tests, 0 = no matter [d].
    """
    tests = [e for e in events if e.code in STROKE_CODES]
    if not tests:
        return StrokeDue()
    last = max(tests, key=lambda e: (e.stamp_ns, e.id))
    since = max(now_ns - last.stamp_ns, 0) / _DAY_NS
    until = interval_days - since if interval_days > 0.0 else math.nan
    return StrokeDue(last.stamp_ns, _VERDICTS[last.code].value, since, until)
