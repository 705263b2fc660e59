# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin validate`: the papers' published numbers beside ours, and benchmarks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.cli.common import FAILED, OK, USAGE, add_verb, fail, progress_of
from valve_twin.cli.output import console, number, plain, print_json, table
from valve_twin.core.quantity import suggest
from valve_twin.validation import (
    Verdict,
    benchmark_names,
    counted,
    get_benchmark,
    get_paper,
    paper_numbers,
)

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping, Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.validation import Check

_WIDTH = 172
_COLOURS = {Verdict.PASS: "green", Verdict.FAIL: "bold red", Verdict.CANNOT: "yellow"}


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "validate",
        "Recompute the papers' published numbers; ends with 1 if one that can be does not agree.",
        _validate,
    )
    known, others = ", ".join(paper_numbers()), ", ".join(benchmark_names())
    parser.add_argument(
        "paper",
        nargs="*",
        metavar="PAPER",
        help=f"default all: {known}; or a benchmark, which takes minutes: {others}",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object a comparison")


def _validate(arguments: argparse.Namespace) -> int:
    wanted = list(dict.fromkeys(arguments.paper)) or list(paper_numbers())
    for name in wanted:
        if name not in (*paper_numbers(), *benchmark_names()):
            text = suggest(name, (*paper_numbers(), *benchmark_names()))
            return fail(f"validate: there is no paper '{name}'; {text}", USAGE)
    failed = 0
    for name in wanted:
        if name in benchmark_names():
            failed += _run_benchmark(name, as_json=arguments.json)
            continue
        paper = get_paper(name)
        with progress_of(f"validating {name}", paper.steps) as advance:
            checks = paper.recompute(advance)
        failed += sum(check.verdict is Verdict.FAIL for check in checks)
        if arguments.json:
            for check in checks:
                print_json(_plain(name, check))
        else:
            _show(f"Paper {name}: {paper.title}", checks)
    return FAILED if failed else OK


def _run_benchmark(name: str, *, as_json: bool) -> int:
    """Run a benchmark and print what it found; return how many of its checks failed."""
    benchmark = get_benchmark(name)
    with progress_of(f"running {name}", benchmark.steps) as advance:
        found = benchmark.run(advance)
    if as_json:
        for title, rows in found.tables.items():
            for row in rows:
                print_json({"benchmark": name, "table": title, **_plain_row(row)})
        for check in found.checks:
            print_json(_plain(name, check))
    else:
        for title, rows in found.tables.items():
            _show_rows(title, rows)
        _show(f"Benchmark {name}: {benchmark.title}", found.checks)
    return sum(check.verdict is Verdict.FAIL for check in found.checks)


def _plain_row(row: Mapping[str, float | str]) -> dict[str, object]:
    return {key: plain(value, None) for key, value in row.items()}


def _show_rows(title: str, rows: Sequence[Mapping[str, float | str]]) -> None:
    """Print a table of a benchmark."""
    from rich.text import Text

    words = [key for key, value in rows[0].items() if isinstance(value, str)]
    shown = table(title)
    for key in rows[0]:
        shown.add_column(key, justify="left" if key in words else "right", max_width=44)
    for row in rows:
        shown.add_row(*(Text(v if isinstance(v, str) else number(v, ".3g")) for v in row.values()))
    console(_WIDTH).print(shown)


def _plain(paper: str, check: Check) -> dict[str, object]:
    """Return a comparison as plain data: not known or not bound = null."""
    names = ("item", "quantity", "published", "obtained", "lower", "upper", "tolerance")
    values = {name: plain(getattr(check, name), None) for name in names}
    words = {"kind": check.kind.value, "verdict": check.verdict.name, "note": check.note}
    return {"paper": paper, **values, **words}


def _show(title: str, checks: Sequence[Check]) -> None:
    """Print the table, then how many agree."""
    from rich.text import Text

    out = console(_WIDTH)
    shown = table(title)
    shown.add_column("quantity", max_width=40)
    for name in ("published", "obtained", "tolerance"):
        shown.add_column(name, justify="right")
    shown.add_column("kind", no_wrap=True)
    shown.add_column("verdict", no_wrap=True)
    shown.add_column("how, or why not", max_width=60)
    item = ""
    for check in checks:
        if check.item != item:
            item = check.item
            shown.add_section()
            shown.add_row(Text(item, style="bold"))
        shown.add_row(
            Text(f"  {check.quantity}"),  # not a string: rich takes "[s]" for markup
            *(
                v if isinstance(v, str) else number(v, ".4g")
                for v in (check.published, check.obtained)
            ),
            check.tolerance,
            check.kind.value,
            Text(check.verdict.value, style=_COLOURS[check.verdict]),
            Text(check.note),
        )
    out.print(shown)
    out.print(counted(checks), highlight=False)
