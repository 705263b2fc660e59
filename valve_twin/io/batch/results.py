# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tasks and results of a batch, and the folder that keeps what is finished.

A result stays valid while bag, configuration and version of valve_twin stay the same; a digest of
all three is kept beside it. Each result is written whole or not at all, so that an interrupted run
goes on where it stopped.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin import __version__
from valve_twin.io.bags.read import bag_files
from valve_twin.io.errors import ValveTwinError
from valve_twin.io.limits import CONSTRUCTORS_MEET
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    from valve_twin.io.config.valve import ValveConfig

_BLOCK = 1 << 20  # bytes hashed at once


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
        except (OSError, ValveTwinError, *CONSTRUCTORS_MEET):
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
            write_whole(lines, data)
        content = {k: v for k, v in dataclasses.asdict(result).items() if k not in _NOT_STORED}
        content |= {"recipe": _recipe(task), "bytes": len(data)}
        write_whole(mark, (json.dumps(content, indent=1) + "\n").encode())


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
