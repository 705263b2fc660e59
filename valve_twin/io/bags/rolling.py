# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The numbered files of a bag while it is written: when the next begins, which are kept."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from valve_twin.io.bags.file import BagFile
from valve_twin.io.bags.gone import Gone, GoneError, LostFileError, OwnFolder, full, stands
from valve_twin.io.bags.metadata import FILE_NAME, FileEntry, metadata_map, metadata_text
from valve_twin.io.errors import BagError, unwritable
from valve_twin.io.mcap.writer import CHUNK_SIZE
from valve_twin.io.whole import sync_folder, write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from valve_twin.io.bags.topics import WrittenTopics


@dataclass(frozen=True, slots=True)
class SplitRule:
    """When a bag begins a new file and how many it keeps; 0 = never, and all.

    Attributes
    ----------
    size : int
        Bytes after which a file is full [B].
    duration_s : float
        Log time that a file spans at most [s].
    keep : int
        Files kept, the running one included; older ones are deleted [1].
    """

    size: int = 0
    duration_s: float = 0.0
    keep: int = 0

    @property
    def span_ns(self) -> int:
        """Log time that a file spans at most [ns]."""
        return int(self.duration_s * 1e9)


@dataclass(frozen=True, slots=True)
class Storage:
    """How files are made.

    Attributes
    ----------
    sync : callable
        Called with the file number to put a file on disk.
    sync_now : callable, optional
        Where `sync` only orders a sync: what really does it, for metadata.yaml.
    chunk_size : int
        Bytes in a chunk before compression.
    compressed : bool
        Whether chunks are compressed with zstd.
    clock : callable
        Steady clock [s] that times the flushing.
    """

    sync: Callable[[int], object] = os.fsync
    sync_now: Callable[[int], object] | None = None
    chunk_size: int = CHUNK_SIZE
    compressed: bool = True
    clock: Callable[[], float] = time.monotonic


@dataclass(frozen=True, slots=True)
class FileEvents:
    """What is called when a file is finished.

    Attributes
    ----------
    noted : callable
        Gives values for the metadata, such as losses so far.
    on_split : callable
        Gets the names of the file that was finished and of the next.
    on_gone : callable
        Gets a line where somebody deleted, cut or moved away the file that was written.
    on_folder : callable
        Gets the folder where it had to be made again, or another one took its place.
    """

    noted: Callable[[], Mapping[str, object]] = dict
    on_split: Callable[[str, str], object] = lambda _closed, _opened: None
    on_gone: Callable[[str], object] = lambda _line: None
    on_folder: Callable[[Path], object] = lambda _path: None


@dataclass(slots=True)
class _Closed:
    """A file that is not written to any more; `status`: as the system said when it was closed."""

    path: Path
    entry: FileEntry
    counts: dict[str, int]
    size: int
    status: os.stat_result | None


def _unlink(path: Path) -> int:
    path.unlink(missing_ok=True)
    return 0


