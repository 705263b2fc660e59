# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which stored cycles the broker has: what it missed is sent again, over outages and restarts."""

from __future__ import annotations

import json
import logging
import math
import os
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TextIO

from valve_twin.io.bags.file import hold
from valve_twin.io.errors import StoreError, ValveTwinError, unwritable
from valve_twin.io.limits import CONSTRUCTORS_MEET
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from valve_twin.core.types import Estimate
    from valve_twin.gateway.view import View

_LOGGER = logging.getLogger("valve_twin")

PAGE = 50
"""Cycles of a valve that are read at a time [1]."""

BACK = 3
"""Where new cycles of a valve are read, so many before them are looked at, too [1]."""

BIRTHS = 256
"""Births are numbered modulo this [1]."""


class Backlog:
    """Goes through the stored cycles of all valves; a cycle counts once the broker handed it on.

    A file that is new begins with what is stored from then on. Doubled messages are possible (a
    broker that died behind a delivery), lost ones are not.

    Parameters
    ----------
    path : Path
        The file that keeps the marks.
    read : callable
        Returns the estimates that feed a valve's trend: valve, first cycle, at most so many.
    of : str
        Who is told of what: broker, node and history. Marks of others are none.

    Raises
    ------
    StoreError
        If the file cannot be read or written, is none of ours, holds the marks of others, or
        another process keeps its marks there.
    """

    def __init__(
        self, path: Path, read: Callable[[str, int, int], list[Estimate]], of: str
    ) -> None:
        self._path, self._read, self._of = path, read, of
        self._held = _held(path)
        try:
            new: dict[str, Any] = {"of": of, "birth": 0, "valves": None, "ends": {}}
            kept = _load(path, of) if path.exists() else new
        except StoreError:
            self.close()
            raise
        self._birth: int = kept["birth"]
        self._marks: dict[str, int] | None = kept["valves"]
        self._ends: dict[str, int] = kept.get("ends", {})
        self._pending: dict[str, deque[Estimate]] = {}
        self._seen: dict[str, int] = {}
        self._all_of: View | None = None
        self._saved, self._unkept = kept, ""

    def close(self) -> None:
        """Leave the file to others."""
        self._held.close()

    def next_birth(self) -> int:
        """Return the number of the next birth; never that of the one before, restarts included.

        (Unless the disk took the marks once and does not any more.)

        Raises
        ------
        StoreError
            If the file is new and cannot be written.
        """
        number = self._birth
        self._birth = (number + 1) % BIRTHS
        self._begin()
        self.save()
        return number

    def restart(self) -> None:
        """Begin again behind what is confirmed: of what was under way nothing is known."""
        self._pending, self._seen, self._all_of = {}, {}, None

    def look(self, view: View) -> None:
        """Begin with what is stored from now on, where nothing is known of what was before.

        Parameters
        ----------
        view : View
            What the history holds; one that cannot be read, or was not yet, tells nothing.
        """
        if self._marks is None and view.whole and not view.failure:
            self._marks = {row.valve: row.cycle for row in view.rows}
            self._ends = {row.valve: row.end_ns for row in view.rows}

    def take(self, view: View) -> Iterator[tuple[str, Estimate, bool]]:
        """Yield the next cycles to be sent, valve by valve: valve, estimate, whether the newest.

        Parameters
        ----------
        view : View
            What the history holds; of one that cannot be read, or was not yet, nothing is taken.

        Raises
        ------
        StoreError
            If the file is new and cannot be written.
        """
        if view.failure or not view.whole or view is self._all_of:
            return
        self.look(view)
        self._begin()
        assert self._marks is not None
        marks, whole = self._marks, True
        for row in view.rows:
            if row.cycle < marks.get(row.valve, 0):
                self._begin_anew(row.valve)
            if self._seen.get(row.valve) == row.cycle:
                continue
            try:
                found = self._next(row.valve)
            except ValveTwinError:  # told by the view; tried again
                whole = False
                continue
            pending = self._pending.setdefault(row.valve, deque())
            for estimate in found:
                if estimate.cycle > row.cycle:  # newer than the view: with the next one
                    break
                pending.append(estimate)
                yield row.valve, estimate, estimate.cycle == row.cycle
            if len(found) < PAGE:
                self._seen[row.valve] = row.cycle
            else:
                whole = False
        if whole:
            self._all_of = view

    def _next(self, valve: str) -> list[Estimate]:
        """Return the next cycles of a valve; of another history the first ones.

        Of a backup in the place of the history the numbers behind it are given again.
        """
        assert self._marks is not None
        pending, mark = self._pending.get(valve), self._marks.get(valve, 0)
        sent = pending[-1].cycle if pending else mark
        end_ns = pending[-1].end_ns if pending else self._ends.get(valve, math.inf)
        first = max(1, sent + 1 - BACK)
        found = self._read(valve, first, PAGE + sent + 1 - first)
        of_sent = [e.end_ns for e in found if e.cycle == sent]
        if of_sent and math.isfinite(end_ns):  # a clock that went back makes no other history
            is_other = end_ns not in of_sent
        else:
            is_other = any(e.cycle < sent and e.end_ns > end_ns for e in found)
        if is_other:
            self._begin_anew(valve)
            return self._read(valve, 1, PAGE)
        return [e for e in found if e.cycle > sent][:PAGE]

    def _begin_anew(self, valve: str) -> None:
        """Take it that there is another history: what the broker has was of the one before."""
        assert self._marks is not None
        self._marks[valve] = 0
        for of in (self._ends, self._pending, self._seen):
            of.pop(valve, None)

    def confirm(self, valve: str, cycle: int) -> None:
        """Note that the broker handed a cycle on; one that was dropped before is sent again.

        Parameters
        ----------
        valve : str
            Whose.
        cycle : int
            Its number.
        """
        pending = self._pending.get(valve)
        if not pending or cycle not in {e.cycle for e in pending}:
            return
        if pending[0].cycle == cycle and self._marks is not None:
            self._ends[valve] = pending.popleft().end_ns
            self._marks[valve] = cycle
        else:
            pending.clear()
            self._seen.pop(valve, None)
            self._all_of = None

    def save(self) -> None:
        """Keep the marks, where they changed; while the disk does not take them, in memory.

        The broker is told all the same: who begins anew meanwhile tells it some cycles twice.

        Raises
        ------
        StoreError
            If the file's folder was deleted and another process keeps its marks there now.
        """
        if self._now() == self._saved:
            return
        try:
            self._write()
        except OSError as err:
            why = err.strerror or str(err)
            if why != self._unkept and self._saved["valves"] is not None:
                _LOGGER.warning(
                    "%s; after a restart the broker is told again what it has",
                    unwritable(self._path, err),
                )  # fmt: skip
            self._unkept = why
            return
        if self._unkept:
            _LOGGER.warning("%s: is written again", self._path)
        self._unkept = ""

    def _begin(self) -> None:
        """Keep the first marks: without, a restart takes what was stored meanwhile for told."""
        if self._saved["valves"] is not None or self._now() == self._saved:
            return
        try:
            self._write()
        except OSError as err:
            msg = f"{unwritable(self._path, err)}; no broker is told before it can"
            raise StoreError(msg) from err

    def _now(self) -> dict[str, Any]:
        marks = None if self._marks is None else dict(self._marks)
        ends = dict(self._ends)
        return {"of": self._of, "birth": self._birth, "valves": marks, "ends": ends}

    def _write(self) -> None:
        now = self._now()
        self._hold_again()
        self._path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self._path, json.dumps(now, indent=1))
        self._saved = now

    def _hold_again(self) -> None:
        """Hold the file's lock anew where its folder was deleted: what is held there is gone."""
        with suppress(OSError):
            if os.path.samestat(_lock(self._path).stat(), os.fstat(self._held.fileno())):
                return
        try:
            fresh = _locked(self._path)
        except BlockingIOError as err:
            raise StoreError(_TAKEN.format(self._path)) from err
        self._held.close()
        self._held = fresh


