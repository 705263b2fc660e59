# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults as records that can be filed: code, severity, debounce, first and last time, count.

A fault is reported while its condition lasts, or once an event. It is pending until it has been
reported often and long enough (confirm), then confirmed, and healed when nothing was reported for
long enough (heal). The count rises with each confirmation, not with each report. Nothing here
reads a clock: the time is an argument.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from math import isinf
from typing import TYPE_CHECKING

from valve_twin.core.faults.ne107 import NODE_FAULTS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.core.faults.ne107 import Ne107


class Severity(IntEnum):
    """How grave a fault is; the numbers are those of diagnostic_msgs/DiagnosticStatus."""

    WARN = 1
    ERROR = 2
    STALE = 3


class Status(Enum):
    """Where a fault stands."""

    PENDING = "pending"
    CONFIRMED = "confirmed"
    HEALED = "healed"


@dataclass(frozen=True, slots=True)
class FaultKind:
    """What is known of a fault beforehand.

    Attributes
    ----------
    code : str
        Stable name, area.what; never reused for something else.
    severity : Severity
        How grave.
    meaning, remedy : str
        What it says and what to do, one sentence each.
    confirm_s : float
        Reported for at least this long before it is confirmed [s].
    confirm_count : int
        Reported at least this often, events counted, before it is confirmed [1].
    heal_s : float
        Healed when it was not reported for this long; infinite = when it is seen to be absent [s].
    state : Ne107, optional
        State of NAMUR NE 107 of a fault of the valve that is named; None = that of the code.
    failure_mode, cause : str
        Code of ISO 14224 and the most probable cause of such a fault; empty = a fault of a node.
    """

    code: str
    severity: Severity
    meaning: str
    remedy: str
    confirm_s: float = 0.0
    confirm_count: int = 1
    heal_s: float = 2.0
    state: Ne107 | None = None
    failure_mode: str = ""
    cause: str = ""

    @property
    def ne107(self) -> Ne107:
        """State of NAMUR NE 107: of the valve where its fault is named, else by the code."""
        return NODE_FAULTS[self.code] if self.state is None else self.state


