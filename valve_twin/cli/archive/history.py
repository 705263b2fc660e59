# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin history`: back up, condense, export, verify; events, counters, marks, views."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    FAILED,
    OK,
    add_url,
    add_verb,
    cycle_number,
    fail,
    progress_of,
    say,
)
from valve_twin.cli.output import print_json, write

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.io.history.store import History


def add(verbs: Verbs) -> None:
    """Add the verb."""
    text = "Back up, condense, export, list, verify the history; its events, counters and marks."
    parser = add_verb(verbs, "history", text, _history)
    parser.add_argument(
        "action",
        choices=(
            "acknowledge",
            "backup",
            "condense",
            "counters",
            "events",
            "export",
            "list",
            "maintenance",
            "verify",
            "views",
            "withdraw",
        ),
    )
    add_url(parser)
    parser.add_argument("--out", default="", help="file (backup) or folder (export) to write")
    parser.add_argument(
        "--valve", default="", metavar="NAME", help="whose (all that list or change)"
    )
    parser.add_argument(
        "--cycle",
        type=cycle_number,
        metavar="N",
        help="first cycle of the segment that the event began (withdraw)",
    )
    parser.add_argument(
        "--note",
        default="",
        metavar="TEXT",
        help="why it is withdrawn (withdraw), or what is said to it (acknowledge)",
    )
    parser.add_argument(
        "--id", type=int, default=0, metavar="N", help="entry (acknowledge), 0 = all open ones"
    )
    parser.add_argument(
        "--reader", default="", metavar="ROLE", help="role of PostgreSQL that may read the views"
    )
    parser.add_argument("--who", default="", metavar="NAME", help="who has seen it (acknowledge)")
    parser.add_argument(
        "--open", action="store_true", help="only what nobody has acknowledged (events)"
    )
    parser.add_argument(
        "--json", action="store_true", help="a JSON object a line (events, counters)"
    )
    parser.add_argument(
        "--keep-cycles",
        type=int,
        default=0,
        metavar="N",
        help="newest cycles of a valve that are kept one by one (condense)",
    )
    parser.add_argument(
        "--keep-days",
        type=float,
        default=0.0,
        metavar="D",
        help="age up to which cycles are kept one by one [d] (condense)",
    )
    parser.add_argument(
        "--hours-for-days",
        type=float,
        default=90.0,
        metavar="D",
        help="age up to which hours are kept beside days [d] (condense; default 90)",
    )


def _history(arguments: argparse.Namespace) -> int:
    from valve_twin.io.history.store import History

    if arguments.action == "views":
        return _make_views(arguments)
    if arguments.action == "condense":
        return _condense(arguments)

    with History(arguments.url, read_only=True) as history:
        if arguments.action == "backup":
            say(f"{history.backup(arguments.out)}: written")
        elif arguments.action == "export":
            for path in history.export(arguments.out or "history_export"):
                say(f"{path}: written")
        elif arguments.action == "verify":
            found = history.verify()
            write("".join(f"{line}\n" for line in found.damaged))
            write(f"{found.rows} rows, {len(found.damaged)} damaged\n")
            return FAILED if found.damaged else OK
        elif arguments.action == "list":
            for valve in history.valves():
                write(f"{valve}: last cycle {history.last_cycle(valve)}")
                write(f"{_condensed_note(history, valve)}\n")
        elif arguments.action in _SHOWN:
            for valve in _chosen(history, arguments.valve):
                _SHOWN[arguments.action](history, valve, arguments)
        elif arguments.action == "acknowledge":
            (valve,) = _chosen(history, arguments.valve, one=True)
            return _acknowledge(arguments, valve)
        else:
            (valve,) = _chosen(history, arguments.valve, one=True)
            return _withdraw(arguments, valve)
    return OK


def _condensed_note(history: History, valve: str) -> str:
    from valve_twin.io.history.tiers.extent import condensed, told

    found = condensed(history, valve)
    return f"; {told(found)}" if found else ""


def _condense(arguments: argparse.Namespace) -> int:
    from valve_twin.io.errors import ConfigError
    from valve_twin.io.history.database import must_be_there
    from valve_twin.io.history.store import History
    from valve_twin.io.history.tiers.condense import condense
    from valve_twin.io.history.tiers.retention import Retention

    retention = Retention(arguments.keep_cycles, arguments.keep_days, arguments.hours_for_days)
    if wrong := retention.wrong():
        msg = f"history condense: {wrong}: --keep-cycles, --keep-days"
        raise ConfigError(msg)
    must_be_there(arguments.url)
    with History(arguments.url) as history:
        for valve in _chosen(history, arguments.valve):
            with progress_of(f"{valve}: cycles condensed", None) as advance:
                condense(history, valve, retention, lambda _: advance())
            say(
                f"{valve}: last cycle {history.last_cycle(valve)}{_condensed_note(history, valve)}"
            )
    return OK


