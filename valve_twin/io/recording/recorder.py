# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Record messages to a bag on a disk that may be slow, low or full; every loss is counted."""

from __future__ import annotations

import math
import os
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from valve_twin.io.bags.gone import LostFileError, TakenFolderError
from valve_twin.io.bags.rolling import FileEvents
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.errors import BagError
from valve_twin.io.recording import restarted
from valve_twin.io.recording.background_sync import BackgroundSync

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from valve_twin.io.bags.qos import QosProfile
    from valve_twin.io.bags.rolling import SplitRule
    from valve_twin.io.recording.ring_buffer import RecordedMessage

LOOK_BYTES = 64 * 1024
"""Message bytes after which the free space is looked at again [B]."""

LOOK_S = 1.0
"""Time after which the free space is looked at again [s]."""

SYNC_S = 10.0
"""Longest wait for the last sync at the end [s]."""

MARGIN_BYTES = 1024 * 1024
"""Free space above the floor that recording needs to go on [B]."""

FIRST_RETRY_S, LAST_RETRY_S = 0.5, 30.0
"""Pause before recording is tried again after an error; doubled until the last one [s]."""

_MB = 1e6


@dataclass(frozen=True, slots=True)
class DiskRule:
    """What to do when the disk fills.

    Attributes
    ----------
    floor : int
        Free space that is left to others [B].
    delete_oldest : bool
        Below the floor delete the oldest files of this bag first.
    resume : bool
        Go on in a new file when there is space again.
    """

    floor: int = 0
    delete_oldest: bool = False
    resume: bool = True


def free_bytes(path: Path) -> int:
    """Return the space that a user may fill on the disk of a path [B]."""
    found = os.statvfs(path)
    return found.f_bavail * found.f_frsize