class RollingFiles:
    """The files of one bag folder.

    Parameters
    ----------
    path : Path
        Folder to make; it must not exist.
    topics : WrittenTopics
        What is written.
    storage : Storage
        How files are made.
    rule : SplitRule
        When a new file begins and how many are kept.
    events : FileEvents
        What is called when a file is finished.
    at_once : bool
        Make the first file now and the next at a split, not with a message.

    Raises
    ------
    BagError
        If the folder exists or cannot be made; `open_next`, `split`, `drop_oldest` and `close`
        if the disk does not take what they write.
    """

    def __init__(
        self,
        path: Path,
        topics: WrittenTopics,
        *,
        storage: Storage,
        rule: SplitRule,
        events: FileEvents,
        at_once: bool,
    ) -> None:
        self.path, self._topics = path, topics
        self._storage, self._rule, self._events = storage, rule, events
        self._at_once, self._span_ns = at_once, rule.span_ns
        self.custom: dict[str, str] = {}
        self.running: BagFile | None = None
        self._done: list[_Closed] = []
        self._earlier: list[tuple[Path, os.stat_result]] = []
        self._delete_earlier: Callable[[Path], int] = _unlink
        self._unfinished: list[BagFile] = []
        self._next = 0
        self._ended = False
        self._folder = OwnFolder(path)
        if at_once:
            try:
                self.open_next()
            except BagError:
                with suppress(OSError):  # a folder that holds nothing is in the way next time
                    path.rmdir()
                raise

    def begin_in(self, path: Path) -> None:
        """Go on in another folder, which is made, as a bag of its own.

        Parameters
        ----------
        path : Path
            Folder to make.
        """
        self._folder = OwnFolder(path)  # first: where there is none, nothing changes
        self.path, self._next, self._done = path, 0, []

    def follow(self, earlier: Sequence[Path], delete: Callable[[Path], int]) -> None:
        """Count files of earlier recordings as the oldest of this one.

        Parameters
        ----------
        earlier : sequence of Path
            Oldest first.
        delete : callable
            Deletes one of them and returns its size [B].
        """
        self._earlier, self._delete_earlier = [], delete
        for file in earlier:
            with suppress(OSError):  # deleted meanwhile, or a link that leads nowhere
                self._earlier.append((file, file.stat()))
        self._keep(self._rule.keep - 1)

    def note(self, values: Mapping[str, object]) -> None:
        """Add values of the user's own to the metadata."""
        self.custom.update({str(key): str(value) for key, value in values.items()})

    def file_for(self, log_ns: int) -> BagFile:
        """Return the file that a message belongs to, a new one where the rule says so.

        Parameters
        ----------
        log_ns : int
            Its log time [ns].
        """
        file = self.running
        if file is None:
            return self.open_next()
        full = 0 < self._rule.size <= file.size
        if self._span_ns and file.first_ns >= 0:
            full = full or log_ns - file.first_ns >= self._span_ns
        if full:
            self.split()
            assert self.running is not None
            return self.running
        return file

    def open_next(self) -> BagFile:
        """Begin the next file.

        Raises
        ------
        TakenFolderError
            If the folder is another one, with files that are not of this bag.
        BagError
            If the disk does not take it.
        """
        file, made = None, self._storage
        try:
            if self._folder.adopt(self._is_known):
                self._events.on_folder(self.path)
            self._done = [d for d in self._done if d.path.exists()]
            self._keep(self._rule.keep - 1)  # before: who is killed in between leaves no more
            file = BagFile(
                self._path(self._next),
                sync=made.sync,
                chunk_size=made.chunk_size,
                compressed=made.compressed,
            )
            sync_folder(self.path, os.fsync if made.sync_now is None else made.sync)
        except OSError as err:
            if file is not None:
                with suppress(OSError):
                    file.remove()
            raise BagError(unwritable(self.path, err)) from err
        self._next += 1
        for topic in list(self._topics.values()):
            topic.channel_in(file)
        self.running, file.flushed_s = file, made.clock()
        self._retry_unfinished()
        if self._done:
            self._save_metadata()
        return file

    def split(self, notes: Mapping[str, Mapping[str, str]] | None = None) -> tuple[str, str]:
        """Finish the running file and begin the next; return their names.

        A file without a message goes on: its name is returned twice.

        Parameters
        ----------
        notes : mapping, optional
            Metadata records for the finished file by name.
        """
        file = self.running or self.open_next()
        if file.message_count == 0:
            return file.path.name, file.path.name
        try:
            self._finish(file, notes)
        except OSError as err:
            raise self.failure(file, err) from err
        self.running = None
        closed, opened = file.path.name, self._path(self._next).name
        if self._at_once:
            self.open_next()
        else:
            self._keep(self._rule.keep)
            self._save_metadata()
        self._events.on_split(closed, opened)
        return closed, opened

    def suspend(self) -> None:
        """Close the running file as well as the disk allows; the next message goes on.

        A file for whose summary there is no space is finished when there is; one without a message
        is removed.
        """
        file, self.running = self.running, None
        if file is None:
            return
        try:
            if file.message_count == 0:
                file.remove()
            else:
                self._finish(file)
        except OSError:
            self._lose(file)
            self._unfinished.append(file)
            if file.gone() is None:
                self._list(file, file.entry(), file.counts())
        with suppress(OSError):
            self._write_metadata()

    def drop_oldest(self) -> int:
        """Delete the oldest file that is closed; return its size, 0 where there is none [B]."""
        if self._earlier:
            path, status = self._earlier.pop(0)  # another bag may have taken its place since
            return max(self._delete_earlier(path) if stands(path, status) else 0, 1)
        if not self._done or not self._folder.is_own():
            return 0
        oldest = self._done.pop(0)
        for file in [f for f in self._unfinished if f.path == oldest.path]:
            self._unfinished.remove(file)
            file.abandon()
        self._save_metadata()
        oldest.path.unlink(missing_ok=True)
        return max(oldest.size, 1)

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing."""
        if self._ended:
            return
        self._ended = True
        if self.running is None and not self._done:
            with suppress(BagError):
                self.open_next()
        file, self.running = self.running, None
        try:
            if file is not None and file.message_count == 0 and self._done:
                file.remove()
            elif file is not None:
                self._finish(file)
            self._retry_unfinished()
            self.note(self._events.noted())
            self._write_metadata()
        except OSError as err:
            if file is not None:
                self._lose(file)
            raise full(self.path, err) from err
        finally:
            for left in (*self._unfinished, *([file] if file is not None else [])):
                left.abandon()

    def failure(self, file: BagFile, err: OSError) -> BagError:
        """Cut what a failed write left half written; return what to say of it."""
        self._lose(file)
        if isinstance(err, GoneError):
            return LostFileError(f"{file.path}: {err.strerror} while it was written")
        return full(file.path, err)

    @property
    def size(self) -> int:
        """Bytes of the files that are kept [B]."""
        running = 0 if self.running is None else self.running.size
        return running + sum(d.size for d in list(self._done))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the files in their order, the running one included."""
        running = () if self.running is None else (self.running.path.name,)
        return (*(d.path.name for d in list(self._done)), *running)

    def _path(self, number: int) -> Path:
        return self.path / f"{self.path.name}_{number}.mcap"

    def _keep(self, files: int) -> None:
        """Delete the oldest closed files but so many."""
        if self._rule.keep > 0:
            while len(self._earlier) + len(self._done) > files and self.drop_oldest():
                pass

    def _is_known(self, path: Path) -> bool:
        """Return whether a file is one of this bag, not one of another bag by the same name."""
        left = [f.gone() is None for f in self._unfinished if f.path == path]
        return any(left or (stands(path, d.status) for d in self._done if d.path == path))

    def _list(self, file: BagFile, entry: FileEntry, counts: dict[str, int]) -> None:
        """List a file that is not written to any more; one that is listed keeps its place."""
        names = [d.path for d in self._done]
        at = names.index(file.path) if file.path in names else len(names)
        self._done[at : at + 1] = [_Closed(file.path, entry, counts, file.size, file.status)]

    def _finish(self, file: BagFile, notes: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Finish a file and list it; the metadata in it are its own.

        One that was moved away is finished where it is now; what was in one that was deleted or
        cut is lost, and counted so.
        """
        gone = file.gone()
        if gone is not None and file not in self._unfinished:
            self._events.on_gone(f"{file.path}: {gone.told(file.message_count)}")
        if gone is Gone.CUT:
            self._topics.uncount(file.counts())
            file.abandon()
            self._list(file, FileEntry(file.path.name, 0, 0, 0), {})
            return
        self.note(self._events.noted())
        file.mcap.end_chunk()
        entry, counts = file.entry(), file.counts()
        records: dict[str, Mapping[str, str]] = {
            "rosbag2": {"serialized_metadata": self._metadata([entry], [counts])}
        }
        if self.custom:
            records["valve_twin"] = self.custom
        file.finish({**records, **(notes or {})})
        if gone is Gone.DELETED:
            self._topics.uncount(counts)
        elif gone is None and file.path.parent == self.path:
            self._list(file, entry, counts)

    def _retry_unfinished(self) -> None:
        for file in list(self._unfinished):
            try:
                self._finish(file)
            except OSError:
                self._lose(file)
            else:
                self._unfinished.remove(file)

    def _lose(self, file: BagFile) -> None:
        """Cut what an error left half written; its messages count no more."""
        with suppress(OSError):
            self._topics.uncount(file.give_up())

    def _metadata(self, entries: Sequence[FileEntry], counts: Sequence[dict[str, int]]) -> str:
        return metadata_text(metadata_map(entries, self._topics.entries(counts), self.custom))

    def _write_metadata(self) -> None:
        if not self._folder.is_own():
            return  # what is there is somebody else's
        entries, counts = [d.entry for d in self._done], [d.counts for d in self._done]
        if self.running is not None:
            entries.append(self.running.entry())
            counts.append(self.running.counts())
        sync = self._storage.sync_now or self._storage.sync
        write_whole(self.path / FILE_NAME, self._metadata(entries, counts), sync)

    def _save_metadata(self) -> None:
        """Write metadata.yaml of a bag that goes on; it is written again at the end."""
        try:
            self._write_metadata()
        except OSError as err:
            raise BagError(unwritable(self.path, err)) from err
