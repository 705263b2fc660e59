# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The pages of the gateway as HTML, and a row as plain data."""

from __future__ import annotations

import math
from dataclasses import asdict
from functools import cache
from typing import TYPE_CHECKING
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined

from valve_twin.core.aging.verdict import outlook
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.report.text import day, render, when

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.aging import Trend
    from valve_twin.gateway.plant import View
    from valve_twin.io.history.fleet import FleetRow

RELOAD_S = 5
"""A page asks anew so often [s]."""

SIGNS = {
    Ne107.FAILURE: "F",
    Ne107.CHECK_FUNCTION: "C",
    Ne107.OUT_OF_SPECIFICATION: "S",
    Ne107.MAINTENANCE_REQUIRED: "M",
    Ne107.GOOD: "\N{CHECK MARK}",
}


@cache
def _templates() -> Environment:
    made = Environment(
        loader=PackageLoader("valve_twin.gateway"), autoescape=True, undefined=StrictUndefined
    )
    made.globals["style"] = render("style.css")
    return made


def fleet_page(view: View, now_ns: int) -> str:
    """Return the page of all valves, worst first.

    Parameters
    ----------
    view : View
        What the history holds.
    now_ns : int
        When the page is made [ns since 1970].
    """
    rows = [_cells(row) for row in view.rows]
    counts = {s: sum(row.ne107 == s.value for row in view.rows) for s in Ne107}
    return (
        _templates()
        .get_template("fleet.html")
        .render(
            view=view,
            rows=rows,
            counts=[(SIGNS[s], s.name.lower(), s.value, n) for s, n in counts.items() if n],
            read=when(view.read_ns) if view.read_ns else "",
            age_s=round((now_ns - view.read_ns) * 1e-9) if view.read_ns else None,
            reload_s=RELOAD_S,
        )
    )


def _cells(row: FleetRow) -> dict[str, str]:
    state = Ne107(row.ne107)
    known = math.isfinite(row.drift)
    interval = f"{row.drift_lower_95:+.1f} .. {row.drift_upper_95:+.1f}"
    left = f"{row.remaining:.0f} {row.axis}" if math.isfinite(row.remaining) else "-"
    return {
        "valve": row.valve,
        "link": "valve/" + quote(row.valve.lstrip("/")),
        "sign": SIGNS[state],
        "style": state.name.lower(),
        "state": state.value,
        "verdict": row.verdict.text,
        "why": row.evidence,
        "action": row.action,
        "worst": f"{row.parameter} {row.drift:+.1f} %" if known else "-",
        "interval": interval if math.isfinite(row.drift_lower_95) else "",
        "way": f"{max(row.way, 0.0):.0%}" if math.isfinite(row.way) else "-",
        "limit": row.limit_state,
        "service": day(row.service_date_ns) if row.service_date_ns else left,
        "cycle": str(row.cycle),
        "end": when(row.end_ns) if row.end_ns else "",
    }


def message_page(title: str, text: str) -> str:
    """Return a page that says one thing.

    Parameters
    ----------
    title, text : str
        What is said; escaped.
    """
    return _templates().get_template("message.html").render(title=title, text=text)


def plain_valve(view: View, row: FleetRow) -> dict[str, object]:
    """Return a valve as plain data: a number that is not known or unbounded is null.

    Parameters
    ----------
    view : View
        What the history holds.
    row : FleetRow
        The valve's row in it.
    """
    trends = view.trends.get(row.valve, ())
    found: dict[str, object] = {**asdict(row), "verdict": row.verdict.text}
    plate = dict(view.nameplates.get(row.valve, {}))
    parameters = [_plain_trend(t) for t in trends]
    return {**_known(found), "nameplate": plate, "parameters": parameters}


_OF_TREND = {
    "parameter": "parameter",
    "unit": "unit",
    "level": "level",
    "lower_95": "mean_lower_95",
    "upper_95": "mean_upper_95",
    "reference": "reference",
    "threshold": "threshold",
    "warning": "warning",
    "drift": "drift_reference",
    "drift_lower_95": "drift_reference_lower_95",
    "drift_upper_95": "drift_reference_upper_95",
    "remaining_low": "remaining_low",
    "remaining": "remaining_median",
    "remaining_high": "remaining_high",
    "axis": "axis",
    "reason": "reason",
}
"""Keys of a parameter in JSON by the fields of its trend."""


def _plain_trend(trend: Trend) -> dict[str, object]:
    """Return a parameter as plain data; what remains is null where no forecast is told."""
    said = outlook(trend)
    found = {key: getattr(trend, name) for key, name in _OF_TREND.items()}
    if not said.says_when:
        found["remaining"] = math.inf
    return {**_known(found), "outlook": said.value, "limit_state": trend.limit_state.text}


def _known(values: Mapping[str, object]) -> dict[str, object]:
    return {
        name: None if isinstance(v, float) and not math.isfinite(v) else v
        for name, v in values.items()
    }
