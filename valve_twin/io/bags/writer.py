# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write rosbag2 folders with MCAP storage that ROS 2 tools read."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.bags.qos import QosProfile
from valve_twin.io.bags.rolling import FileEvents, RollingFiles, SplitRule, Storage
from valve_twin.io.bags.topics import WrittenTopic, WrittenTopics
from valve_twin.io.cdr.codec import encode_series, encode_stamped_rows
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE
from valve_twin.io.errors import BagError
from valve_twin.io.mcap.writer import CHUNK_SIZE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from types import TracebackType

    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.io.bags.file import BagFile
    from valve_twin.io.mcap.format import ByteTable

FLUSH_S = 1.0
"""Longest time that written messages stay in memory [s]."""


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
    sync_now : callable, optional
        Where `sync` only orders a sync: what really does it, for metadata.yaml.
    split : SplitRule
        When a new file begins and how many are kept.
    chunk_size : int
        Bytes in a chunk before compression.
    compressed : bool
        Whether chunks are compressed with zstd.
    at_once : bool
        Make the first file now, not with the first message.
    events : FileEvents, optional
        What is called when a file is finished.

    Attributes
    ----------
    path : Path
        The folder.
    topics : WrittenTopics
        What is written.
    rolling : RollingFiles
        Its files.

    Raises
    ------
    BagError
        If the folder exists or cannot be made, a topic was not added, or the disk is full; the
        messages of the running chunk are then lost and no more counted.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        flush_s: float = FLUSH_S,
        clock: Callable[[], float] = time.monotonic,
        sync: Callable[[int], object] = os.fsync,
        sync_now: Callable[[int], object] | None = None,
        split: SplitRule | None = None,
        chunk_size: int = CHUNK_SIZE,
        compressed: bool = True,
        at_once: bool = True,
        events: FileEvents | None = None,
    ) -> None:
        self.path = Path(path)
        self._flush_s, self._clock, self._chunk_size = flush_s, clock, chunk_size
        self._span_ns = split.span_ns if split is not None else 0
        self.topics = WrittenTopics(self.path)
        self.rolling = RollingFiles(
            self.path,
            self.topics,
            storage=Storage(sync, sync_now, chunk_size, compressed, clock),
            rule=split or SplitRule(),
            events=events or FileEvents(),
            at_once=at_once,
        )

    def add_topic(
        self,
        topic: str,
        type_name: str,
        *,
        qos: tuple[QosProfile, ...] = (QosProfile(),),
        message_definition: str | None = None,
        definition_hash: str | None = None,
        encoding: str = "ros2msg",
    ) -> WrittenTopic:
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
        added = self.topics.add(
            topic,
            type_name,
            qos,
            message_definition=message_definition,
            definition_hash=definition_hash,
            encoding=encoding,
        )
        if self.rolling.running is not None:
            added.channel_in(self.rolling.running)
        return added

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
        """
        entry = self.topics[topic]
        file = self.rolling.file_for(log_ns)
        channel = entry.channel if entry.file is file else entry.channel_in(file)
        entry.count += 1
        sent = log_ns if publish_ns is None else publish_ns
        try:
            file.write(channel, data, log_ns=log_ns, publish_ns=sent, sequence=entry.count)
            if self._clock() - file.flushed_s >= self._flush_s:
                self._flush(file)
        except OSError as err:
            raise self.rolling.failure(file, err) from err

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
        entries = [self.add_topic(topic, STAMPED_TYPE) for topic, _, _ in columns]
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

    def write_series(self, topic: str, stamp_ns: int, period_s: float, values: FloatArray) -> None:
        """Append a Float64Series, received when it was stamped.

        Parameters
        ----------
        topic : str
            Added where it is not known.
        stamp_ns : int
            Stamp of values[0] [ns].
        period_s : float
            Time between two values [s].
        values : (N,) array
            The samples, in the unit of the topic [any].
        """
        self.add_topic(topic, SERIES_TYPE)
        data = encode_series(stamp_ns, period_s, values)
        self.write(topic, data, log_ns=stamp_ns, publish_ns=stamp_ns)

    def note(self, values: Mapping[str, object]) -> None:
        """Add values of the user's own to the metadata: valve, serial number, losses."""
        self.rolling.note(values)

    def flush(self, *, sync: bool = True) -> None:
        """Put everything written so far on disk.

        Parameters
        ----------
        sync : bool
            False: only give it to the kernel, which outlives this process.
        """
        file = self.rolling.running
        if file is None:
            return
        try:
            if sync:
                self._flush(file)
            else:
                file.write_out()
        except OSError as err:
            raise self.rolling.failure(file, err) from err

    def split(self, notes: Mapping[str, Mapping[str, str]] | None = None) -> tuple[str, str]:
        """Finish the running file and begin the next; return their names.

        Parameters
        ----------
        notes : mapping, optional
            Metadata records for the finished file by name.
        """
        return self.rolling.split(notes)

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing."""
        self.rolling.close()

    @property
    def counts(self) -> dict[str, int]:
        """Messages written by topic."""
        return self.topics.counts()

    def _flush(self, file: BagFile) -> None:
        file.flush()
        file.flushed_s = self._clock()

    def _write_rows(
        self,
        entries: Sequence[WrittenTopic],
        owner: IntArray,
        data: ByteTable,
        stamps: IntArray,
        sequence: IntArray,
    ) -> None:
        """Write messages chunk by chunk; a file that is full ends where it would one by one."""
        at, most = 0, self._chunk_size // data.shape[1] + 1
        while at < len(stamps):
            file = self.rolling.file_for(int(stamps[at]))
            channels = np.array([e.channel_in(file) for e in entries])
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
                if self._clock() - file.flushed_s >= self._flush_s:
                    self._flush(file)
            except OSError as err:
                raise self.rolling.failure(file, err) from err

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
