# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Estimated cycles that a server did not take yet, on the disk of the twin: one file a cycle.

They outlive the twin, whatever ends it. The next one stores them before it begins, so that numbers
and trend go on from them. To store a cycle that is stored already does nothing. A file is renamed
into place, and flushed with its folder soon after, many at once: until then a power cut leaves it,
nothing, or what carries no right check sum.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import quote

from valve_twin.io.errors import StoreError
from valve_twin.io.history.log.counters import counters_row, row_counters
from valve_twin.io.history.store import CycleTakenError
from valve_twin.io.history.tables import CycleRecord, estimate_row, from_row, row_estimate, to_row
from valve_twin.io.sealed import flush, flush_folder, unsealed, write_sealed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.operation.counters import Counters
    from valve_twin.core.types import Estimate
    from valve_twin.io.history.store import History

_MAGIC = b"valve_twin unsaved cycle 1 "

_GONE = {errno.ENOENT, errno.EISDIR, errno.EIO, errno.EUCLEAN}
"""What says that a file will not come back; others are about rights, memory or open files."""


class UnsavedCycle(NamedTuple):
    """A cycle as `History.store` takes it."""

    record: CycleRecord
    estimates: Sequence[Estimate] = ()
    counters: Counters | None = None


class UnsavedCycles:
    """The cycles that wait for one history.

    Parameters
    ----------
    folder : Path
        Where twins of this machine keep what they need again; made where it is missing.
    history : str
        The history, as `History.where` names it.

    Attributes
    ----------
    folder : Path
        Where the files are.
    """

    def __init__(self, folder: Path, history: str) -> None:
        name = hashlib.sha256(history.encode()).hexdigest()[:16]
        self.folder = folder / f"history-{name}"
        self._is_found = False

    def cycles_folder(self, valve: str) -> Path:
        """Return where cycles of a valve that wait for their estimation may be kept."""
        return self.folder / f"{_file_name(valve)}-cycles"

    def put(self, valve: str, cycle: UnsavedCycle) -> Path:
        """Keep a cycle; return its file.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        self.prepare()
        path = self.folder / f"{_file_name(valve)}.{cycle.record.cycle:012d}"
        counters = cycle.counters
        rows: dict[str, Any] = {
            "valve": valve,
            "record": to_row(cycle.record, 0),
            "estimates": [estimate_row(0, i, e) for i, e in enumerate(cycle.estimates)],
            "counters": None if counters is None else counters_row(counters),
        }
        content = json.dumps(rows, allow_nan=True).encode() + b"\n"
        part = path.with_name(f".{_file_name(valve)}.part")  # one a valve: nothing piles up
        write_sealed(path, part, _MAGIC, content)
        return path

    def flush(self, paths: Sequence[Path]) -> set[Path]:
        """Have the disk keep files over a power cut; return those that it keeps, or that are gone.

        Parameters
        ----------
        paths : sequence of Path
            Files that were put.
        """
        kept = flush(paths)
        if not self._is_found:
            for folder in self.folder.parents:
                flush_folder(folder)  # what may not be read is older than we are
            self._is_found = True
        return kept

    def prepare(self) -> None:
        """Make the folder.

        Raises
        ------
        OSError
            If it cannot be.
        """
        self._is_found = self._is_found and self.folder.is_dir()
        self.folder.mkdir(parents=True, exist_ok=True)

    def waiting(self, valve: str) -> list[Path]:
        """Return the files of a valve, oldest cycle first.

        Raises
        ------
        StoreError
            If the folder cannot be read.
        """
        start = f"{_file_name(valve)}."
        try:
            found = [p for p in self.folder.iterdir() if p.name.startswith(start)]
        except FileNotFoundError:
            return []
        except OSError as err:
            raise _unreadable(self.folder, err) from err
        return sorted(p for p in found if p.name.removeprefix(start).isdigit())

    def read(self, valve: str, path: Path) -> UnsavedCycle | None:
        """Return what a file keeps, None where it is damaged, gone or another valve's.

        Parameters
        ----------
        valve : str
            Whose it should be.
        path : Path
            The file.

        Raises
        ------
        StoreError
            If it is there and the disk gives it later, perhaps.
        """
        try:
            content = path.read_bytes()
        except OSError as err:
            if err.errno in _GONE:
                return None
            raise _unreadable(path, err) from err
        with suppress(ValueError, KeyError, TypeError):
            found = unsealed(_MAGIC, content)
            if found is None or found[0]["valve"] != valve:
                return None
            rows = found[0]
            counters = rows["counters"]
            return UnsavedCycle(
                from_row(CycleRecord, rows["record"]),
                [row_estimate(row) for row in rows["estimates"]],
                None if counters is None else row_counters(counters),
            )
        return None


class Taken(NamedTuple):
    """Why a cycle was not stored and never will be.

    Attributes
    ----------
    error : str
        One line.
    last_cycle : int
        The last one of its valve in the history [1].
    """

    error: str
    last_cycle: int


def store_one(
    history: History,
    valve: str,
    cycle: UnsavedCycle,
    unsaved: UnsavedCycles | None = None,
    file: Path | None = None,
) -> UnsavedCycle | Taken:
    """Store a cycle; return what was stored, or why it cannot be.

    Parameters
    ----------
    history : History
        Open for writing.
    valve : str
        The valve.
    cycle : UnsavedCycle
        The cycle.
    unsaved : UnsavedCycles, optional
        Keeps it.
    file : Path, optional
        Where it is kept, if all of it is there only.

    Raises
    ------
    StoreError
        If it is worth trying again.
    """
    if unsaved is not None and file is not None:
        found = unsaved.read(valve, file)
        if found is None:
            return Taken(f"{file}: it is damaged or gone", history.last_cycle(valve))
        cycle = found
    try:
        history.store(valve, *cycle)
    except CycleTakenError as err:
        return Taken(str(err), history.last_cycle(valve))
    return cycle


@dataclass(slots=True)
class Left:
    """What became of cycles that an earlier twin left.

    Attributes
    ----------
    stored, lost : int
        How many were stored, and could not be [1].
    taken : list of str
        A line for each whose number another cycle has.
    """

    stored: int = 0
    lost: int = 0
    taken: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        """Return it as words."""
        text = f"{self.stored} cycles that waited on disk are stored"
        lost = f", {self.lost} could not be read or have a number that is taken"
        return text + (lost if self.lost else "")


def store_waiting(history: History, unsaved: UnsavedCycles, valve: str) -> Left:
    """Store what an earlier twin of a valve could not.

    Parameters
    ----------
    history : History
        Open for writing.
    unsaved : UnsavedCycles
        Keeps the files.
    valve : str
        The valve.

    Raises
    ------
    StoreError
        If the history refuses it still.
    """
    left = Left()
    for file in unsaved.waiting(valve):
        found = unsaved.read(valve, file)
        try:
            if found is not None:
                history.store(valve, *found)
        except CycleTakenError as err:
            found = None
            left.taken.append(f"{valve}: {err}")
        left.lost += found is None
        left.stored += found is not None
        with suppress(OSError):  # it is stored once more at the next start, which does nothing
            file.unlink(missing_ok=True)
    return left


def unsaved_of(history: History, folder: str) -> UnsavedCycles | None:
    """Return what keeps the cycles that a history on a server does not take; None = nothing does.

    Parameters
    ----------
    history : History
        Open for writing.
    folder : str
        Where; empty = the folder that systemd gives the unit, if it does.
    """
    found = folder or os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    return (
        UnsavedCycles(Path(found).absolute(), history.where)
        if found and history.is_remote
        else None
    )


def _unreadable(path: Path, err: OSError) -> StoreError:
    msg = f"{path}: cannot be read: {err.strerror}: check the access rights"
    return StoreError(msg)


def _file_name(valve: str) -> str:
    return quote(valve, safe="")
