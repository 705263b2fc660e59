# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Re-estimate an archive of bags: one task a bag, resumable, on this machine or on a cluster.

Tasks share nothing: where and in which order they run changes no bit.
"""

from __future__ import annotations

import dataclasses
import logging
import os
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.bags.read import bag_info
from valve_twin.io.batch.results import BagResult, BatchTask, digest_of, file_marks
from valve_twin.io.errors import BagError, ValveTwinError
from valve_twin.io.offline.run import assess_record, describe_bad, run_bag
from valve_twin.io.tables.json_lines import json_lines

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from valve_twin.io.batch.results import Results
    from valve_twin.io.config.valve import ValveConfig

    Runner = Callable[[Sequence["BatchTask"]], Iterable["BagResult"]]

_METADATA = "metadata.yaml"


def find_bags(folder: str | Path) -> list[tuple[str, Path]]:
    """Return name and path of every bag below a folder, sorted by name.

    A folder with metadata.yaml is one bag; elsewhere each .mcap file is one.

    Raises
    ------
    BagError
        If there is no such folder, or no bag below it.
    """
    root = Path(folder)
    if not root.is_dir():
        msg = f"{root}: is no folder; give the folder of the archive"
        raise BagError(msg)
    found: list[tuple[str, Path]] = []
    for place, folders, names in os.walk(root):
        here = Path(place)
        if _METADATA in names:
            folders.clear()
            own = here.relative_to(root).as_posix()
            found.append((root.resolve().name if own == "." else own, here))
            continue
        files = [here / name for name in names if name.endswith(".mcap")]
        found += [(file.relative_to(root).as_posix(), file) for file in files]
    if not found:
        msg = f"{root}: holds no bag (folder with {_METADATA}, or .mcap file); check the path"
        raise BagError(msg)
    return sorted(found)


def estimate_task(task: BatchTask) -> BagResult:
    """Estimate one bag; what is wrong with it is a value, not an exception.

    Parameters
    ----------
    task : BatchTask
        The bag and the valves that it may hold.

    Returns
    -------
    BagResult
        The same bits wherever it runs.
    """
    try:
        files, digest = file_marks(task.bag), digest_of(task)
        with _warnings() as notes:
            result = _estimated(BagResult(task.name, digest, files), task)
        return dataclasses.replace(result, notes=(*dict.fromkeys(notes), *result.notes))
    except ValveTwinError as err:
        return BagResult(task.name, error=" ".join(str(err).split()))
    except OSError as err:
        return BagResult(task.name, error=f"{err.filename or task.bag}: {err.strerror or err}")
    except Exception as err:  # one bad bag must not stop the others
        return BagResult(task.name, error=f"{task.bag}: {type(err).__name__}: {err}")


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Collect what the reader warns of in this thread, such as the losses of a damaged bag."""
    notes: list[str] = []
    logger, thread = logging.getLogger("valve_twin"), threading.get_ident()

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.thread == thread:
                notes.append(" ".join(record.getMessage().split()))

    collector = Collector(logging.WARNING)
    logger.addHandler(collector)
    try:
        yield notes
    finally:
        logger.removeHandler(collector)


def _estimated(result: BagResult, task: BatchTask) -> BagResult:
    configs = _present(task)
    lines: list[str] = []
    notes: list[str] = []
    verdicts: list[str] = []
    cycles = accepted = estimates = 0
    for config in configs:
        record = run_bag(config, task.bag, predict=False)
        assessment = assess_record(config, record)
        lines += json_lines(
            record.estimates, assessment, config.name, record.counters, record.files
        )
        notes += describe_bad(config, task.bag, record)
        verdicts.append(assessment.verdict.kind.text)
        cycles += len(record.cycles)
        accepted += sum(cycle.accepted for cycle in record.cycles)
        estimates += len(record.estimates)
        if not record.cycles:
            rule = config.cycles.rule.value
            notes.append(f"{task.bag}: no cycle of {config.name} found by rule '{rule}'")
    return dataclasses.replace(
        result,
        valves=tuple(config.name for config in configs),
        cycles=cycles,
        accepted=accepted,
        estimates=estimates,
        verdicts=tuple(verdicts),
        notes=tuple(notes),
        text="".join(f"{line}\n" for line in lines),
    )


def _present(task: BatchTask) -> list[ValveConfig]:
    """Return the valves whose topics the bag has; the only one whatever the bag has."""
    if len(task.configs) == 1:
        return list(task.configs)
    topics = {topic.name for topic in bag_info(task.bag).topics}
    found = [c for c in task.configs if all(s.topic in topics for s in c.signals.values())]
    if not found:
        msg = (
            f"{task.bag}: holds the topics of none of the {len(task.configs)} valves of the "
            "configuration; check topic_prefix and signals.*.topic"
        )
        raise BagError(msg)
    return found


def lost_bag(task: BatchTask, why: str) -> BagResult:
    """Return the result of a bag that was not estimated.

    Parameters
    ----------
    task : BatchTask
        The bag.
    why : str
        One line.
    """
    return BagResult(task.name, error=f"{task.bag}: {why}")


def run_batch(tasks: Sequence[BatchTask], results: Results, run: Runner) -> Iterator[BagResult]:
    """Yield the result of every task: the finished ones first, then each as it is done.

    Parameters
    ----------
    tasks : sequence of BatchTask
        One a bag.
    results : Results
        Where finished results are found and new ones are stored.
    run : callable
        Runs tasks anywhere and yields their results in any order.
    """
    left: list[BatchTask] = []
    for task in tasks:
        result = results.finished(task)
        if result is None:
            left.append(task)
        else:
            yield result
    if not left:
        return
    by_name = {task.name: task for task in left}
    for result in run(left):
        results.store(by_name[result.name], result)
        yield result