class Recording:
    """One bag being recorded; used by one thread, its figures are read by any.

    Parameters
    ----------
    path : path
        Folder to make.
    flush_s : float
        Longest time until a message is on disk; the kernel has it after half of it [s].
    split : SplitRule
        When a new file begins and how many are kept.
    disk : DiskRule
        What to do when the disk fills.
    by_snapshot : bool
        Write only what `snapshot` is given, a file each.
    events : FileEvents, optional
        What is called when a file is finished.
    clock : callable
        Steady clock [s].
    sync, free : callable
        `os.fsync` and `free_bytes`, or what stands for them in a test.
    in_background : bool
        Sync the files on a thread of their own.

    Attributes
    ----------
    trouble : str
        Why nothing is written, empty where something is.
    missed : int
        Messages lost in the last trouble [1].

    Raises
    ------
    BagError
        If the folder exists or cannot be made.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        flush_s: float = 0.5,
        split: SplitRule | None = None,
        disk: DiskRule | None = None,
        by_snapshot: bool = False,
        events: FileEvents | None = None,
        clock: Callable[[], float] = time.monotonic,
        sync: Callable[[int], object] = os.fsync,
        free: Callable[[Path], int] = free_bytes,
        in_background: bool = False,
    ) -> None:
        self._late = BackgroundSync(sync) if in_background else None
        self._disk, self._flush_s = disk or DiskRule(), flush_s
        self._clock, self._free = clock, free
        self._by_snapshot = by_snapshot
        events = events or FileEvents()
        self._tell = events.on_gone
        self._lock: int | None = None
        try:
            self._writer = BagWriter(
                path,
                flush_s=math.inf,
                clock=clock,
                sync=self._late or sync,
                sync_now=sync if in_background else None,
                split=split,
                at_once=not by_snapshot,
                events=replace(events, on_folder=self._hold),
            )
            self.path = self._first = self._writer.path
            self._lock = restarted.lock(self.path)
        except BaseException:
            self._let_go()
            raise
        self._offered: dict[str, int] = {}
        self._foreign: set[str] = set()
        self._dirty_since = self._unwritten_since = math.inf
        self._unseen = 0
        self._retry_at, self._pause_s = 0.0, FIRST_RETRY_S
        self._look_at = 0.0
        self.trouble = ""
        self.missed = self._lost_before = 0
        self.snapshots = 0
        self.free = self._room()

    # -- what is written

    def add_topic(self, topic: str, kind: str, qos: tuple[QosProfile, ...]) -> None:
        """Add a topic.

        Parameters
        ----------
        topic, kind : str
            Absolute name and full message type.
        qos : tuple of QosProfile
            What its publishers offer.
        """
        self._writer.add_topic(topic, kind, qos=qos)
        self._offered.setdefault(topic, 0)

    def offer(self, topic: str, qos: tuple[QosProfile, ...]) -> None:
        """Note what the publishers of a topic offer now."""
        self._writer.topics.offer(topic, qos)

    def follow(self, first: Path) -> None:
        """Count the files of earlier recordings of a name when the oldest are deleted.

        Parameters
        ----------
        first : Path
            Folder of the first of them, as the name was given.
        """
        self._first = first
        with suppress(OSError):  # a disk in trouble: this folder is then nobody's
            restarted.mark(self.path, first)
        self._writer.rolling.follow(restarted.earlier_files(self.path, first), restarted.delete)

    def note(self, values: Mapping[str, object]) -> None:
        """Add values of the user's own to the metadata."""
        self._writer.note(values)

    def write(self, batch: Sequence[RecordedMessage]) -> None:
        """Write messages; while the disk takes none they are lost and counted."""
        for m in batch:
            self._offered[m.topic] += 1
            if not self.trouble:
                self._put(m)
        if batch:
            now = self._clock()
            self._dirty_since = min(self._dirty_since, now)
            self._unwritten_since = min(self._unwritten_since, now)
        self.tick()

    def _put(self, m: RecordedMessage, again: bool = True) -> None:
        """Write a message; where the folder was taken before it, into the next one."""
        try:
            self._writer.write(m.topic, m.data, log_ns=m.log_ns, publish_ns=m.publish_ns)
        except BagError as err:
            self._stop(err)
            if again and not self.trouble:
                self._put(m, again=False)
            return
        self._unseen += len(m.data)
        if self._unseen >= LOOK_BYTES:
            self._look()

    def tick(self) -> None:
        """Do what is due: sync, look at the free space, go on after trouble."""
        now = self._clock()
        if self.trouble:
            if self._disk.resume and now >= self._retry_at:
                self._resume()
            return
        if now - self._dirty_since >= self._flush_s:
            self.flush()
        elif now - self._unwritten_since >= 0.5 * self._flush_s:
            self._write_out()
        if now >= self._look_at:
            self._look()
        if not self.trouble:
            self._lost_before = sum(self.lost.values())

    def flush(self) -> None:
        """Put everything written so far on disk."""
        self._dirty_since = self._unwritten_since = math.inf
        if self.trouble:
            return
        try:
            self._writer.flush()
            self._pause_s = FIRST_RETRY_S
        except BagError as err:
            self._stop(err)

    def _write_out(self) -> None:
        """Give everything to the kernel: it outlives this process, if not a power cut."""
        self._unwritten_since = math.inf
        try:
            self._writer.flush(sync=False)
        except BagError as err:
            self._stop(err)

    def split(self) -> None:
        """Begin a new file."""
        if self.trouble or self._by_snapshot:
            return
        try:
            self._writer.split()
        except BagError as err:
            self._stop(err)

    def snapshot(
        self, batch: Sequence[RecordedMessage], notes: Mapping[str, Mapping[str, str]]
    ) -> str:
        """Write a file of its own with these messages and metadata records; return its name.

        Raises
        ------
        BagError
            If the disk does not take it.
        """
        self._look()
        if self.trouble and self._disk.resume:
            self._resume()
        self.write(batch)
        if not self.trouble:
            try:
                name, _ = self._writer.split(notes)
            except BagError as err:
                self._stop(err)
            else:
                self._dirty_since = self._unwritten_since = math.inf
                self.snapshots += 1
                return name
        raise BagError(self.trouble)

    def close(self) -> None:
        """Finish the bag.

        Raises
        ------
        BagError
            If the disk is full.
        """
        try:
            self._writer.close()
        finally:
            self._let_go()

    def _let_go(self) -> None:
        if self._late is not None:
            self._late.close(SYNC_S)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    # -- figures

    @property
    def counts(self) -> dict[str, int]:
        """Messages written by topic."""
        return self._writer.counts

    @property
    def lost(self) -> dict[str, int]:
        """Messages that the disk did not take, by topic."""
        counts = self._writer.counts
        return {t: n - counts.get(t, 0) for t, n in list(self._offered.items())}

    @property
    def size(self) -> int:
        """Bytes of the files that are kept [B]."""
        return self._writer.rolling.size

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files that are kept."""
        return self._writer.rolling.names

    # -- trouble

    def _look(self) -> None:
        """Leave the floor of free space to others."""
        self._unseen, self._look_at = 0, self._clock() + LOOK_S
        self.free = self._room()
        if self.trouble or self.free >= self._disk.floor:
            return
        while self._disk.delete_oldest and self.free < self._disk.floor:
            if not self._drop_oldest():
                break
            self.free = self._room()
        if self.free < self._disk.floor:
            msg = (
                f"{self.path}: {self.free / _MB:.0f} MB free, the floor is "
                f"{self._disk.floor / _MB:.0f} MB; free some space"
            )
            self._stop(BagError(msg))

    def _room(self) -> int:
        """Return the free space, also where the folder was deleted [B]."""
        try:
            return self._free(self.path)
        except OSError:
            return self._free(next(p for p in self.path.absolute().parents if p.exists()))

    def _drop_oldest(self) -> bool:
        try:
            return self._writer.rolling.drop_oldest() > 0
        except BagError as err:
            self._stop(err)
            return False

    def _stop(self, why: BagError) -> None:
        """Close the file as it is; what comes is lost until there is space.

        Where only file or folder was taken away, the next one is begun at once.
        """
        self._dirty_since = self._unwritten_since = math.inf
        self._writer.rolling.suspend()
        gone = isinstance(why, (LostFileError, TakenFolderError))
        if gone and self._disk.resume and not self.trouble:
            try:
                if isinstance(why, TakenFolderError):
                    self._go_elsewhere()
                else:
                    self._open_next()
            except BagError as err:
                why = err
            else:
                return
        self.trouble = self.trouble or str(why)
        self._retry_at = self._clock() + self._pause_s
        self._pause_s = min(2.0 * self._pause_s, LAST_RETRY_S)

    def _open_next(self) -> None:
        """Go on in a new file, in a folder of its own where another bag took the place of ours."""
        if self._by_snapshot:
            return
        try:
            self._writer.rolling.open_next()
        except TakenFolderError:
            self._go_elsewhere()

    def _go_elsewhere(self) -> None:
        """Go on in a folder beside: another bag took the place of this one."""
        path = restarted.next_folder(self._first)
        self._writer.rolling.begin_in(path)
        self._foreign.add(self.path.name)
        self.path, taken = path, self.path
        self._hold(path)
        self._tell(f"{taken}: another bag took its place: recording to {path}")
        self._writer.rolling.open_next()

    def _hold(self, path: Path) -> None:
        """Keep other recorders from a folder that was made for this recording."""
        with suppress(OSError):  # a disk in trouble: this folder is then nobody's
            restarted.mark(path, self._first, self._foreign)
        if self._lock is not None:
            os.close(self._lock)
        self._lock = restarted.lock(path)

    def _resume(self) -> None:
        """Go on in a new file where there is space."""
        self.free = self._room()
        if self.free < self._disk.floor + MARGIN_BYTES:
            return
        try:
            self._open_next()
        except BagError:
            self._retry_at = self._clock() + self._pause_s
            self._pause_s = min(2.0 * self._pause_s, LAST_RETRY_S)
            return
        self.trouble, self.missed = "", sum(self.lost.values()) - self._lost_before
