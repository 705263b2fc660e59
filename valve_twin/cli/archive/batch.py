# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin batch`: estimate every bag of an archive."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    FAILED,
    OK,
    add_config,
    add_runner,
    add_verb,
    ends_as_interrupted,
    progress_of,
    runner_of,
    say,
)
from valve_twin.cli.output import console, table
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.io.batch.results import BagResult, Results
    from valve_twin.io.config.valve import ValveConfig

_WIDTH = 140  # columns where standard output is no terminal


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "batch",
        "Estimate every bag of an archive; run it again to go on after an interruption.",
        _batch,
    )
    parser.add_argument("folder", metavar="DIR", help="archive; bags are looked for in it")
    add_config(parser)
    parser.add_argument("--out", required=True, metavar="FOLDER", help="folder of the results")
    add_runner(parser, "its workers must see DIR")


def _batch(arguments: argparse.Namespace) -> int:
    from valve_twin.io.batch.archive import estimate_task, find_bags, lost_bag, run_batch
    from valve_twin.io.batch.results import BatchTask, Results

    configs = _configs(arguments)
    bags = find_bags(arguments.folder)
    tasks = [BatchTask(name, str(path.resolve()), configs) for name, path in bags]
    results = Results(arguments.out)
    ends_as_interrupted()
    run = runner_of(arguments, estimate_task, lost_bag)
    found: list[BagResult] = []
    try:
        with progress_of("estimating", len(tasks)) as advance:
            for result in run_batch(tasks, results, run):
                found.append(result)
                _tell(result)
                advance()
    except KeyboardInterrupt:
        done = f"{len(found)} of {len(tasks)} bags are done"
        say(f"valve-twin: interrupted: {done}; the same command goes on from there")
        return FAILED
    found.sort(key=lambda result: result.name)
    _write_summary(results, found)
    _show(found)
    return FAILED if any(result.error for result in found) else OK


def _configs(arguments: argparse.Namespace) -> tuple[ValveConfig, ...]:
    """Return the wanted valve, else every valve of the file."""
    from valve_twin.cli.common import chosen_config
    from valve_twin.io.config.valve import load_config

    if arguments.valve:
        return (chosen_config(arguments),)
    return tuple(load_config(arguments.config))


def _tell(result: BagResult) -> None:
    if result.error:
        say(f"valve-twin: {result.error}")
    elif not result.kept:
        for line in result.notes:
            say(f"valve-twin: {line}")


_COLUMNS = ("bag", "state", "valves", "cycles", "accepted", "estimates", "verdict", "error")


def _cells(result: BagResult) -> tuple[str, ...]:
    state = "failed" if result.error else "kept" if result.kept else "done"
    return (
        result.name,
        state,
        str(len(result.valves)),
        str(result.cycles),
        str(result.accepted),
        str(result.estimates),
        ", ".join(dict.fromkeys(result.verdicts)),
        result.error,
    )


def _write_summary(results: Results, found: Sequence[BagResult]) -> None:
    """Write summary.csv: the table without the column that differs between two runs."""
    from valve_twin.io.limits import no_formula

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keep = [i for i, name in enumerate(_COLUMNS) if name != "state"]
    writer.writerow([_COLUMNS[i] for i in keep])
    for result in found:
        cells = _cells(result)
        writer.writerow([no_formula(cells[i]) for i in keep])
    write_whole(results.folder / "summary.csv", text.getvalue())


def _show(found: Sequence[BagResult]) -> None:
    from rich.text import Text

    failed = sum(bool(result.error) for result in found)
    kept = sum(result.kept for result in found)
    title = f"{len(found)} bags: {len(found) - failed - kept} done, {kept} kept, {failed} failed"
    shown = table(title)
    for name in _COLUMNS:
        counted = name in ("valves", "cycles", "accepted", "estimates")
        shown.add_column(name, justify="right" if counted else "left")
    for result in found:
        style = "bold red" if result.error else "dim" if result.kept else ""
        shown.add_row(*(Text(cell, style=style) for cell in _cells(result)))
    console(_WIDTH).print(shown)
