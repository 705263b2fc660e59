# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Sudden faults, counters, event log and step metrics of a valve on the report page."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING

from markupsafe import Markup

from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.diagnosis.changes.finding import CLOCK, UNKNOWN, size_of
from valve_twin.core.diagnosis.table import BY_NAME
from valve_twin.core.operation.step_metrics import METRICS
from valve_twin.report.tables import MAX_ROWS, Table
from valve_twin.report.text import (
    NONE,
    count,
    fixed,
    noted,
    number,
    render,
    unit,
    when,
    with_interval,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.assess import Assessment
    from valve_twin.core.diagnosis.changes.finding import Finding
    from valve_twin.core.operation.counters import Counters
    from valve_twin.core.operation.events import Event
    from valve_twin.core.operation.step_metrics import Metric, StepMetrics
    from valve_twin.core.operation.stroke_due import StrokeDue

MOST_EVENTS = 50
"""Newest entries that are shown; open ones are shown all [1]."""

MOST_REASONS = 10
"""Reasons of refused step metrics that are listed, the most frequent ones [1]."""


def faults_section(assessment: Assessment | None) -> str:
    """Return the section of sudden faults; empty where none could be found.

    Parameters
    ----------
    assessment : Assessment or None
        What was found; None = not assessed.
    """
    found = faults_table(assessment)
    if assessment is None or found is None:
        return ""
    return render("faults.html", found=found, cycles=assessment.diagnosis.cycles)


def faults_table(assessment: Assessment | None) -> Table | None:
    """Return the sudden faults, a row each; None where none could be found.

    Parameters
    ----------
    assessment : Assessment or None
        What was found; None = not assessed.
    """
    if assessment is None or not (assessment.diagnosis.ready or assessment.diagnosis.findings):
        return None
    head = ["Fault", "Part", "Size", "Since cycle", "Alarm at cycle", "Over at cycle", "Or"]
    verdict = assessment.verdict
    left_open = verdict.kind is VerdictKind.RECORDING_UNUSABLE and not verdict.fault
    return Table(head, [_row(f, left_open) for f in assessment.diagnosis.findings])


def _row(finding: Finding, left_open: bool) -> list[str]:
    if finding.fault == UNKNOWN:
        name, size = "like no known fault", NONE
    else:
        kind = BY_NAME[finding.fault]
        name, size = kind.text, size_of(finding) if kind.sized else NONE
    others = Markup("<br>").join(BY_NAME[r].text for r in finding.rivals)
    return [
        name,
        finding.part if finding.fault != CLOCK else NONE,
        size,
        str(finding.onset),
        str(finding.alarm),
        _end(finding, left_open),
        others or NONE,
    ]


def _end(finding: Finding, left_open: bool) -> str:
    """Return the cycle in which a fault was seen to be over, or why there is none."""
    if not finding.end_seen or (left_open and finding.end < 0):
        return "not known"
    return str(finding.end) if finding.end >= 0 else "lasts"


def operation_section(
    counters: Counters | None, events: Sequence[Event], stroke: StrokeDue | None = None
) -> str:
    """Return the section of counters and events; empty where there are none.

    Parameters
    ----------
    counters : Counters or None
        What the valve has done.
    events : sequence of Event
        Its event log, oldest first.
    stroke : StrokeDue, optional
        Its last stroke test.
    """
    counted = counters if counters is not None and counters.cycles else None
    if counted is None and not events:
        return ""
    shown = [e for k, e in enumerate(events) if e.is_open or k >= len(events) - MOST_EVENTS]
    return render(
        "operation.html",
        counters=counted,
        figures=[*(_figures(counted) if counted else ()), *_stroke(stroke)],
        spans=_spans(counted) if counted else Table([], []),
        events=Table(
            ["Entry", "Time", "Cycle", "Code", "NE 107", "What", "Seen by"],
            [_event_row(e) for e in reversed(shown)],
        ),
        left_out=count(len(events) - len(shown)) if len(shown) < len(events) else "",
    )


def _stroke(due: StrokeDue | None) -> list[tuple[str, str, str]]:
    if due is None or not due.stamp_ns:
        return []
    return [("Stroke test", due.verdict, f"{due.words}, seen from the last cycle")]


def _figures(counters: Counters) -> list[tuple[str, str, str]]:
    hours, opened, closed, near = counters.hours
    known = counters.stroke > 0.0
    travel = f"{counters.travel:.6g} in the position's unit"
    return [
        ("Production cycles", count(counters.cycles), f"since {when(counters.since_ns)}"),
        ("Movements", count(counters.movements), "in one direction, beyond a dead band of noise"),
        ("Reversals", count(counters.reversals), "changes of direction"),
        ("Starts", count(counters.starts), "movements out of a rest"),
        ("Strokes", fixed(counters.strokes, 1) if known else NONE, f"travel {travel}"),
        ("Time in cycles", f"{fixed(hours, 2)} h", ""),
        ("Time open", f"{fixed(opened, 2)} h", f"{fixed(near, 2)} h of it below a tenth"),
        ("Time closed", f"{fixed(closed, 2)} h", "within a hundredth of the stroke"),
    ]


def _spans(counters: Counters) -> Table:
    """Return how many movements there were by their span."""
    if not counters.stroke > 0.0:
        return Table([], [])
    ends = [edge / counters.stroke for edge in counters.edges]
    names = [
        f"{100 * low:.0f} .. {100 * high:.0f} %" if high < float("inf") else "a stroke and more"
        for low, high in pairwise(ends)
    ]
    rows = [[name, count(n)] for name, n in zip(names, counters.spans, strict=True) if n]
    return Table(["Span between two reversals", "Movements"], rows)


def _event_row(event: Event) -> list[str]:
    seen = ": ".join(filter(None, (event.acknowledged_by, event.acknowledged_note)))
    return [
        str(event.id),
        when(event.stamp_ns),
        str(event.cycle),
        event.code,
        event.status,
        event.text,
        seen if event.acknowledged else "open" if event.is_open else NONE,
    ]


def steps_section(steps: Sequence[StepMetrics]) -> str:
    """Return the section of step metrics; empty where no command stepped.

    Parameters
    ----------
    steps : sequence of StepMetrics
        Of the last cycles, oldest first.
    """
    if not steps:
        return ""
    shown = steps[-MAX_ROWS:]
    head = [noted(name, unit(text).strip()) for name, text in METRICS.items()]
    refused = Counter((m.name, m.reason) for s in steps for m in s.metrics if m.reason)
    return render(
        "steps.html",
        steps=Table(
            ["Cycle, step", "Command", "Size", *head],
            [
                [f"{s.cycle}, {s.step}", s.command, number(s.size), *map(_cell, s.metrics)]
                for s in shown
            ],
        ),
        refused=Table(
            ["Metric", "Why it is not told", "Times"],
            [[name, why, count(n)] for (name, why), n in refused.most_common(MOST_REASONS)],
        ),
        cycles=count(len({s.cycle for s in steps})),
        left_out=count(len(steps) - len(shown)) if len(shown) < len(steps) else "",
    )


def _cell(metric: Metric) -> str:
    if metric.reason:
        return NONE
    return with_interval(metric.value, metric.lower_95, metric.upper_95)
