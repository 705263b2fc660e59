# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What running nodes say on their topics, put over what the history has.

A topic counts while somebody publishes it; where nobody does, the history's word stands.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from valve_twin.core.faults.advice import DIAGNOSED
from valve_twin.io.history.fleet import FleetOrder, FleetRow, judged, ranked

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import TypeAlias

    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.core.aging.verdict import Trend, Verdict
    from valve_twin.gateway.view import LastCycle, NodeFault, View

    Judged: TypeAlias = tuple[FleetRow, tuple[Trend, ...]]

UNSTORED = "nothing of it is stored yet"
"""Evidence of a valve that the history does not know."""


@dataclass(frozen=True, slots=True)
class _Said:
    """What is said of one valve."""

    verdict: Verdict | None = None
    trends: tuple[Trend, ...] = ()
    last: LastCycle | None = None


class Told:
    """What the topics say now; safe from any thread.

    Parameters
    ----------
    models : mapping
        Names of the models of the valves that are listened to, by name of the valve.
    """

    def __init__(self, models: Mapping[str, str]) -> None:
        self._models = dict(models)
        self._lock = threading.Lock()
        self._said: dict[str, _Said] = {}
        self._faults: dict[str, tuple[NodeFault, ...]] = {}
        self._number, self._numbers = 0, dict.fromkeys(models, 0)
        self._kept: tuple[View, int, View] | None = None
        self._judged: dict[str, tuple[tuple[object, ...], Judged]] = {}

    def number(self, valve: str) -> int:
        """Return what grows whenever something new is said of a valve [1]."""
        return self._numbers.get(valve, 0)

    def judge(self, valve: str, verdict: Verdict | None, trends: Sequence[Trend] = ()) -> None:
        """Take a verdict and the trends it was made from; None = nobody publishes one.

        Parameters
        ----------
        valve : str
            Whose they are.
        verdict : Verdict or None
            The newest one.
        trends : sequence of Trend
            The newest of each parameter.
        """
        with self._lock:
            said = self._said.get(valve, _Said())
            self._take(valve, replace(said, verdict=verdict, trends=tuple(trends)))

    def close_cycle(self, valve: str, last: LastCycle | None) -> None:
        """Take the cycle that a twin closed last; None = there is no twin.

        Parameters
        ----------
        valve : str
            Whose it is.
        last : LastCycle or None
            The cycle.
        """
        with self._lock:
            self._take(valve, replace(self._said.get(valve, _Said()), last=last))

    def report(self, topic: str, faults: Sequence[NodeFault]) -> None:
        """Take the confirmed faults of a node; none where it is gone.

        Parameters
        ----------
        topic : str
            Where they are published.
        faults : sequence of NodeFault
            All that it has; one without a valve becomes that of the valve it runs below.
        """
        found = tuple(replace(f, valve=f.valve or self._below(f.node)) for f in faults)
        with self._lock:
            before = self._faults.get(topic, ())
            if found == before:
                return
            self._faults[topic] = found
            self._count(*{f.valve for f in (*before, *found)})

    def _below(self, node: str) -> str:
        return max((v for v in self._models if node.startswith(v + "/")), key=len, default="")

    def _take(self, valve: str, said: _Said) -> None:
        if said != self._said.get(valve, _Said()):
            self._said[valve] = said
            self._count(valve)

    def _count(self, *valves: str) -> None:
        self._number += 1
        for valve in valves:
            self._numbers[valve] = self._numbers.get(valve, 0) + 1

    def over(self, view: View, rules: Callable[[str], AgingConfig]) -> View:
        """Return a view with what the topics say; the same one where nothing has changed.

        Parameters
        ----------
        view : View
            What the history has.
        rules : callable
            Returns the rules of aging of a valve.
        """
        with self._lock:
            kept = self._kept
            if kept is None or kept[0] is not view or kept[1] != self._number:
                kept = self._kept = view, self._number, self._laid(view, rules)
            return kept[2]

    def _laid(self, view: View, rules: Callable[[str], AgingConfig]) -> View:
        filed = {f for found in self._faults.values() for f in found}
        said = {v: s for v, s in self._said.items() if s.verdict is not None or s.last is not None}
        spoken = {*said, *(f.valve for f in filed)} & set(self._models)
        rows = {row.valve: row for row in view.rows}
        for valve in sorted(spoken - set(rows)):
            rows[valve] = FleetRow(valve, self._models[valve], evidence=UNSTORED)
        trends, verdicts, courses = dict(view.trends), dict(view.verdicts), dict(view.courses)
        for valve, one in said.items():
            if one.verdict is None or valve not in rows:
                continue
            before = rows[valve].parameter
            stored = rows[valve], view.trends.get(valve, ())
            rows[valve], trends[valve] = self._judge(stored, one, rules)
            verdicts[valve] = one.verdict
            if rows[valve].parameter != before:
                courses.pop(valve, None)
        faults = [_as_told(f, verdicts.get(f.valve), rows.get(f.valve)) for f in filed]
        return replace(
            view,
            rows=tuple(ranked(list(rows.values()), FleetOrder.URGENCY)),
            trends=trends,
            verdicts=verdicts,
            courses=courses,
            live=True,
            last={valve: one.last for valve, one in said.items() if one.last is not None},
            faults=tuple(sorted(faults, key=_worst_first)),
            told=frozenset(valve for valve, one in said.items() if one.verdict is not None),
        )

    def _judge(self, stored: Judged, said: _Said, rules: Callable[[str], AgingConfig]) -> Judged:
        """Return row and trends of a valve by the topics; the same objects for the same words."""
        assert said.verdict is not None
        valve = stored[0].valve
        made_of = (*stored, said.verdict, said.trends)
        kept = self._judged.get(valve)
        if kept is None or any(a is not b for a, b in zip(kept[0], made_of, strict=True)):
            by_name = {t.parameter: t for t in (*stored[1], *said.trends)}
            trends = tuple(by_name.values())
            row = judged(stored[0], said.verdict, trends, rules(valve))
            kept = self._judged[valve] = made_of, (row, trends)
        return kept[1]


def _as_told(fault: NodeFault, verdict: Verdict | None, row: FleetRow | None) -> NodeFault:
    """Return a fault with the state of the valve's verdict where that names the same one."""
    if verdict is None or row is None or fault.code not in DIAGNOSED.values():
        return fault
    return replace(fault, told=row.ne107) if verdict.fault == fault.subject else fault


def _worst_first(fault: NodeFault) -> tuple[object, ...]:
    return -fault.ne107.severity, fault.valve, fault.node, fault.code, fault.subject
