# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin history`: back up, export, list or verify the history; withdraw a mark."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from valve_twin.cli.common import FAILED, OK, add_url, add_verb, cycle_number, fail, say

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.io.history.store import History


def add(verbs: Verbs) -> None:
    """Add the verb."""
    text = "Back up, export, list or verify the history database; withdraw a maintenance event."
    parser = add_verb(verbs, "history", text, _history)
    parser.add_argument(
        "action", choices=("backup", "export", "list", "maintenance", "verify", "withdraw")
    )
    add_url(parser)
    parser.add_argument("--out", default="", help="file (backup) or folder (export) to write")
    parser.add_argument(
        "--valve", default="", metavar="NAME", help="whose events (maintenance, withdraw)"
    )
    parser.add_argument(
        "--cycle",
        type=cycle_number,
        metavar="N",
        help="first cycle of the segment that the event began (withdraw)",
    )
    parser.add_argument(
        "--note", default="", metavar="TEXT", help="why it is withdrawn (withdraw)"
    )


def _history(arguments: argparse.Namespace) -> int:
    from valve_twin.io.history.store import History

    with History(arguments.url, read_only=True) as history:
        if arguments.action == "backup":
            say(f"{history.backup(arguments.out)}: written")
        elif arguments.action == "export":
            for path in history.export(arguments.out or "history_export"):
                say(f"{path}: written")
        elif arguments.action == "verify":
            found = history.verify()
            sys.stdout.write("".join(f"{line}\n" for line in found.damaged))
            sys.stdout.write(f"{found.rows} rows, {len(found.damaged)} damaged\n")
            return FAILED if found.damaged else OK
        elif arguments.action == "list":
            for valve in history.valves():
                sys.stdout.write(f"{valve}: last cycle {history.last_cycle(valve)}\n")
        elif arguments.action == "maintenance":
            for valve in _chosen(history, arguments.valve):
                _show_events(history, valve)
        else:
            (valve,) = _chosen(history, arguments.valve, one=True)
            return _withdraw(arguments, valve)
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


def _show_events(history: History, valve: str) -> None:
    """Print the maintenance events of a valve, a line each: notes may hold any text."""
    for event in history.maintenance(valve):
        begins = "a new segment and a new reference" if event.new_reference else "a new segment"
        why = f"withdrawn: {event.withdrawn_note!a}" if event.withdrawn else f"begins {begins}"
        sys.stdout.write(f"{valve}: cycle {event.cycle}: {event.note!a}, {why}\n")


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
