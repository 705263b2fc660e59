# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin validate`: the published numbers of the source papers beside ours."""

from __future__ import annotations

import json
import math
import sys
from typing import TYPE_CHECKING

from valve_twin.cli.common import FAILED, OK, USAGE, add_verb, fail, progress_of
from valve_twin.io.errors import suggest
from valve_twin.validation import Verdict, get_paper, paper_numbers

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.validation import Check

_WIDTH = 160
_COLOURS = {Verdict.PASS: "green", Verdict.FAIL: "bold red", Verdict.CANNOT: "yellow"}


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "validate",
        "Recompute the papers' published numbers; ends with 1 if one that can be does not agree.",
        _validate,
    )
    known = ", ".join(paper_numbers())
    parser.add_argument("paper", nargs="*", metavar="PAPER", help=f"default all: {known}")
    parser.add_argument("--json", action="store_true", help="one JSON object a comparison")


def _validate(arguments: argparse.Namespace) -> int:
    wanted = list(dict.fromkeys(arguments.paper)) or list(paper_numbers())
    for number in wanted:
        if number not in paper_numbers():
            text = suggest(number, paper_numbers())
            return fail(f"validate: there is no paper '{number}'; {text}", USAGE)
    failed = 0
    for number in wanted:
        paper = get_paper(number)
        with progress_of(f"validating {number}", paper.steps) as advance:
            checks = paper.recompute(advance)
        failed += sum(check.verdict is Verdict.FAIL for check in checks)
        if arguments.json:
            for check in checks:
                sys.stdout.write(f"{json.dumps(_plain(number, check), allow_nan=False)}\n")
        else:
            _show(f"Paper {number}: {paper.title}", checks)
    return FAILED if failed else OK


def _plain(number: str, check: Check) -> dict[str, object]:
    """Return a comparison as plain data: not known or not bound = null."""
    return {
        "paper": number,
        "item": check.item,
        "quantity": check.quantity,
        "published": check.published,
        "obtained": _finite(check.obtained),
        "lower": _finite(check.lower),
        "upper": _finite(check.upper),
        "tolerance": check.tolerance,
        "verdict": check.verdict.name,
        "note": check.note,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _show(title: str, checks: Sequence[Check]) -> None:
    """Print the table, then how many agree."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(file=sys.stdout)
    if not console.is_terminal:
        console = Console(file=sys.stdout, width=_WIDTH)
    table = Table(title=title, title_justify="left", pad_edge=False)
    table.add_column("quantity", max_width=40)
    for name in ("published", "obtained", "tolerance"):
        table.add_column(name, justify="right")
    table.add_column("verdict", no_wrap=True)
    table.add_column("how, or why not", max_width=60)
    item = ""
    for check in checks:
        if check.item != item:
            item = check.item
            table.add_section()
            table.add_row(Text(item, style="bold"))
        table.add_row(
            Text(f"  {check.quantity}"),  # not a string: rich takes "[s]" for markup
            _number(check.published),
            _number(check.obtained),
            check.tolerance,
            Text(check.verdict.value, style=_COLOURS[check.verdict]),
            Text(check.note),
        )
    console.print(table)
    counts = {v: sum(c.verdict is v for c in checks) for v in Verdict}
    console.print(
        f"{counts[Verdict.PASS]} agree, {counts[Verdict.FAIL]} do not, "
        f"{counts[Verdict.CANNOT]} cannot be reproduced",
        highlight=False,
    )


def _number(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.4g}" if math.isfinite(value) else "-"
