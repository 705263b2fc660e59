# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Estimated cycles that a server did not take yet, on the disk of the twin: one file a cycle.

They outlive the twin, whatever ends it. The next one stores them before it begins, so that numbers
and trend go on from them. To store a cycle that is stored already does nothing. The files are not
flushed: what a power cut leaves of one carries no right check sum.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import quote

from valve_twin.io.errors import StoreError
from valve_twin.io.history.log.counters import counters_row, row_counters
from valve_twin.io.history.tables import (
    CycleRecord,
    estimate_row,
    from_row,
    row_estimate,
    to_row,
)
from valve_twin.io.sealed import unsealed, write_sealed

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
    """

    def __init__(self, folder: Path, history: str) -> None:
        name = hashlib.sha256(history.encode()).hexdigest()[:16]
        self._folder = folder / f"history-{name}"

    def cycles_folder(self, valve: str) -> Path:
        """Return where cycles of a valve that wait for their estimation may be kept."""
        self._folder.mkdir(parents=True, exist_ok=True)
        return self._folder / f"{_file_name(valve)}-cycles"

    def put(self, valve: str, cycle: UnsavedCycle) -> Path:
        """Keep a cycle; return its file.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / f"{_file_name(valve)}.{cycle.record.cycle:012d}"
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

    def waiting(self, valve: str) -> list[Path]:
        """Return the files of a valve, oldest cycle first.

        Raises
        ------
        StoreError
            If the folder cannot be read.
        """
        start = f"{_file_name(valve)}."
        try:
            found = [p for p in self._folder.iterdir() if p.name.startswith(start)]
        except FileNotFoundError:
            return []
        except OSError as err:
            raise _unreadable(self._folder, err) from err
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
