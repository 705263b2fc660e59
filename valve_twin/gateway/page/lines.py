# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Times, signs and links of the pages, and the lines that say what is wrong with the nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

from valve_twin.core.faults.ne107 import Ne107
from valve_twin.report.text import utc, when

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.gateway.view import NodeFault

MOST_LINES = 12
"""Faults of nodes on the page of all valves; of more the others are counted [1]."""

_CLOCK_SET_NS = 10**18

SIGNS = {
    Ne107.FAILURE: "F",
    Ne107.CHECK_FUNCTION: "C",
    Ne107.OUT_OF_SPECIFICATION: "S",
    Ne107.MAINTENANCE_REQUIRED: "M",
    Ne107.GOOD: "\N{CHECK MARK}",
}


class Moment(NamedTuple):
    """A time: what a browser puts into its zone, and the words where it does not."""

    text: str
    iso: str


def moment(stamp_ns: int) -> Moment:
    """Return a stamp for a page; one of a clock that was not set stays as it is."""
    if not stamp_ns:
        return Moment("", "")
    return Moment(when(stamp_ns), iso(stamp_ns) if stamp_ns >= _CLOCK_SET_NS else "")


def iso(stamp_ns: int) -> str:
    """Return a stamp by ISO 8601, empty for 0."""
    return utc(stamp_ns).isoformat() if stamp_ns else ""


def link_of(valve: str) -> str:
    """Return the part of an address that names a valve."""
    return quote(valve.lstrip("/"))


class FaultLines(NamedTuple):
    """Faults of nodes as a page lists them: what stands there, and how many more there are."""

    shown: list[dict[str, object]]
    more: int


def fault_lines(faults: Sequence[NodeFault], most: int | None = None) -> FaultLines:
    """Return a line for each fault of a node.

    Parameters
    ----------
    faults : sequence of NodeFault
        Worst first.
    most : int or None
        At most so many lines; None = all.
    """
    shown = [_line(fault) for fault in faults[:most]]
    return FaultLines(shown, len(faults) - len(shown))


def _line(fault: NodeFault) -> dict[str, object]:
    state = fault.ne107
    return {
        "sign": SIGNS[state],
        "style": state.name.lower(),
        "state": state.value,
        "valve": fault.valve,
        "link": "valve/" + link_of(fault.valve) if fault.valve else "",
        "node": fault.node,
        "code": fault.code,
        "subject": fault.subject,
        "evidence": fault.evidence,
        "remedy": fault.remedy,
        "since": moment(fault.first_ns),
    }