_TAKEN = "{}: another `serve` keeps its marks there: name another --mqtt-state"


def _lock(path: Path) -> Path:
    return path.with_name(f"{path.name}.lock")


def _locked(path: Path) -> TextIO:
    path.parent.mkdir(parents=True, exist_ok=True)
    return hold(_lock(path))


def _held(path: Path) -> TextIO:
    try:
        return _locked(path)
    except BlockingIOError as err:
        raise StoreError(_TAKEN.format(path)) from err
    except OSError as err:
        raise StoreError(unwritable(path, err)) from err


def _load(path: Path, of: str) -> dict[str, Any]:
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        marks = kept["valves"]
        known = isinstance(kept["birth"], int) and isinstance(kept["of"], str)
        sound = known and all(
            isinstance(number, int)
            for of in (marks or {}, kept.get("ends", {}))
            for number in of.values()
        )
    except OSError as err:
        msg = f"{path}: cannot be read: {err.strerror or err}"
        raise StoreError(msg) from err
    except CONSTRUCTORS_MEET:
        sound = False
    if not sound:
        msg = f"{path}: holds no marks of MQTT: remove it to begin with what is stored from now on"
        raise StoreError(msg)
    found: dict[str, Any] = kept
    if found["of"] != of:
        msg = f"{path}: holds the marks of {found['of']}: name another file for {of}"
        raise StoreError(msg)
    return found
