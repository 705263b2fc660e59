# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin fleet`: the valves of a history, the most urgent first."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

from valve_twin.cli.common import FAILED, OK, add_url, add_verb, fail, progress_of
from valve_twin.cli.output import console, number, plain, print_json, table
from valve_twin.core.aging.verdict import VerdictKind

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.io.history.fleet import FleetRow

_ORDERS = ("urgency", "drift", "residual", "confidence", "name")
_COLOURS = {
    VerdictKind.OK: "green",
    VerdictKind.NOT_ENOUGH_DATA: "dim",
    VerdictKind.NO_REFERENCE: "dim",
}


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "fleet", "Rank the valves of a history by drift, residual and confidence.", _fleet
    )
    add_url(parser)
    parser.add_argument(
        "--config",
        metavar="FILE",
        help="YAML of the valves, for their service limits; default the usual ones",
    )
    parser.add_argument(
        "--sort", choices=_ORDERS, default="urgency", help="worst first by this, default urgency"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object a valve")
    parser.add_argument(
        "--check", action="store_true", help="exit code 1 where a valve needs attention"
    )


def _fleet(arguments: argparse.Namespace) -> int:
    from valve_twin.io.history.fleet import FleetOrder, rank_fleet
    from valve_twin.io.history.store import History

    aging = aging_rules(arguments.config)
    with (
        History(arguments.url, read_only=True) as history,
        progress_of("assessing", len(history.valves())) as advance,
    ):
        order = FleetOrder(arguments.sort)
        rows = rank_fleet(history, aging=aging, order=order, on_valve=advance)
        where = history.where
    if not rows:
        return fail(f"{where}: holds no valve; let a twin store its cycles there")
    if arguments.json:
        for place, row in enumerate(rows, 1):
            print_json(_plain(place, row))
    else:
        _show(rows, where)
    return FAILED if arguments.check and any(row.needs_attention for row in rows) else OK


def aging_rules(path: str | None) -> dict[str, AgingConfig]:
    """Return the rules of aging of a YAML of valves, by name of the valve; none without a file."""
    if not path:
        return {}
    from valve_twin.io.config.valve import load_config

    return {config.name: config.aging for config in load_config(path)}


def nameplates(path: str | None) -> dict[str, dict[str, str]]:
    """Return what a YAML gives of nameplates, by name of the valve; none without a file."""
    if not path:
        return {}
    from valve_twin.io.config.valve import load_config

    return {config.name: config.nameplate.given for config in load_config(path)}


def _plain(place: int, row: FleetRow) -> dict[str, object]:
    """Return a row as plain data: not known = null, unbounded = "Infinity"."""
    fields: dict[str, object] = {"kind": "valve", "rank": place}
    for field in dataclasses.fields(row):
        value = getattr(row, field.name)
        if isinstance(value, VerdictKind):
            value = value.name
        fields[field.name] = plain(value)
    fields["needs_attention"] = row.needs_attention
    return fields


def _word(row: FleetRow) -> str:
    """Return the verdict and, below an "ok", of what nothing is said."""
    return row.verdict.text + (f"\nnot judged: {row.unjudged}" if row.unjudged else "")


def _show(rows: Sequence[FleetRow], where: str) -> None:
    """Print the table that a maintenance engineer reads at a glance."""
    from rich.text import Text

    from valve_twin.core.operation.stroke_due import StrokeDue

    urgent = sum(row.needs_attention for row in rows)
    title = f"{where}: {len(rows)} valves, {urgent} need attention"
    shown = table(title, ("valve", "verdict", "NE 107"))
    shown.add_column("worst")
    for name in ("change [%]", "95 %", "to limit", "service", "residual", "trusted", "cycle"):
        shown.add_column(name, justify="right", no_wrap=name != "95 %")
    shown.add_column("why", ratio=1, min_width=30)
    for row in rows:
        colour = _COLOURS.get(row.verdict, "bold red")
        shown.add_row(
            row.valve,
            Text(_word(row), style=colour),
            f"{row.ne107}\n{row.limit_state}".rstrip(),
            row.parameter or "-",
            number(row.drift, "+.1f"),
            f"{number(row.drift_lower_95, '+.1f')} .. {number(row.drift_upper_95, '+.1f')}",
            f"{max(row.way, 0.0):.0%}" if math.isfinite(row.way) else "-",
            _service(row),
            _residual(row),
            f"{row.confidence:.0%}",
            str(row.cycle),
            Text(row.evidence if row.needs_attention or not row.parameter else ""),
        )
    console().print(shown)
    for row in rows:
        due = StrokeDue(
            row.stroke_test_ns, row.stroke_test, row.stroke_days_since, row.stroke_days_until
        )
        if due.words:
            console().print(Text(f"{row.valve}: stroke test {due.verdict}, {due.words}"))


def _service(row: FleetRow) -> str:
    """Return the date, else what remains."""
    if row.service_date_ns:
        from valve_twin.report.text import utc

        return utc(row.service_date_ns).strftime("%Y-%m-%d")
    return f"{row.remaining:.0f} {row.axis}" if math.isfinite(row.remaining) else "-"


def _residual(row: FleetRow) -> str:
    """Return the residual and how many times that of the first cycles it is."""
    if not math.isfinite(row.residual):
        return "-"
    ratio = f" ({row.residual_ratio:.1f}x)" if math.isfinite(row.residual_ratio) else ""
    return f"{row.residual:.1e}{ratio}"
