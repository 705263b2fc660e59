# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The pages of the gateway as HTML."""

from __future__ import annotations

import math
import re
import zlib
from dataclasses import asdict, dataclass, field
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from valve_twin.core.faults.ne107 import Ne107
from valve_twin.gateway.page.details import DRAWING
from valve_twin.gateway.page.lines import MOST_LINES, SIGNS, fault_lines, link_of, moment
from valve_twin.report.language.words import LANGUAGES, cell, drawn, figures, sentence, words
from valve_twin.report.plots import plot_cycle
from valve_twin.report.svg import polyline
from valve_twin.report.tables import life_table
from valve_twin.report.text import NONE, count, day, fixed, number, render

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import Estimate, Prediction
    from valve_twin.gateway.page.accounts import Session
    from valve_twin.gateway.page.details import Details
    from valve_twin.gateway.view import View
    from valve_twin.io.history.fleet import FleetRow
    from valve_twin.io.history.tables import CycleRecord

RELOAD_S = 5
"""A page asks anew so often [s]."""

LIVE_RELOAD_S = 2
"""The same where running nodes are listened to [s]."""

EAGER_RELOAD_S = 1
"""The same while something is awaited: a first reading, a drawing, a locked history [s]."""

LONG_PART = 24
"""Part of a name above which it may be broken at other places, too [letters]."""

_GRAVEST_FIRST = sorted(Ne107, key=lambda state: -state.severity)


@dataclass(frozen=True, slots=True)
class Visitor:
    """For whom a page is made.

    Attributes
    ----------
    language : str
        Code of his language.
    root : str
        Way from his page to that of all valves, such as "../".
    path : str
        Way back.
    session : Session or None
        His session, where he has come in.
    accounts : bool
        Whether one can come in.
    languages : mapping
        What there is.
    """

    language: str = "en"
    root: str = ""
    path: str = ""
    session: Session | None = None
    accounts: bool = False
    languages: Mapping[str, str] = field(default_factory=lambda: LANGUAGES)


@cache
def _templates(language: str) -> Environment:
    made = Environment(
        loader=PackageLoader("valve_twin.gateway"),
        autoescape=True,
        undefined=StrictUndefined,
        extensions=["jinja2.ext.i18n"],
    )
    told = words(language)
    made.install_gettext_translations(told)  # type: ignore[attr-defined]
    made.filters["cell"] = partial(cell, told=told)
    made.filters["drawn"] = partial(drawn, told=told)
    made.filters["named"] = _named
    made.filters["sentence"] = partial(sentence, told=told)
    made.globals["style"] = render("style.css")
    made.globals["own_style"] = Markup(made.get_template("page.css").render())
    return made


def _page(name: str, visitor: Visitor, **values: object) -> str:
    made = _templates(visitor.language).get_template(name).render(visitor=visitor, **values)
    return figures(made, visitor.language)


def _named(name: str) -> Markup:
    """Return a name that breaks between its parts, and within those only that are long."""
    parts = [Markup("<wbr>").join(re.split("(?<=[_.-])", part)) if len(part) > LONG_PART else part
             for part in name.split("/")]  # fmt: skip
    return Markup("/<wbr>").join(parts)


def script() -> str:
    """Return the glue of the pages."""
    return _templates("en").get_template("page.js").render()


def fleet_mark(view: View) -> str:
    """Return what changes whenever the page of all valves says something else."""
    return _mark(view.rows, view.failure, view.where, view.last, view.faults)


def valve_mark(view: View, row: FleetRow, details: Details) -> str:
    """Return what changes whenever the page of a valve says something else.

    Parameters
    ----------
    view, row, details : View, FleetRow, Details
        What is shown.
    """
    last = [(e.id, e.acknowledged) for e in details.events]
    of_it = row, view.failure, len(details.report), details.failure, last
    told = view.last.get(row.valve), view.faults_of(row.valve)
    return _mark(of_it, details.maintenance, told)


def _mark(*content: object) -> str:
    return f"{zlib.crc32(repr(content).encode('utf-8', 'replace')):08x}"


def _pace_s(view: View, *, awaited: bool = False) -> int:
    """Return how often a page asks anew [s]."""
    if awaited or view.failure or not view.whole:
        return EAGER_RELOAD_S
    return LIVE_RELOAD_S if view.live else RELOAD_S


def _age_s(view: View, now_ns: int) -> int | None:
    return round((now_ns - view.read_ns) * 1e-9) if view.read_ns else None


