# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Entries of a valve's event log, and what a verdict that changes gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from valve_twin.core.aging.verdict import LimitState, VerdictKind
from valve_twin.core.faults.advice import FAULT_ADVICE, LIMIT_STATES, advise
from valve_twin.core.faults.ne107 import Ne107

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.aging.verdict import Trend, Verdict
    from valve_twin.core.types import Maintenance

_NO_JUDGEMENT = {VerdictKind.NOT_ENOUGH_DATA, VerdictKind.RECORDING_UNUSABLE}
"""Verdicts behind which a fault may go on: it is not said to be over."""


MOST_OF_A_LINE = 4096
"""Length of the text of an entry [characters]."""


def one_line(text: str) -> str:
    """Return a text, which may come from anybody, as one line that is not too long."""
    return " ".join(text[:MOST_OF_A_LINE].split())


@dataclass(frozen=True, slots=True)
class Event:
    """One entry of a valve's event log: the fields of Event.msg.

    Attributes
    ----------
    stamp_ns, cycle : int
        When on the data's clock [ns], and in which production cycle [1], 0 = none.
    code, status, text : str
        Stable name `area.what`, state of NAMUR NE 107, and one line.
    id, valve : int, str
        Number of the entry in the history, 0 before it is there; name of the valve.
    acknowledged, acknowledged_by, acknowledged_note : bool, str, str
        Whether somebody has seen it, who, and what he says to it.
    acknowledged_at_ns : int
        When, on the clock of who took it down [ns].
    """

    stamp_ns: int
    cycle: int
    code: str
    status: str
    text: str
    id: int = 0
    valve: str = ""
    acknowledged: bool = False
    acknowledged_by: str = ""
    acknowledged_note: str = ""
    acknowledged_at_ns: int = 0

    @property
    def is_open(self) -> bool:
        """Whether somebody has yet to acknowledge it: what is good asks nobody."""
        return not self.acknowledged and self.status != Ne107.GOOD.value


def verdict_events(verdict: Verdict, last_fault: str) -> Iterator[Event]:
    """Yield what a verdict that says something new gives: a fault that is over, then what is said.

    Parameters
    ----------
    verdict : Verdict
        The verdict.
    last_fault : str
        Fault or parameter that the last verdict named, empty = none.
    """
    status = advise(verdict).ne107.value
    at = verdict.stamp_ns, verdict.cycle
    over = last_fault and last_fault != verdict.fault and verdict.kind not in _NO_JUDGEMENT
    if over:
        text = f"{last_fault} is found no more: {verdict.text}"
        yield Event(*at, f"healed.{last_fault}", Ne107.GOOD.value, text)
    said = one_line(f"{verdict.text}: {verdict.evidence}")
    if verdict.fault:
        area = "fault" if verdict.fault in FAULT_ADVICE else "limit"
        code = f"{area}.{verdict.fault}"
    else:
        code = f"verdict.{verdict.kind.name.lower()}"
    yield Event(*at, code, status, said)


def limit_code(state: LimitState, parameter: str) -> str:
    """Return the code of the entry of a parameter that comes to a state of its limits."""
    return f"limit_{state.text}.{parameter}"


def limit_event(trend: Trend, last: LimitState, cycle: int = 0) -> Event | None:
    """Return the entry of a trend whose state differs from the last known one; None where not.

    Parameters
    ----------
    trend : Trend
        What is said now.
    last : LimitState
        What was said last; a parameter that was never said to be beyond a limit is within.
    cycle : int
        The last in the trend [1], 0 = not known.
    """
    state = trend.limit_state
    if state in (LimitState.NONE, last or LimitState.WITHIN):
        return None
    limits = f"warning limit {trend.warning:.4g}, service limit {trend.threshold:.4g}"
    unit = "" if trend.unit == "1" else f" {trend.unit}"
    text = f"{trend.parameter} {state.text}: level {trend.level:.4g}{unit}, {limits}"
    status = LIMIT_STATES[state].value
    return Event(trend.stamp_ns, cycle, limit_code(state, trend.parameter), status, one_line(text))


def maintenance_event(mark: Maintenance) -> Event:
    """Return the entry of a maintenance event that was marked or withdrawn."""
    done, why = ("withdrawn", mark.withdrawn_note) if mark.withdrawn else ("marked", mark.note)
    return Event(mark.stamp_ns, mark.cycle, f"maintenance.{done}", Ne107.GOOD.value, one_line(why))


def start_event(stamp_ns: int, cycle: int, software: str) -> Event:
    """Return the entry of a twin that starts.

    Parameters
    ----------
    stamp_ns : int
        When, on the node's clock [ns].
    cycle : int
        Number of the last stored cycle [1].
    software : str
        Its version.
    """
    text = f"the twin starts, version {software}; the last stored cycle is {cycle}"
    return Event(stamp_ns, cycle, "twin.start", Ne107.GOOD.value, text)
