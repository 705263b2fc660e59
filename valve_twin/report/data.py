# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the report page shows: plain values from the history, the twin and the aging monitor."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from valve_twin.core.types import EstimateStatus
from valve_twin.io.history.tiers.reading import NONE_REFUSED, counted

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.aging.assess import Assessment
    from valve_twin.core.operation.counters import Counters
    from valve_twin.core.operation.events import Event
    from valve_twin.core.operation.step_metrics import StepMetrics
    from valve_twin.core.operation.stroke_due import StrokeDue
    from valve_twin.core.past.condensate import Condensate, Condensed
    from valve_twin.core.types import Cycle, Estimate, Maintenance, Parameter, Prediction
    from valve_twin.core.valves.error_budget import Budget
    from valve_twin.io.history.tables import CycleRecord
    from valve_twin.io.history.tiers.reading import Refused
    from valve_twin.report.signals import Signal


@dataclass(frozen=True, slots=True)
class ReportData:
    """Everything on one page about one valve.

    Attributes
    ----------
    valve, model : str
        Name of the valve and of its model.
    source : str
        Bag or database the data come from.
    parameters : tuple of Parameter
        What the model publishes, with units and descriptions.
    cycles : tuple of CycleRecord
        All cycles, refused ones included, oldest first.
    estimates : tuple of Estimate
        All estimates of all estimators, oldest first.
    assessment : Assessment or None
        Trends and verdict; None = not assessed.
    maintenance : tuple of Maintenance
        All maintenance events.
    prediction : Prediction or None
        The samples of the last cycle.
    label : str
        Empty for an aging record; else what the cycles differ in, e.g. "by load at equal stroke,
        not aging": then no trend, remaining life or verdict is shown.
    options : mapping
        Options of the model that were in force.
    version : str
        Version of valve_twin.
    written_ns : int
        When the page was written [ns since 1970], 0 = not stated.
    notes : tuple of str
        Further sentences for the reader, e.g. what a trivial model reaches.
    budget : Budget or None
        What each source of error does to each parameter; None = not asked for.
    cycle : Cycle or None
        The samples of the last estimated cycle, all signals; None = not kept.
    signals : tuple of Signal
        Those signals in their units.
    counters : Counters or None
        What the valve has done; None = not counted.
    events : tuple of Event
        Its event log, oldest first.
    stroke_due : StrokeDue or None
        When a stroke was last tested and when the next test is due; None = not asked.
    steps : tuple of StepMetrics
        What the steps of the last cycles tell, oldest first; empty = none, or no samples.
    nameplate : mapping
        What is given of its nameplate, by name.
    provenance : str
        What it is made from, see `report.provenance`; empty = not stated.
    files : mapping
        By cycle, the imported files that it comes from; empty = not imported.
    warning : str
        What the whole page has to be read with, at its head; empty = nothing.
    condensed : Condensed or None
        How far its cycles are condensed in the history: they are not among `cycles`.
    condensed_refused : Refused
        From how many of those nothing was learnt, at least where older versions condensed some.
    condensates : tuple of Condensate
        What the days of condensed cycles say of the parameters that are followed.
    language : str
        Code of the language of the page.
    """

    valve: str
    model: str
    source: str
    parameters: tuple[Parameter, ...]
    cycles: tuple[CycleRecord, ...] = ()
    estimates: tuple[Estimate, ...] = ()
    assessment: Assessment | None = None
    maintenance: tuple[Maintenance, ...] = ()
    prediction: Prediction | None = None
    label: str = ""
    options: Mapping[str, object] = field(default_factory=dict)
    version: str = ""
    written_ns: int = 0
    notes: tuple[str, ...] = ()
    budget: Budget | None = None
    cycle: Cycle | None = None
    signals: tuple[Signal, ...] = ()
    counters: Counters | None = None
    events: tuple[Event, ...] = ()
    stroke_due: StrokeDue | None = None
    steps: tuple[StepMetrics, ...] = ()
    nameplate: Mapping[str, str] = field(default_factory=dict)
    provenance: str = ""
    files: Mapping[int, str] = field(default_factory=dict)
    warning: str = ""
    condensed: Condensed | None = None
    condensed_refused: Refused = NONE_REFUSED
    condensates: tuple[Condensate, ...] = ()
    language: str = "en"

    @property
    def aging(self) -> bool:
        """Whether the cycles are a record of aging."""
        return not self.label

    @property
    def totals(self) -> Condensed:
        """How many cycles there are, condensed ones included, and what was in them."""
        return counted(self.condensed, self.cycles)

    @property
    def trend_estimates(self) -> tuple[Estimate, ...]:
        """The estimates that feed the trend."""
        return tuple(e for e in self.estimates if e.used_by_trend)

    @property
    def refused(self) -> dict[int, str]:
        """Why nothing was learnt from a cycle that is not condensed, by its number."""
        until = self.condensed.cycle if self.condensed else 0
        found = {
            e.cycle: e.reason
            for e in self.trend_estimates
            if e.status is EstimateStatus.REFUSED and e.cycle > until
        }
        plain = {c.cycle: c.reason or "no reason recorded" for c in self.cycles if not c.accepted}
        return found | plain

    def parameter(self, name: str) -> Parameter | None:
        """Return what is known about a parameter."""
        return next((p for p in self.parameters if p.name == name), None)
