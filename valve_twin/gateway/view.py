# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the faces show: the valves as a history and, where twins run, their topics have them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from valve_twin.core.faults.advice import state_of
from valve_twin.core.faults.ne107 import Ne107

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.aging.verdict import Trend, Verdict
    from valve_twin.io.history.fleet import FleetRow


@dataclass(frozen=True, slots=True)
class NodeFault:
    """A confirmed fault that a node files on its topic `~/faults`.

    Attributes
    ----------
    node, valve : str
        Who files it, and whose it is; a valve is empty where it is of none.
    code, subject : str
        Its stable name (docs/faults.md), and the topic or signal that has it, or the name of the
        fault of the valve.
    evidence, remedy : str
        What was seen last, and what to do.
    first_ns : int
        First seen, the node's clock [ns].
    told : str
        State that the valve's own verdict gives the same fault; empty = it tells no such fault.
    """

    node: str
    valve: str
    code: str
    subject: str = ""
    evidence: str = ""
    remedy: str = ""
    first_ns: int = 0
    told: str = ""

    @property
    def ne107(self) -> Ne107:
        """State of the monitoring that it disturbs, or of the valve whose fault it names."""
        return Ne107(self.told) if self.told else state_of(self.code, self.subject)


@dataclass(frozen=True, slots=True)
class LastCycle:
    """The cycle that a twin closed last, stored or not.

    Attributes
    ----------
    cycle : int
        Its number [1].
    end_ns : int
        Its last stamp [ns].
    accepted : bool
        Whether it was handed to estimation.
    reason : str
        Why it was, or was not.
    """

    cycle: int
    end_ns: int = 0
    accepted: bool = True
    reason: str = ""


@dataclass(frozen=True, slots=True)
class View:
    """What the faces show.

    Attributes
    ----------
    rows : tuple of FleetRow
        One a valve, worst first.
    where : str
        The history.
    read_ns : int
        When it was read last [ns since 1970]; 0 = never.
    failure : str
        Why it could not be read now; the rows are then those of `read_ns`.
    trends : mapping
        The trends of the followed parameters by name of the valve.
    nameplates : mapping
        What is given of a nameplate, by name of the valve.
    verdicts : mapping
        The verdict of each valve that could be assessed, by its name.
    courses : mapping
        The last estimates of the worst parameter [its unit], by name of the valve.
    whole : bool
        Whether every valve was assessed.
    live : bool
        Whether topics are listened to.
    last : mapping
        The cycle that a running twin closed last, by name of the valve.
    faults : tuple of NodeFault
        What is wrong with the nodes now, worst first.
    told : frozenset of str
        Valves whose verdict a running node tells.
    """

    rows: tuple[FleetRow, ...] = ()
    where: str = ""
    read_ns: int = 0
    failure: str = ""
    trends: Mapping[str, tuple[Trend, ...]] = field(default_factory=dict)
    nameplates: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    courses: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    whole: bool = True
    live: bool = False
    last: Mapping[str, LastCycle] = field(default_factory=dict)
    faults: tuple[NodeFault, ...] = ()
    told: frozenset[str] = frozenset()

    def is_stale(self, valve: str) -> bool:
        """Return whether what is shown of a valve was read before, and nobody tells it now."""
        return bool(self.failure) and valve not in self.told

    def row(self, valve: str) -> FleetRow | None:
        """Return the row of a valve; None where nothing is known of it."""
        return next((row for row in self.rows if row.valve == valve), None)

    def made_of(self, row: FleetRow) -> tuple[object, ...]:
        """Return what is said of a valve; the same objects where nothing of it was read anew."""
        return row, self.trends.get(row.valve), self.nameplates.get(row.valve)

    def faults_of(self, valve: str) -> tuple[NodeFault, ...]:
        """Return the faults of the nodes that are a valve's, worst first."""
        return tuple(f for f in self.faults if f.valve == valve)