def _make_views(arguments: argparse.Namespace) -> int:
    from valve_twin.io.history.database import Database
    from valve_twin.io.history.views.make import make_views

    database = Database(arguments.url)
    try:
        for name in make_views(database, arguments.reader):
            say(f"{name}: made")
    finally:
        database.close()
    return OK


def _chosen(history: History, name: str, *, one: bool = False) -> list[str]:
    """Return the valves of a history that are meant: all where none is named, unless `one` is."""
    from valve_twin.io.errors import ConfigError

    known = history.valves()
    wanted = "/" + name.strip("/")
    found = [wanted] if name else known
    if (one and len(found) != 1) or not set(found) <= set(known):
        what = f"there is no valve '{wanted}'" if name else "it is not said of which valve"
        msg = f"{history.where}: {what}: give --valve, one of {', '.join(known) or 'none'}"
        raise ConfigError(msg)
    return found


def _show_events(history: History, valve: str, arguments: argparse.Namespace) -> None:
    """Print the maintenance events of a valve, a line each: notes may hold any text."""
    del arguments
    for event in history.maintenance(valve):
        begins = "a new segment and a new reference" if event.new_reference else "a new segment"
        why = f"withdrawn: {event.withdrawn_note!a}" if event.withdrawn else f"begins {begins}"
        write(f"{valve}: cycle {event.cycle}: {event.note!a}, {why}\n")


def _withdraw(arguments: argparse.Namespace, valve: str) -> int:
    from valve_twin.io.errors import ConfigError, StoreError
    from valve_twin.io.history.store import History

    if arguments.cycle is None:
        msg = "history withdraw: --cycle is missing: `valve-twin history maintenance` lists events"
        raise ConfigError(msg)
    with History(arguments.url) as history:
        try:
            history.claim(valve)
        except StoreError as err:
            text = f"{err}; or withdraw it there: {valve}/twin/withdraw_maintenance"
            return fail(text, FAILED)
        event = history.withdraw_maintenance(valve, arguments.cycle, arguments.note)
    say(f"{valve}: the event at cycle {event.cycle} ({event.note!a}) is withdrawn")
    return OK


def _show_log(history: History, valve: str, arguments: argparse.Namespace) -> None:
    """Print the event log of a valve, a line an entry: texts may hold anything."""
    from valve_twin.core.records import flat
    from valve_twin.report.text import when

    for event in history.log.events(valve, open_only=arguments.open):
        if arguments.json:
            print_json({"kind": "event", **flat(event)})
            continue
        seen = f", seen by {event.acknowledged_by!a}" if event.acknowledged else ""
        state = f"{event.status}{', open' if event.is_open else seen}"
        write(
            f"{valve}: {event.id}: {when(event.stamp_ns)}, cycle {event.cycle}: {event.code} "
            f"({state}): {event.text!a}\n"
        )


def _show_counters(history: History, valve: str, arguments: argparse.Namespace) -> None:
    """Print what a valve has done."""
    from valve_twin.io.tables.json_lines import counters_fields

    counters = history.log.counters(valve)
    if counters is None:
        write("" if arguments.json else f"{valve}: nothing is counted yet\n")
    elif arguments.json:
        print_json(counters_fields(valve, counters))
    else:
        hours, opened, closed, near = counters.hours
        write(
            f"{valve}: {counters.cycles} cycles, {counters.movements} movements, "
            f"{counters.reversals} reversals, {counters.starts} starts, travel "
            f"{counters.travel:.6g} ({counters.strokes:.6g} strokes), {hours:.6g} h in cycles: "
            f"{opened:.6g} h open, {near:.6g} h of them near closed, {closed:.6g} h closed\n"
        )


_SHOWN = {"maintenance": _show_events, "events": _show_log, "counters": _show_counters}
"""What is printed of each valve, by action."""


def _acknowledge(arguments: argparse.Namespace, valve: str) -> int:
    from valve_twin.io.history.log.events import Acknowledgement
    from valve_twin.io.history.store import History

    by = Acknowledgement(arguments.who, arguments.note, time.time_ns())
    with History(arguments.url) as history:
        seen = history.log.acknowledge(valve, arguments.id, by)
    say(f"{valve}: {seen} entries are acknowledged now")
    return OK
