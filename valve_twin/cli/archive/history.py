# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin history`: back up, export, list or verify the history database."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from valve_twin.cli.common import FAILED, OK, add_url, add_verb, say

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "history", "Back up, export, list or verify the history database.", _history
    )
    parser.add_argument("action", choices=("backup", "export", "list", "verify"))
    add_url(parser)
    parser.add_argument("--out", default="", help="file (backup) or folder (export) to write")


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
        else:
            for valve in history.valves():
                sys.stdout.write(f"{valve}: last cycle {history.last_cycle(valve)}\n")
    return OK