def fleet_page(view: View, now_ns: int, visitor: Visitor) -> str:
    """Return the page of all valves, worst first.

    Parameters
    ----------
    view : View
        What the history holds.
    now_ns : int
        When the page is made [ns since 1970].
    visitor : Visitor
        For whom.
    """
    counts = {s: sum(row.ne107 == s.value for row in view.rows) for s in _GRAVEST_FIRST}
    return _page(
        "fleet.html",
        visitor,
        view=view,
        rows=[_cells(row, view) for row in view.rows],
        faults=fault_lines(view.faults, MOST_LINES),
        counts=[(SIGNS[s], s.name.lower(), s.value, n) for s, n in counts.items() if n],
        read=moment(view.read_ns),
        age_s=_age_s(view, now_ns),
        reload_s=_pace_s(view),
        mark=fleet_mark(view),
    )


def _cells(row: FleetRow, view: View) -> dict[str, object]:
    state = Ne107(row.ne107)
    last, faults = view.last.get(row.valve), fault_lines(view.faults_of(row.valve))
    known = math.isfinite(row.drift)
    lower, upper = (fixed(x, 1, sign=True) for x in (row.drift_lower_95, row.drift_upper_95))
    left = f"{count(round(row.remaining))} {row.axis}" if math.isfinite(row.remaining) else NONE
    return {
        "valve": row.valve,
        "link": "valve/" + link_of(row.valve),
        "sign": SIGNS[state],
        "style": state.name.lower(),
        "state": state.value,
        "verdict": row.verdict.text,
        "unjudged": row.unjudged,
        "why": row.evidence,
        "action": row.action,
        "worst": f"{row.parameter} {fixed(row.drift, 1, sign=True)} %" if known else NONE,
        "interval": f"{lower} … {upper}" if math.isfinite(row.drift_lower_95) else "",
        "way": f"{100.0 * max(row.way, 0.0):.0f} %" if math.isfinite(row.way) else NONE,
        "limit": row.limit_state,
        "service": day(row.service_date_ns) if row.service_date_ns else left,
        "cycle": str(last.cycle if last is not None else row.cycle),
        "end": moment(last.end_ns if last is not None else row.end_ns),
        "spark": _spark(row.parameter, view.courses.get(row.valve, ())),
        "faults": faults.shown,
    }


def _spark(parameter: str, course: Sequence[float]) -> dict[str, str] | None:
    """Return a small line through the last estimates; None where there are too few."""
    if len(course) < 3:
        return None
    y = np.array(course)
    span = float(np.ptp(y)) or 1.0
    x = np.linspace(1.0, 99.0, len(y))
    line = polyline(x, 24.0 - 22.0 * (y - y.min()) / span)
    return {"path": line, "words": f"{parameter}: {course[0]:.4g} .. {course[-1]:.4g}"}


def valve_page(
    view: View,
    row: FleetRow,
    details: Details,
    visitor: Visitor,
    *,
    commands: Sequence[str] | None = None,
    said: str = "",
) -> str:
    """Return the page of a valve.

    Parameters
    ----------
    view : View
        What the history holds.
    row : FleetRow
        The valve's row in it.
    details : Details
        What else is shown.
    visitor : Visitor
        For whom.
    commands : sequence of str or None
        Names of the commands of the moving plot; None = there is no live twin.
    said : str
        What is to be said of what the visitor did.
    """
    parameters = life_table(list(view.trends.get(row.valve, ())), remarks=False)
    return _page(
        "valve.html",
        visitor,
        view=view,
        row=row,
        link=link_of(row.valve),
        plate=view.nameplates.get(row.valve, {}),
        cells=_cells(row, view),
        facts=_facts(row, view),
        node_faults=fault_lines(view.faults_of(row.valve)),
        parameters=parameters,
        counters={"head": _COUNTERS_HEAD, "rows": _counters(row)},
        details=_shown(details),
        live=commands is not None,
        commands=commands or (),
        age_s=_age_s(view, view.read_ns),
        reload_s=_pace_s(view, awaited=details.failure == DRAWING),
        mark=valve_mark(view, row, details),
        said=said,
    )


_COUNTERS_HEAD = ("Counter", "Value")