@dataclass(frozen=True, slots=True)
class Moment:
    """A time on two clocks: `steady_s` for debounce [s], `stamp_ns` for the record [ns]."""

    steady_s: float
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of one thing.

    Attributes
    ----------
    kind : FaultKind
        What is known of it.
    unit : str
        The valve it belongs to, empty = the node itself.
    subject : str
        What has it: a topic, a signal or nothing.
    status : Status
        Where it stands.
    evidence : str
        What was seen, with figures, at the last report.
    first_ns, last_ns : int
        When it was first and last seen [ns].
    count : int
        How often it was confirmed.
    events : int
        How many events were reported in all.
    """

    kind: FaultKind
    unit: str
    subject: str
    status: Status
    evidence: str
    first_ns: int
    last_ns: int
    count: int = 0
    events: int = 0

    @property
    def is_active(self) -> bool:
        """Whether it is confirmed and not healed."""
        return self.status is Status.CONFIRMED

    @property
    def key(self) -> str:
        """Code and subject, the name it is filed under."""
        return f"{self.kind.code}.{self.subject}" if self.subject else self.kind.code


@dataclass(frozen=True, slots=True)
class _Run:
    """The present run of reports of a fault: since when, the last one, how many events."""

    since_s: float
    last_s: float
    events: int


_Key = tuple[str, str, str]


class FaultBook:
    """All faults of a node since its start.

    Parameters
    ----------
    kinds : iterable of FaultKind
        Every fault that may be reported.
    """

    def __init__(self, kinds: Iterable[FaultKind]) -> None:
        self._kinds = {k.code: k for k in kinds}
        self._faults: dict[_Key, Fault] = {}
        self._runs: dict[_Key, _Run] = {}
        self._changes: list[Fault] = []

    def report(
        self,
        code: str | FaultKind,
        evidence: str,
        now: Moment,
        *,
        unit: str = "",
        subject: str = "",
        events: int = 1,
    ) -> None:
        """Report that a condition lasts, or that events have happened.

        Parameters
        ----------
        code : str or FaultKind
            Code of its kind, or a kind of that code that says more of this fault.
        evidence : str
            What was seen, with figures.
        now : Moment
            The time.
        unit, subject : str
            Valve; topic or signal.
        events : int
            How many events [1].

        Raises
        ------
        ValueError
            If the code is unknown.
        """
        name = code.code if isinstance(code, FaultKind) else code
        if name not in self._kinds:
            msg = f"fault code '{name}' is unknown; add it to core/faults/kinds.py"
            raise ValueError(msg)
        kind = code if isinstance(code, FaultKind) else self._kinds[name]
        key = unit, name, subject
        run = self._runs.get(key)
        run = (
            _Run(now.steady_s, now.steady_s, events)
            if run is None
            else _Run(run.since_s, now.steady_s, run.events + events)
        )
        self._runs[key] = run
        fault = self._faults.get(key)
        if fault is None:
            fault = Fault(
                kind, unit, subject, Status.PENDING, evidence, now.stamp_ns, now.stamp_ns
            )
        elif fault.status is Status.HEALED:
            fault = replace(fault, status=Status.PENDING)
        more = fault.events + events
        fault = replace(fault, kind=kind, evidence=evidence, last_ns=now.stamp_ns, events=more)
        if fault.status is Status.PENDING and _is_confirmed(kind, run):
            fault = replace(fault, status=Status.CONFIRMED, count=fault.count + 1)
            self._changes.append(fault)
        self._faults[key] = fault

    def passed(self, code: str, now: Moment, *, unit: str = "", subject: str = "") -> None:
        """Say that a condition was looked at and is absent: what was pending is forgotten.

        Parameters
        ----------
        code : str
            Code of the fault.
        now : Moment
            Both clocks.
        unit, subject : str
            Valve and signal or database it is about; empty = the node itself.
        """
        key = (unit, code, subject)
        if key in self._runs:
            self._settle(key, now, looked_at=True)

    def step(self, now: Moment) -> None:
        """Let time pass: heal what was not reported for long enough."""
        for key in list(self._runs):
            self._settle(key, now, looked_at=False)

    def clear(self, *, unit: str = "", code: str = "") -> int:
        """Forget faults, their counts and times; what lasts is reported and counted anew.

        Parameters
        ----------
        unit, code : str
            Only of this valve, only this code; empty = all.

        Returns
        -------
        int
            How many were forgotten.
        """
        chosen = [k for k in self._faults if unit in {"", k[0]} and code in {"", k[1]}]
        for key in chosen:
            del self._faults[key]
            self._runs.pop(key, None)
        return len(chosen)

    def changes(self) -> list[Fault]:
        """Return what was confirmed or healed since the last call, in order."""
        changes, self._changes = self._changes, []
        return changes

    def faults(self, unit: str | None = None) -> list[Fault]:
        """Return all faults, of one valve or the node where `unit` is given, by unit and code."""
        keys = sorted(k for k in self._faults if unit is None or k[0] == unit)
        return [self._faults[k] for k in keys]

    def _settle(self, key: _Key, now: Moment, *, looked_at: bool) -> None:
        fault, run = self._faults[key], self._runs[key]
        quiet_s = now.steady_s - run.last_s
        if fault.status is Status.PENDING:
            if looked_at or quiet_s > max(fault.kind.heal_s, fault.kind.confirm_s):
                self._drop_pending(key, fault)
        elif quiet_s >= fault.kind.heal_s or (looked_at and isinf(fault.kind.heal_s)):
            del self._runs[key]
            self._faults[key] = replace(fault, status=Status.HEALED)
            self._changes.append(self._faults[key])

    def _drop_pending(self, key: _Key, fault: Fault) -> None:
        """Forget a suspicion; one that was confirmed earlier goes back to healed."""
        del self._runs[key]
        if fault.count:
            self._faults[key] = replace(fault, status=Status.HEALED)
        else:
            del self._faults[key]


def _is_confirmed(kind: FaultKind, run: _Run) -> bool:
    return run.events >= kind.confirm_count and run.last_s - run.since_s >= kind.confirm_s
