# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Show a stranger to the twin as it was configured from an earlier record of the same valve."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.history import diagnose
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.twin import Estimated, Twin
from valve_twin.validation.any_strangers.draw import CYCLES
from valve_twin.validation.any_strangers.record import Machine, branch
from valve_twin.validation.any_strangers.troubles import AFTER

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.diagnosis.changes.finding import Finding
    from valve_twin.core.survey.trial import Mapping01
    from valve_twin.core.twin import TwinConfig
    from valve_twin.core.types import Estimate
    from valve_twin.core.valves.interface import ValveModel
    from valve_twin.validation.any_strangers.draw import Stranger
    from valve_twin.validation.any_strangers.record import Recorded
    from valve_twin.validation.any_strangers.troubles import Trouble


@dataclass(frozen=True, slots=True)
class Setup:
    """How the twin was configured: model, twin, signals made of the command, and the position."""

    model: ValveModel
    twin: TwinConfig
    commands: Mapping[str, Mapping01]
    position: Mapping01


@dataclass(frozen=True, slots=True)
class Told:
    """What is told of one record.

    Attributes
    ----------
    trouble : Trouble or None
        What it has; None = nothing.
    starts_ns : tuple of int
        Stamps at which the production cycles begin [ns].
    cycles : tuple of (int, int, int)
        Number, start and end [ns] of each cycle of the twin that has features.
    estimates : int
        Estimates that were accepted, of the model [1].
    findings : tuple of Finding
        What the whole record tells.
    at_once : tuple of Finding or None
        What was told of each of these in the cycle of its alarm.
    """

    trouble: Trouble | None
    starts_ns: tuple[int, ...]
    cycles: tuple[tuple[int, int, int], ...]
    estimates: int
    findings: tuple[Finding, ...]
    at_once: tuple[Finding | None, ...]


class _Watched:
    """A twin and all that it has estimated."""

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._twin = Twin(setup.twin, setup.model)
        self._twin.predicts = False
        self.history: list[Estimate] = []
        self.starts_ns: list[int] = []

    def copy(self) -> _Watched:
        """Return a twin that goes on from here by itself."""
        other = _Watched(self._setup)
        other._twin = deepcopy(self._twin)
        other.history, other.starts_ns = list(self.history), list(self.starts_ns)
        return other

    def push(self, part: Recorded) -> None:
        """Take in a production cycle."""
        setup = self._setup
        self.starts_ns.append(part.start_ns)
        events = self._twin.push_round(
            (
                (setup.model.output, part.stamp_ns, setup.position.of(part.position)),
                *((n, part.stamp_ns, m.of(part.command)) for n, m in setup.commands.items()),
            )
        )
        self._settle(events)

    def finish(self) -> None:
        """Close the last cycle."""
        self._settle(self._twin.finish())

    def _settle(self, events: Sequence[object]) -> None:
        waiting = list(events)
        while True:
            for event in waiting:
                if isinstance(event, Estimated):
                    self.history += event.estimates
            job = self._twin.next_job()
            if job is None:
                return
            setup = self._setup
            done = estimate_cycle(setup.model, setup.twin.options, job.cycle, job.memory)
            waiting = list(self._twin.deliver(*done))

    def told(self, trouble: Trouble | None) -> Told:
        """Return what is told of all this."""
        kept = [e for e in self.history if e.estimator == "features"]
        own = [e for e in self.history if e.estimator == self._setup.model.trend_estimator]
        findings = diagnose(self.history, ()).findings
        at_once = tuple(
            diagnose([e for e in self.history if e.cycle <= f.alarm], ()).present for f in findings
        )
        return Told(
            trouble,
            tuple(self.starts_ns),
            tuple((e.cycle, e.start_ns, e.end_ns) for e in kept),
            sum(bool(e.used_by_trend) for e in own),
            findings,
            at_once,
        )


def watch(stranger: Stranger, setup: Setup) -> list[Told]:
    """Watch a stranger without trouble, and with each of its troubles from its onset on.

    Parameters
    ----------
    stranger : Stranger
        Which.
    setup : Setup
        How the twin is configured.

    Returns
    -------
    list of Told
        The record without trouble first.
    """
    machine, watched = Machine(stranger), _Watched(setup)
    troubled = []
    for number in range(1, CYCLES + 1):
        begun = [t for t in stranger.troubles if t.onset == number]
        troubled += [(t, branch(machine), watched.copy()) for t in begun]
        watched.push(machine.next_cycle())
    watched.finish()
    found = [watched.told(None)]
    for trouble, own, seen in troubled:
        for _ in range(AFTER):
            seen.push(own.next_cycle(trouble))
        seen.finish()
        found.append(seen.told(trouble))
    return found


def first_with(told: Told) -> int:
    """Return the number of the first of the twin's cycles of which most has the trouble, 0 = none.

    A twin that cuts windows of its own has cycles that are partly without it.
    """
    if told.trouble is None:
        return 0
    onset_ns = told.starts_ns[told.trouble.onset - 1]
    middles = np.array([0.5 * (a + b) for _, a, b in told.cycles])
    rows = np.flatnonzero(middles > onset_ns)
    return told.cycles[rows[0]][0] if len(rows) else 0


def touched_by(told: Told) -> int:
    """Return the number of the first of the twin's cycles that has any of the trouble, 0 = none.

    It may end behind the onset though most of it is without the trouble, which it shows all the
    same.
    """
    if told.trouble is None:
        return 0
    onset_ns = told.starts_ns[told.trouble.onset - 1]
    return next((number for number, _, end in told.cycles if end > onset_ns), 0)
