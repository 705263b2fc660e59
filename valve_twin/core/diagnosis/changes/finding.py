# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A fault that was found, and all that the features of a valve say."""

from __future__ import annotations

import math
from dataclasses import dataclass

from valve_twin.core.diagnosis.table import BY_NAME, PAIRS, partner

CLOCK = "clock"
"""Name of the finding that two clocks run apart."""

UNKNOWN = "unknown"
"""Name of a change that is like no fault of the table."""

LATELY = 40
"""Cycles for which a fault that is over is told [1]: those that later ones are held against."""

_LIKE_CLOCKS = frozenset({CLOCK, UNKNOWN, "aeration", "delay"})
"""What clocks apart look like by themselves: all comes later, and is like nothing known."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A fault that was found.

    Attributes
    ----------
    fault : str
        Its name, `UNKNOWN` for a change like no signature.
    rivals : tuple of str
        Faults that fit as well: twice the log likelihood less by under `RIVAL`.
    part : str
        valve, command, sensor or supply.
    severity : float
        Its size [unit of the fault]; NaN where unknown.
    deviation : float
        The change in standard deviations of one cycle [1].
    onset, alarm : int
        Numbers of the first cycle that has it and of the cycle that raised the alarm.
    end : int
        Number of the cycle at which it was seen to be over; -1 = it lasts.
    end_seen : bool
        Whether it was: else the cycles from there on are of other products, which do not tell.
    """

    fault: str
    rivals: tuple[str, ...]
    part: str
    severity: float
    deviation: float
    onset: int
    alarm: int
    end: int = -1
    end_seen: bool = True


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What the features of a valve say.

    Attributes
    ----------
    findings : tuple of Finding
        Every fault that was found, oldest first.
    cycles : int
        Cycles looked at.
    ready : bool
        Whether there are enough cycles since start or maintenance to name a fault.
    doubt : str
        Why the cycles have nothing to be compared with; empty where they have.
    departs : float
        How far the newest cycle lies off those before it where one more is to tell whether that
        is a fault, else 0 [standard deviations].
    newest : int
        Number of that cycle, 0 = none showed anything.
    against : str
        What a stored reference says; empty where none is given.
    odd : str
        What the newest cycle shows that no sound one does, before more cycles confirm it; empty
        where it shows nothing such.
    """

    findings: tuple[Finding, ...]
    cycles: int
    ready: bool
    doubt: str = ""
    departs: float = 0.0
    newest: int = 0
    against: str = ""
    odd: str = ""

    @property
    def present(self) -> Finding | None:
        """The fault that lasts, None = none; clocks apart before what these look like."""
        lasting = [f for f in reversed(self.findings) if f.end < 0]
        apart = next((f for f in lasting if f.fault == CLOCK), None)
        if apart is None:
            return next(iter(lasting), None)
        return next((f for f in lasting if f.fault not in _LIKE_CLOCKS), apart)

    @property
    def clocks(self) -> Finding | None:
        """That clocks run apart beside the fault that is told, None = they do not."""
        apart = (f for f in self.findings if f.end < 0 and f.fault == CLOCK)
        return next((f for f in apart if f is not self.present), None)


NOTHING = Diagnosis((), 0, ready=False)
"""What is known of a valve without features."""


def size_of(finding: Finding) -> str:
    """Return the size of a fault with its unit; it is said where no signature tells it."""
    unit = BY_NAME[finding.fault].unit
    known = math.isfinite(finding.severity)
    return f"{finding.severity:.2g}{'' if unit == '1' else f' {unit}'}" if known else "unknown"


def describe_finding(finding: Finding) -> str:
    """Return a fault in one line: which, how large, since when, what fits as well."""
    since = f"since cycle {finding.onset}"
    deviation = f"{finding.deviation:.1f}" if finding.deviation < 100.0 else "over 100"
    sure = f"{deviation} standard deviations of one cycle"
    if finding.fault == UNKNOWN:
        return f"a sudden change that is like no known fault, {since} ({sure})"
    kind = BY_NAME[finding.fault]
    if finding.fault == CLOCK:
        return (
            f"{kind.text} {abs(finding.severity) * 1e6:.0f} ppm, seen {since} ({sure}): log both "
            "by one clock, or synchronise the two"
        )
    if not math.isfinite(finding.deviation):
        sure = "no sound valve shows it"
    line = f"{kind.text}, {since}"
    if kind.sized:
        line = f"{kind.text}, size {size_of(finding)}, {since} ({sure})"
    if not finding.rivals:
        return line
    others = " or ".join(BY_NAME[name].text for name in finding.rivals)
    settled = PAIRS.get(frozenset({finding.fault, partner(finding.fault)}), "")
    how = f": {settled} to tell the two" if partner(finding.fault) in finding.rivals else ""
    return f"{line}; the data fit as well: {others}{how}"


def clocks_beside(diagnosis: Diagnosis) -> str:
    """Return that clocks run apart beside the fault that is told, or ""."""
    return f"beside it {describe_finding(diagnosis.clocks)}" if diagnosis.clocks else ""


def lately_over(diagnosis: Diagnosis, cycle: int, since: int = 0) -> str:
    """Return the newest fault that came and went by itself a while ago, or "".

    Nothing is said of one of which nothing tells whether it is over.

    Parameters
    ----------
    diagnosis : Diagnosis
        What the features say; a fault that lasts is told itself.
    cycle : int
        Number of the newest cycle.
    since : int
        First cycle since maintenance with a new reference: what began before it was mended.
    """
    gone = (f for f in diagnosis.findings if f.end >= 0 and f.end_seen and f.onset >= since)
    over = [f for f in gone if cycle - f.end < LATELY]
    if diagnosis.present is not None or not over:
        return ""
    newest = max(over, key=lambda f: f.end)
    return f"a fault is over since cycle {newest.end}: {describe_finding(newest)}"


@dataclass(frozen=True, slots=True)
class Stale:
    """Why the newest cycles say nothing: an empty `reason` = they do.

    `unusable` where the signals themselves are why: they cannot be those of a valve, or are too
    coarse. `since` is the first of these cycles.
    """

    reason: str = ""
    unusable: bool = False
    since: int = 0

    def outdates(self, fault: Finding) -> bool:
        """Return whether signals that are unusable leave open if a fault of before is there.

        Parameters
        ----------
        fault : Finding
            A fault that was not seen to end.
        """
        return self.unusable and fault.alarm < self.since


FRESH = Stale()
"""The newest cycles say something."""
