# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Re-estimate an archive of bags: one task a bag, resumable, on this machine or on a cluster.

A result stays valid while bag, configuration and version of valve_twin stay the same; a digest of
all three is kept beside it. Each result is written whole or not at all, so that an interrupted run
goes on where it stopped. Tasks share nothing: where and in which order they run changes no bit.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin import __version__
from valve_twin.io.bags import bag_files, bag_info
from valve_twin.io.errors import BagError, ValveTwinError
from valve_twin.io.lines import json_lines
from valve_twin.io.offline import assess_record, describe_bad, run_bag

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from valve_twin.io.config import ValveConfig

    Runner = Callable[[Sequence["BatchTask"]], Iterable["BagResult"]]

_BLOCK = 1 << 20  # bytes hashed at once
_METADATA = "metadata.yaml"


@dataclass(frozen=True, slots=True)
class BatchTask:
    """One bag to estimate.

    Attributes
    ----------
    name : str
        Path of the bag in the archive, which names its results.
    bag : str
        Absolute path.
    configs : tuple of ValveConfig
        Valves that the bag may hold.
    """

    name: str
    bag: str
    configs: tuple[ValveConfig, ...]


@dataclass(frozen=True, slots=True)
class BagResult:
    """What became of one bag.

    Attributes
    ----------
    name : str
        Path of the bag in the archive.
    digest : str
        Of bag, configuration and version.
    files : tuple of (str, int, int)
        Name, size [B] and time of change [ns] of each file of the bag.
    valves : tuple of str
        Valves that were estimated.
    cycles, accepted, estimates : int
        Cycles closed and accepted, estimates given.
    verdicts : tuple of str
        One a valve.
    notes : tuple of str
        Lines about values that were left out.
    error : str
        Why there is no result; empty where there is one.
    text : str
        The lines of JSON, as `valve-twin estimate` prints them.
    kept : bool
        Whether it was found finished.
    """

    name: str
    digest: str = ""
    files: tuple[tuple[str, int, int], ...] = ()
    valves: tuple[str, ...] = ()
    cycles: int = 0
    accepted: int = 0
    estimates: int = 0
    verdicts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    error: str = ""
    text: str = ""
    kept: bool = False


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


def digest_of(task: BatchTask) -> str:
    """Return the digest of a bag's content, its configuration and this version."""
    digest = hashlib.blake2b(digest_size=20)
    digest.update(f"{__version__}\n{task.configs!r}\n".encode())
    for path in bag_files(task.bag)[0]:
        digest.update(f"{path.name}\n".encode())
        with path.open("rb") as file:
            while block := file.read(_BLOCK):
                digest.update(block)
    return digest.hexdigest()


def file_marks(bag: str | Path) -> tuple[tuple[str, int, int], ...]:
    """Return name, size [B] and time of change [ns] of each file of a bag."""
    marks = []
    for path in bag_files(bag)[0]:
        status = path.stat()
        marks.append((path.name, status.st_size, status.st_mtime_ns))
    return tuple(marks)


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
        return _estimated(BagResult(task.name, digest, files), task)
    except ValveTwinError as err:
        return BagResult(task.name, error=" ".join(str(err).split()))
    except OSError as err:
        return BagResult(task.name, error=f"{err.filename or task.bag}: {err.strerror or err}")
    except Exception as err:  # one bad bag must not stop the others
        return BagResult(task.name, error=f"{task.bag}: {type(err).__name__}: {err}")


def _estimated(result: BagResult, task: BatchTask) -> BagResult:
    configs = _present(task)
    lines: list[str] = []
    notes: list[str] = []
    verdicts: list[str] = []
    cycles = accepted = estimates = 0
    for config in configs:
        record = run_bag(config, task.bag, predict=False)
        assessment = assess_record(config, record)
        lines += json_lines(record.estimates, assessment, config.name)
        notes += describe_bad(config, task.bag, record)
        verdicts.append(assessment.verdict.verdict.text)
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


class Results:
    """Results of a batch in a folder: lines of JSON and a mark of what they were made from.

    Parameters
    ----------
    folder : path
        Folder to write; made where it is missing.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)

    def lines(self, name: str) -> Path:
        """Return the file of the lines of a bag."""
        return self.folder / f"{name}.jsonl"

    def mark(self, name: str) -> Path:
        """Return the file that says what the lines were made from."""
        return self.folder / f"{name}.batch.json"

    def finished(self, task: BatchTask) -> BagResult | None:
        """Return the result of a bag that is still valid, else None.

        The content is read again only where size or time of a file has changed.
        """
        try:
            stored = json.loads(self.mark(task.name).read_text(encoding="utf-8"))
            result = _restored(stored)
            written = self.lines(task.name).stat().st_size == stored["bytes"]
            same = written and stored["recipe"] == _recipe(task)
            if not same or result.error:
                return None
            if result.files != file_marks(task.bag) and result.digest != digest_of(task):
                return None
        except (OSError, ValueError, KeyError, TypeError, ValveTwinError):
            return None
        return dataclasses.replace(result, kept=True)

    def store(self, task: BatchTask, result: BagResult) -> None:
        """Write a result, whole or not at all; a failed bag keeps no lines."""
        lines, mark = self.lines(task.name), self.mark(task.name)
        mark.parent.mkdir(parents=True, exist_ok=True)
        mark.unlink(missing_ok=True)
        lines.unlink(missing_ok=True)
        data = result.text.encode()
        if not result.error:
            _write_whole(lines, data)
        content = {k: v for k, v in dataclasses.asdict(result).items() if k not in _NOT_STORED}
        content |= {"recipe": _recipe(task), "bytes": len(data)}
        _write_whole(mark, (json.dumps(content, indent=1) + "\n").encode())


_NOT_STORED = ("text", "kept")


def _recipe(task: BatchTask) -> str:
    """Return the digest of configuration and version alone."""
    text = f"{__version__}\n{task.configs!r}"
    return hashlib.blake2b(text.encode(), digest_size=20).hexdigest()


def _restored(stored: dict[str, object]) -> BagResult:
    values = {k: v for k, v in stored.items() if k in BagResult.__slots__}
    for name, value in values.items():
        if isinstance(value, list):
            values[name] = tuple(tuple(v) if isinstance(v, list) else v for v in value)
    return BagResult(**values)  # type: ignore[arg-type]


def _write_whole(path: Path, data: bytes) -> None:
    partial = path.with_name(f".{path.name}.part")
    with partial.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


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
