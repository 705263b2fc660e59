# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin batch`: estimate every bag of an archive."""

from __future__ import annotations

import csv
import io
import signal
import threading
from typing import TYPE_CHECKING

from valve_twin.cli.common import FAILED, OK, add_config, add_verb, positive, progress_of, say
from valve_twin.cli.output import console, table

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable, Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.io.batch.archive import Runner
    from valve_twin.io.batch.results import BagResult, BatchTask, Results
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
    parser.add_argument("--jobs", type=positive, metavar="N", help="processes, default one a core")
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="run on this Dask cluster, such as tcp://host:8786; its workers must see DIR",
    )


def _batch(arguments: argparse.Namespace) -> int:
    from valve_twin.io.batch.archive import find_bags, run_batch
    from valve_twin.io.batch.results import BatchTask, Results

    configs = _configs(arguments)
    bags = find_bags(arguments.folder)
    tasks = [BatchTask(name, str(path.resolve()), configs) for name, path in bags]
    results = Results(arguments.out)
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends as Ctrl-C does
    found: list[BagResult] = []
    try:
        with progress_of("estimating", len(tasks)) as advance:
            for result in run_batch(tasks, results, _runner(arguments)):
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


def _runner(arguments: argparse.Namespace) -> Runner:
    from valve_twin.io.batch.runners import ClusterRunner, LocalRunner, core_count

    if not arguments.scheduler:
        return LocalRunner(arguments.jobs or core_count())

    def on_cluster(tasks: Sequence[BatchTask]) -> Iterable[BagResult]:
        """Connect only when something is left to do."""
        return ClusterRunner(arguments.scheduler)(tasks)

    return on_cluster


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
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keep = [i for i, name in enumerate(_COLUMNS) if name != "state"]
    writer.writerow([_COLUMNS[i] for i in keep])
    for result in found:
        cells = _cells(result)
        writer.writerow([cells[i] for i in keep])
    (results.folder / "summary.csv").write_text(text.getvalue(), encoding="utf-8")


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
