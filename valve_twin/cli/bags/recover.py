# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin recover`: rewrite a damaged bag as a sound one and verify it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_bag, add_verb
from valve_twin.cli.output import write

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.io.offline.recover import Recovery


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "recover", "Rewrite what is intact of a bag, verify it, say what is lost.", _recover
    )
    add_bag(parser)
    parser.add_argument("--out", required=True, metavar="NEW", help="bag folder to make")
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object")


def _recover(arguments: argparse.Namespace) -> int:
    from valve_twin.io.offline.recover import recover

    found = recover(arguments.bag, arguments.out)
    lines = [json.dumps(_as_map(found))] if arguments.json else _lines(found)
    write("".join(f"{line}\n" for line in lines))
    return OK


def _as_map(found: Recovery) -> dict[str, object]:
    return {
        "out": str(found.out),
        "messages": found.count,
        "topics": found.topics,
        "lost_messages": found.lost_count,
        "lost": found.lost,
        "unverified_messages": found.unverified,
        "unverified_not_finite": found.suspects,
        "losses": [loss.as_map() for loss in found.losses],
        "notes": list(found.notes),
    }


def _lines(found: Recovery) -> list[str]:
    lines = [*found.notes, *(loss.line() for loss in found.losses)]
    if found.unverified:
        lines.append(
            f"{found.out}: no check sum stands for the values of {found.unverified} messages; "
            f"{found.suspects} of them hold values that are not finite"
        )
    if found.lost_count is None:
        lost = "an unknown number of messages is lost"
    elif found.lost_count:
        lost = f"{found.lost_count} messages are lost"
    else:
        lost = "none is lost"
    topics = ", ".join(f"{name} ({n})" for name, n in sorted(found.topics.items()))
    lines.append(f"{found.out}: {found.count} messages written and verified: {topics}; {lost}")
    return lines
