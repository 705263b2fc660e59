# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write rosbag2 folders with MCAP storage that ROS 2 tools read."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.bags.definitions import definition, type_hash
from valve_twin.io.bags.file import BagFile, TopicDescription, sync_folder
from valve_twin.io.bags.metadata import (
    FILE_NAME,
    FileEntry,
    TopicEntry,
    metadata_map,
    metadata_text,
)
from valve_twin.io.bags.qos import QosProfile
from valve_twin.io.cdr.codec import encode_series, encode_stamped, encode_stamped_rows
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE
from valve_twin.io.errors import BagError
from valve_twin.io.mcap.writer import CHUNK_SIZE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from types import TracebackType

    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.io.mcap.format import ByteTable

FLUSH_S = 1.0
"""Longest time that written messages stay in memory [s]."""


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


@dataclass(slots=True)
class _Topic:
    about: TopicDescription
    channel: int = 0
    file: BagFile | None = None
    count: int = 0


@dataclass(slots=True)
class _Closed:
    """A file that is not written to any more."""

    path: Path
    entry: FileEntry
    counts: dict[str, int]
    size: int


class BagWriter:
    """Writer of one bag folder; use it as a context manager.

    Parameters
    ----------
    path : path
        Folder to make; it must not exist.
    flush_s : float
        Longest time after which what was written is put on disk and synced [s]; 0 = with every
        message.
    clock : callable
        Steady clock [s] that times the flushing.
    sync : callable
        Called with the file number after every flush.
    split : SplitRule
        When a new file begins and how many are kept.
    chunk_size : int
        Bytes in a chunk before compression.
    compressed : bool
        Whether chunks are compressed with zstd.
    sync_now : callable, optional
        Where `sync` only orders a sync: what really does it, for metadata.yaml.
    at_once : bool
        Make the first file now, not with the first message.
    noted : callable, optional
        Gives values for the metadata when a file is finished, such as losses so far.
    on_split : callable, optional
        Gets the names of the file that was finished and of the next.

    Raises
    ------
    BagError
        If the folder exists or cannot be made.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        flush_s: float = FLUSH_S,
        clock: Callable[[], float] = time.monotonic,
        sync: Callable[[int], object] = os.fsync,
        split: SplitRule | None = None,
        chunk_size: int = CHUNK_SIZE,
        compressed: bool = True,
        sync_now: Callable[[int], object] | None = None,
        at_once: bool = True,
        noted: Callable[[], Mapping[str, object]] | None = None,
        on_split: Callable[[str, str], object] | None = None,
    ) -> None:
        self.path = Path(path)
        self._flush_s, self._clock, self._sync = flush_s, clock, sync
        self._rule = split or SplitRule()
        self._chunk_size, self._compressed = chunk_size, compressed
        self._sync_now = sync_now or sync
        self._sync_folder = os.fsync if sync_now is None else sync
        self._lazy, self._noted, self._on_split = not at_once, noted, on_split
        self._span_ns = int(self._rule.duration_s * 1e9)
        self._topics: dict[str, _Topic] = {}
        self._custom: dict[str, str] = {}
        self._done: list[_Closed] = []
        self._unfinished: list[BagFile] = []
        self._file: BagFile | None = None
        self._next = 0
        self._ended = False
        try:
            self.path.mkdir(parents=True)
        except FileExistsError:
            msg = f"{self.path}: exists already; give a new folder or remove it"
            raise BagError(msg) from None
        except OSError as err:
            raise self._unwritable(err) from err
        if at_once:
            self.open_next()

    # -- topics

    def add_topic(
        self,
        topic: str,
        type_name: str,
        *,
        qos: tuple[QosProfile, ...] = (QosProfile(),),
        message_definition: str | None = None,
        definition_hash: str | None = None,
        encoding: str = "ros2msg",
    ) -> None:
        """Add a topic; adding it again with the same type does nothing.

        Parameters
        ----------
        topic, type_name : str
            Absolute name and full message type.
        qos : tuple of QosProfile
            What its publishers offer.
        message_definition, definition_hash : str, optional
            Full definition and hash; looked up where not given.
        encoding : str
            Kind of the definition.

        Raises
        ------
        BagError
            If the type is defined nowhere or the topic has another type already.
        """
        known = self._topics.get(topic)
        if known is not None:
            if known.about.type != type_name:
                msg = (
                    f"{self.path}: topic '{topic}' is of type {known.about.type}, "
                    f"not {type_name}; use another name"
                )
                raise BagError(msg)
            return
        try:
            text = definition(type_name) if message_definition is None else message_definition
            digest = definition_hash if definition_hash is not None else type_hash(type_name, text)
        except (KeyError, ValueError) as err:
            msg = (
                f"{self.path}: topic '{topic}': message type {type_name} is defined nowhere; "
                "install its package"
            )
            raise BagError(msg) from err
        about = TopicDescription(topic, type_name, digest, qos, encoding, text)
        self._topics[topic] = _Topic(about)
        if self._file is not None:
            self._declare(self._topics[topic], self._file)

    def offer(self, topic: str, qos: tuple[QosProfile, ...]) -> None:
        """Note what the publishers of a topic offer now; it stands in the files that follow."""
        self._topics[topic].about.qos = qos

    def _declare(self, topic: _Topic, file: BagFile) -> int:
        topic.channel, topic.file = file.declare(topic.about), file
        return topic.channel

    # -- messages

    def write(
        self, topic: str, data: bytes, *, log_ns: int, publish_ns: int | None = None
    ) -> None:
        """Append a serialized message.

        Parameters
        ----------
        topic : str
            A topic that was added.
        data : bytes
            CDR bytes with their encapsulation.
        log_ns, publish_ns : int
            Receive time and source time [ns]; the receive time stands for an unknown source time.

        Raises
        ------
        BagError
            If the topic was not added or the disk is full; the messages of the running chunk are
            then lost and no more counted.
        """
        entry = self._topics.get(topic)
        if entry is None:
            msg = f"{self.path}: topic '{topic}' was not added; call add_topic first"
            raise BagError(msg)
        file = self._file_for(log_ns)
        channel = entry.channel if entry.file is file else self._declare(entry, file)
        entry.count += 1
        sent = log_ns if publish_ns is None else publish_ns
        try:
            file.write(channel, data, log_ns=log_ns, publish_ns=sent, sequence=entry.count)
            if self._clock() - self._flushed_s >= self._flush_s:
                self._flush(file)
        except OSError as err:
            raise self._failed(file, err) from err

    def write_sample(
        self, topic: str, stamp_ns: int, value: float, *, log_ns: int | None = None
    ) -> None:
        """Append a Float64Stamped; its log time is its stamp unless one is given."""
        self.add_topic(topic, STAMPED_TYPE)
        self._write_at(topic, encode_stamped(stamp_ns, value), stamp_ns, log_ns)

    def write_samples(self, columns: Sequence[tuple[str, IntArray, FloatArray]]) -> None:
        """Append many Float64Stamped; the same bytes as one by one in the order of their stamps.

        Parameters
        ----------
        columns : sequence of (str, (N,) int64 array, (N,) array)
            A topic of its own, stamps [ns], which are the log times too, and values. Of equal
            stamps that of the earlier column comes first.

        Raises
        ------
        BagError
            If a stamp fits into no header or the disk is full.
        """
        for topic, _, _ in columns:
            self.add_topic(topic, STAMPED_TYPE)
        entries = [self._topics[topic] for topic, _, _ in columns]
        stamps = np.concatenate([np.asarray(s, dtype=np.int64) for _, s, _ in columns])
        values = np.concatenate([np.asarray(v, dtype=np.float64) for _, _, v in columns])
        lengths = [len(s) for _, s, _ in columns]
        owner = np.repeat(np.arange(len(columns)), lengths)
        sequence = np.concatenate(
            [e.count + 1 + np.arange(n) for e, n in zip(entries, lengths, strict=True)]
        )
        if bool((stamps[1:] < stamps[:-1]).any()):
            order = np.argsort(stamps, kind="stable")
            stamps, values = stamps[order], values[order]
            owner, sequence = owner[order], sequence[order]
        try:
            data = encode_stamped_rows(stamps, values)
        except ValueError as err:
            msg = f"{self.path}: topic '{columns[0][0]}': {err}"
            raise BagError(msg) from err
        self._write_rows(entries, owner, data, stamps, sequence)

    def _write_rows(
        self,
        entries: Sequence[_Topic],
        owner: IntArray,
        data: ByteTable,
        stamps: IntArray,
        sequence: IntArray,
    ) -> None:
        """Write messages chunk by chunk; a file that is full ends where it would one by one."""
        at, most = 0, self._chunk_size // data.shape[1] + 1
        while at < len(stamps):
            file = self._file_for(int(stamps[at]))
            channels = np.array(
                [e.channel if e.file is file else self._declare(e, file) for e in entries]
            )
            end = len(stamps)
            if self._span_ns:
                first_ns = file.first_ns if file.first_ns >= 0 else int(stamps[at])
                end = max(at + 1, int(np.searchsorted(stamps, first_ns + self._span_ns)))
            part = slice(at, min(end, at + most))
            try:
                taken = file.write_rows(
                    channels[owner[part]],
                    data[part],
                    np.broadcast_to(stamps[part], (2, len(stamps[part]))),
                    sequence[part],
                )
                counts = np.bincount(owner[at : at + taken], minlength=len(entries))
                for entry, count in zip(entries, counts.tolist(), strict=True):
                    entry.count += count
                at += taken
                if self._clock() - self._flushed_s >= self._flush_s:
                    self._flush(file)
            except OSError as err:
                raise self._failed(file, err) from err

    def write_series(
        self,
        topic: str,
        stamp_ns: int,
        period_s: float,
        values: FloatArray,
        *,
        log_ns: int | None = None,
    ) -> None:
        """Append a Float64Series; its log time is its stamp unless one is given."""
        self.add_topic(topic, SERIES_TYPE)
        self._write_at(topic, encode_series(stamp_ns, period_s, values), stamp_ns, log_ns)

    def _write_at(self, topic: str, data: bytes, stamp_ns: int, log_ns: int | None) -> None:
        self.write(topic, data, log_ns=stamp_ns if log_ns is None else log_ns, publish_ns=stamp_ns)

    def note(self, values: Mapping[str, object]) -> None:
        """Add values of the user's own to the metadata: valve, serial number, losses."""
        self._custom.update({str(key): str(value) for key, value in values.items()})

    def flush(self) -> None:
        """Put everything written so far on disk.

        Raises
        ------
        BagError
            If the disk is full.
        """
        file = self._file
        if file is None:
            return
        try:
            self._flush(file)
        except OSError as err:
            raise self._failed(file, err) from err

    def write_out(self) -> None:
        """Give everything written so far to the kernel, without a sync.

        Raises
        ------
        BagError
            If the disk is full.
        """
        file = self._file
        if file is None:
            return
        try:
            file.write_out()
        except OSError as err:
            raise self._failed(file, err) from err

    def _flush(self, file: BagFile) -> None:
        file.flush()
        self._flushed_s = self._clock()

    # -- files

    def _file_for(self, log_ns: int) -> BagFile:
        """Return the file that the next message belongs to, a new one where the rule says so."""
        file = self._file
        if file is None:
            return self.open_next()
        full = 0 < self._rule.size <= file.size
        if self._span_ns and file.first_ns >= 0:
            full = full or log_ns - file.first_ns >= self._span_ns
        if full:
            self.split()
            assert self._file is not None
            return self._file
        return file

    def open_next(self) -> BagFile:
        """Begin the next file.

        Raises
        ------
        BagError
            If it cannot be made.
        """
        self._done = [d for d in self._done if d.path.exists()]
        file = None
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            file = BagFile(
                self._path(self._next),
                sync=self._sync,
                chunk_size=self._chunk_size,
                compressed=self._compressed,
            )
            sync_folder(self.path, self._sync_folder)
        except OSError as err:
            if file is not None:
                self._remove(file)
            raise self._unwritable(err) from err
        self._next += 1
        for topic in list(self._topics.values()):
            self._declare(topic, file)
        self._file, self._flushed_s = file, self._clock()
        self._retry_unfinished()
        self._keep(self._rule.keep - 1)
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

        Raises
        ------
        BagError
            If the disk is full.
        """
        file = self._file or self.open_next()
        if file.message_count == 0:
            return file.path.name, file.path.name
        try:
            self._finish(file, notes)
        except OSError as err:
            raise self._failed(file, err) from err
        self._file = None
        closed, opened = file.path.name, self._path(self._next).name
        if self._lazy:
            self._keep(self._rule.keep)
            self._save_metadata()
        else:
            self.open_next()
        if self._on_split is not None:
            self._on_split(closed, opened)
        return closed, opened

    def suspend(self) -> None:
        """Close the running file as well as the disk allows; `write` or `open_next` goes on.

        A file for whose summary there is no space is finished when there is; one without a message
        is removed.
        """
        file, self._file = self._file, None
        if file is None:
            return
        try:
            if file.message_count == 0:
                self._remove(file)
            else:
                self._finish(file)
        except OSError:
            self._lose(file)
            self._unfinished.append(file)
            self._done.append(_Closed(file.path, file.entry(), file.counts(), file.size))
        with suppress(OSError):
            self._write_metadata()

    @staticmethod
    def _remove(file: BagFile) -> None:
        file.abandon()
        file.path.unlink(missing_ok=True)

    def _path(self, number: int) -> Path:
        return self.path / f"{self.path.name}_{number}.mcap"

    def _keep(self, files: int) -> None:
        """Delete the oldest closed files but so many."""
        while self._rule.keep > 0 and len(self._done) > files and self.drop_oldest():
            pass

    def drop_oldest(self) -> int:
        """Delete the oldest file that is closed; return its size, 0 where there is none [B]."""
        if not self._done:
            return 0
        oldest = self._done.pop(0)
        for file in [f for f in self._unfinished if f.path == oldest.path]:
            self._unfinished.remove(file)
            file.abandon()
        self._save_metadata()
        oldest.path.unlink(missing_ok=True)
        return max(oldest.size, 1)

    def _finish(self, file: BagFile, notes: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Finish a file and list it; the metadata in it are its own."""
        if self._noted is not None:
            self.note(self._noted())
        entry, counts = self._closing_entry(file), file.counts()
        text = metadata_text(metadata_map([entry], self._topic_entries([counts]), self._custom))
        records: dict[str, Mapping[str, str]] = {"rosbag2": {"serialized_metadata": text}}
        if self._custom:
            records["valve_twin"] = self._custom
        file.finish({**records, **(notes or {})})
        if file not in self._unfinished:
            self._done.append(_Closed(file.path, entry, counts, file.size))

    @staticmethod
    def _closing_entry(file: BagFile) -> FileEntry:
        file.mcap.end_chunk()
        return file.entry()

    def _retry_unfinished(self) -> None:
        for file in list(self._unfinished):
            try:
                self._finish(file)
            except OSError:
                self._lose(file)
            else:
                self._unfinished.remove(file)

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing.

        Raises
        ------
        BagError
            If the disk is full.
        """
        if self._ended:
            return
        self._ended = True
        if self._file is None and not self._done:
            with suppress(BagError):
                self.open_next()
        file, self._file = self._file, None
        try:
            if file is not None and file.message_count == 0 and self._done:
                self._remove(file)
            elif file is not None:
                self._finish(file)
            self._retry_unfinished()
            if self._noted is not None:
                self.note(self._noted())
            self._write_metadata()
        except OSError as err:
            if file is not None:
                self._lose(file)
            raise self._full(err) from err
        finally:
            for left in (*self._unfinished, *([file] if file is not None else [])):
                left.abandon()

    # -- what is there

    @property
    def counts(self) -> dict[str, int]:
        """Messages written by topic."""
        return {t.about.name: t.count for t in list(self._topics.values())}

    @property
    def size(self) -> int:
        """Bytes of the files that are kept [B]."""
        running = 0 if self._file is None else self._file.size
        return running + sum(d.size for d in list(self._done))

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files in their order, the running one included."""
        running = () if self._file is None else (self._file.path.name,)
        return (*(d.path.name for d in list(self._done)), *running)

    # -- metadata

    def _topic_entries(self, counts: list[dict[str, int]]) -> list[TopicEntry]:
        return [
            TopicEntry(a.name, a.type, a.type_hash, a.qos, sum(c.get(a.name, 0) for c in counts))
            for a in (t.about for t in self._topics.values())
        ]

    def _content(self) -> dict[str, object]:
        entries, counts = [d.entry for d in self._done], [d.counts for d in self._done]
        if self._file is not None:
            entries.append(self._file.entry())
            counts.append(self._file.counts())
        return metadata_map(entries, self._topic_entries(counts), self._custom)

    def _save_metadata(self) -> None:
        """Write metadata.yaml of a bag that goes on; it is written again at the end."""
        try:
            self._write_metadata()
        except OSError as err:
            raise self._unwritable(err) from err

    def _write_metadata(self) -> None:
        """Write the file beside and rename it: it is whole or not there."""
        beside = self.path / f"{FILE_NAME}.new"
        try:
            with beside.open("w", encoding="utf-8") as stream:
                stream.write(metadata_text(self._content()))
                stream.flush()
                self._sync_now(stream.fileno())
        except OSError:
            beside.unlink(missing_ok=True)
            raise
        beside.replace(self.path / FILE_NAME)
        sync_folder(self.path, os.fsync)

    # -- errors

    def _lose(self, file: BagFile) -> None:
        """Cut what an error left half written; its messages count no more."""
        with suppress(OSError):
            for name, count in file.give_up().items():
                self._topics[name].count -= count

    def _failed(self, file: BagFile, err: OSError) -> BagError:
        self._lose(file)
        return self._full(err, file.path)

    def _full(self, err: OSError, path: Path | None = None) -> BagError:
        return BagError(
            f"{path or self.path}: cannot be written ({err.strerror}); free some space, what is "
            "written stays readable"
        )

    def _unwritable(self, err: OSError) -> BagError:
        return BagError(
            f"{self.path}: cannot be written ({err.strerror}); check the path and free space"
        )

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