def _facts(row: FleetRow, view: View) -> list[tuple[str, str, str]]:
    cells, last = _cells(row, view), view.last.get(row.valve)
    refused = "refused" if last is not None and not last.accepted else ""
    found = [("Last cycle", str(cells["cycle"]), refused)]
    if row.parameter:
        found.append(("Worst parameter, change", str(cells["worst"]), str(cells["interval"])))
    found += [
        ("To its limit", str(cells["way"]), row.limit_state),
        ("Service", str(cells["service"]), ""),
    ]
    found.append(("Open events", str(row.open_events), ""))
    return found


def _counters(row: FleetRow) -> list[tuple[str, str]]:
    if not row.cycles:
        return []
    hours = {"Time in cycles": row.hours, "Time open": row.hours_open}
    hours["Time closed"] = row.hours_closed
    found = [("Production cycles", count(row.cycles)), ("Movements", count(row.movements))]
    found += [("Reversals", count(row.reversals)), ("Starts", count(row.starts))]
    found.append(("Strokes", fixed(row.strokes, 1)))
    return found + [(name, f"{fixed(h, 2)} h") for name, h in hours.items()]


def _shown(details: Details) -> dict[str, object]:
    return {
        "failure": details.failure,
        "condensed": details.condensed,
        "figures": details.figures,
        "faults": details.faults,
        "maintenance": [
            {
                "cycle": m.cycle,
                "time": moment(m.stamp_ns),
                "note": m.note,
                "withdrawn": m.withdrawn,
                "new_reference": m.new_reference,
            }
            for m in details.maintenance
        ],
        "events": [
            {
                **asdict(e),
                "time": moment(e.stamp_ns),
                "seen": moment(e.acknowledged_at_ns),
                "is_open": e.is_open,
            }
            for e in details.events
        ],
    }


@dataclass(frozen=True, slots=True)
class ShownCycle:
    """One of the cycles that stand beside each other.

    Attributes
    ----------
    number : int
        Which was asked for [1].
    record : CycleRecord or None
        What is stored of it; None = nothing.
    estimates : sequence of Estimate
        Its estimates that feed the trend.
    samples : Prediction or None
        Its samples; None = not there.
    why : str
        Why they are not.
    """

    number: int
    record: CycleRecord | None = None
    estimates: Sequence[Estimate] = ()
    samples: Prediction | None = None
    why: str = ""


def cycles_page(row: FleetRow, shown: Sequence[ShownCycle], first: int, visitor: Visitor) -> str:
    """Return the page of two cycles beside each other.

    Parameters
    ----------
    row : FleetRow
        The valve.
    shown : sequence of ShownCycle
        The cycles.
    first : int
        Number of the first stored cycle [1].
    visitor : Visitor
        For whom.
    """
    return _page(
        "cycles.html",
        visitor,
        row=row,
        link="valve/" + link_of(row.valve),
        asked=[c.number for c in shown],
        shown=[_cycle(c) for c in shown],
        first=first,
        last=row.cycle,
    )


def _cycle(shown: ShownCycle) -> dict[str, object]:
    record = shown.record
    parameters = [p for e in shown.estimates for p in e.parameters]
    return {
        "number": shown.number,
        "record": record,
        "start": moment(record.start_ns) if record else None,
        "seconds": (record.end_ns - record.start_ns) * 1e-9 if record else 0.0,
        "estimates": [
            {
                "name": p.name,
                "value": number(p.value),
                "interval": f"{number(p.lower_95)} … {number(p.upper_95)}"
                if math.isfinite(p.upper_95 - p.lower_95)
                else NONE,
            }
            for p in parameters
        ],
        "plot": plot_cycle(shown.samples, narrow=True) if shown.samples is not None else "",
        "why": shown.why,
    }


def report_bar(valve: str, visitor: Visitor) -> str:
    """Return what stands above a report of a valve that is served: the way back, and languages."""
    return _page("report_bar.html", visitor, valve=valve, link="valve/" + link_of(valve))


def login_page(visitor: Visitor, following: str, wrong: str = "") -> str:
    """Return the page that asks for name and password.

    Parameters
    ----------
    visitor : Visitor
        For whom.
    following : str
        Where he goes on.
    wrong : str
        What was wrong the last time.
    """
    return _page("login.html", visitor, next=following, wrong=wrong)


def message_page(title: str, text: str, visitor: Visitor) -> str:
    """Return a page that says one thing.

    Parameters
    ----------
    title, text : str
        What is said; escaped.
    visitor : Visitor
        To whom.
    """
    return _page("message.html", visitor, title=title, text=text)
