# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One MCAP file of a bag: written through, synced, and finished soundly also on a full disk."""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, TextIO, cast

from valve_twin.io.bags.gone import Gone, GoneError, what_became
from valve_twin.io.bags.metadata import FileEntry
from valve_twin.io.bags.qos import QosProfile, qos_text
from valve_twin.io.mcap.writer import CHUNK_SIZE, McapWriter

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path
    from typing import BinaryIO

    from valve_twin.core.types import IntArray
    from valve_twin.io.mcap.format import ByteTable

_MODE = 0o644
_PLAIN = os.O_APPEND | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
"""Written at its end, wherever somebody cut it; closed in child processes; bytes are not taken
for text (Windows)."""


@dataclass(slots=True)
class TopicDescription:
    """What a bag says of a topic: type, definition and what its publishers offer."""

    name: str
    type: str
    type_hash: str
    qos: tuple[QosProfile, ...]
    encoding: str
    definition: str


class _Stream:
    """File without a buffer of its own: what was accepted is the kernel's, whatever dies."""

    def __init__(self, path: Path) -> None:
        self._number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _PLAIN, _MODE)
        self.size = 0
        self.status: os.stat_result | None = None

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            done = os.write(self._number, view)
            self.size += done
            view = view[done:]
        return len(data)

    def truncate(self, size: int) -> None:
        if os.fstat(self._number).st_size > size:  # else zeros would follow on what is there
            os.ftruncate(self._number, size)
        os.lseek(self._number, size, os.SEEK_SET)
        self.size = size

    def fileno(self) -> int:
        return self._number

    def close(self) -> None:
        number, self._number = self._number, -1
        if number >= 0:
            with suppress(OSError):
                self.status = os.fstat(number)
            os.close(number)


class BagFile:
    """One file while it is written.

    Parameters
    ----------
    path : path
        File to make; it must not exist.
    sync : callable
        Called with the file number to put on disk what was written.
    chunk_size : int
        Bytes in a chunk before compression.
    compressed : bool
        Whether chunks are compressed with zstd.

    Raises
    ------
    OSError
        If it cannot be made; also from `write`, `flush` and `finish`.
    """

    def __init__(
        self,
        path: Path,
        *,
        sync: Callable[[int], object] = os.fsync,
        chunk_size: int = CHUNK_SIZE,
        compressed: bool = True,
    ) -> None:
        self.path = path
        self._sync = sync
        self._stream = _Stream(path)
        try:
            self.mcap = McapWriter(
                cast("BinaryIO", self._stream), chunk_size=chunk_size, compressed=compressed
            )
        except OSError:
            self._stream.close()
            path.unlink(missing_ok=True)
            raise
        self._good = self._stream.size
        self._schemas: dict[tuple[str, str], int] = {}
        self._channels: dict[str, int] = {}
        self.finished = False
        self.first_ns = -1
        self.flushed_s = 0.0

    def declare(self, topic: TopicDescription) -> int:
        """Return the channel of a topic, new or known."""
        if topic.name in self._channels:
            return self._channels[topic.name]
        key = (topic.type, topic.definition)
        if key not in self._schemas:
            data = topic.definition.encode()
            self._schemas[key] = self.mcap.add_schema(topic.type, topic.encoding, data)
        metadata = {
            "offered_qos_profiles": qos_text(topic.qos),
            "topic_type_hash": topic.type_hash,
        }
        channel = self.mcap.add_channel(self._schemas[key], topic.name, metadata)
        self._channels[topic.name] = channel
        return channel

    def write(
        self, channel: int, data: bytes, *, log_ns: int, publish_ns: int, sequence: int
    ) -> None:
        """Append a message; a chunk that is full goes to the kernel.

        Parameters
        ----------
        channel : int
            Its number in the file.
        data : bytes
            Serialized message.
        log_ns, publish_ns : int
            Receive time and source time [ns].
        sequence : int
            Number of the message on its channel, 0 = unknown.
        """
        if self.first_ns < 0:
            self.first_ns = log_ns
        self.mcap.write(channel, data, log_ns=log_ns, publish_ns=publish_ns, sequence=sequence)
        self._good = self._stream.size

    def write_rows(
        self, channels: IntArray, data: ByteTable, times: IntArray, sequences: IntArray
    ) -> int:
        """Append messages of one length until a chunk is full; see `McapWriter.write_rows`.

        Parameters
        ----------
        channels, data, times, sequences : arrays
            As `McapWriter.write_rows` takes them.
        """
        if self.first_ns < 0:
            self.first_ns = int(times[0, 0])
        taken = self.mcap.write_rows(channels, data, times, sequences)
        self._good = self._stream.size
        return taken

    def write_out(self) -> None:
        """Give everything written so far to the kernel, which outlives this process."""
        self.mcap.end_chunk()
        self._good = self._stream.size

    def flush(self) -> None:
        """Put everything written so far on disk; `GoneError` where somebody took the file away."""
        self.write_out()
        gone = self.gone()
        if gone is not None:
            raise GoneError(gone)
        self._sync(self._stream.fileno())

    def gone(self) -> Gone | None:
        """Return what somebody did to the file; None where it stands as it was written."""
        return what_became(self.path, self._stream.fileno(), self._stream.size)

    def give_up(self) -> dict[str, int]:
        """After an error cut the file behind its last sound record; return what is lost by topic.

        The messages of the running chunk are lost; the file can be finished as soon as there is
        space.
        """
        self._stream.truncate(self._good)
        lost = self.mcap.drop_chunk(self._good)
        return {name: lost[number] for name, number in self._channels.items() if number in lost}

    def finish(self, records: Mapping[str, Mapping[str, str]]) -> None:
        """Write metadata records, summary and footer and close; after `give_up` try again.

        Parameters
        ----------
        records : mapping
            Metadata records by name.
        """
        if self.finished:
            return
        self.mcap.end_chunk()
        self._good = self._stream.size
        for name, values in records.items():
            self.mcap.add_metadata(name, values)
        self.mcap.finish()
        self._sync(self._stream.fileno())
        self.finished = True
        self._stream.close()

    def abandon(self) -> None:
        """Close as it stands: what is written can be recovered."""
        self._stream.close()

    def remove(self) -> None:
        """Close and delete it, not another one that has its name now."""
        is_there = self.gone() in {None, Gone.CUT}
        self.abandon()
        if is_there:
            self.path.unlink(missing_ok=True)

    @property
    def status(self) -> os.stat_result | None:
        """What the system said of it when it was closed; None where nothing."""
        return self._stream.status

    @property
    def size(self) -> int:
        """Bytes written so far [B]."""
        return self._stream.size

    @property
    def message_count(self) -> int:
        """Messages written, those of the running chunk included [1]."""
        return sum(self.mcap.statistics.counts.values())

    def counts(self) -> dict[str, int]:
        """Return messages written by topic."""
        counts = self.mcap.statistics.counts
        return {name: counts[number] for name, number in list(self._channels.items())}

    def entry(self) -> FileEntry:
        """Return what the bag's metadata says of this file."""
        s = self.mcap.statistics
        return FileEntry(self.path.name, s.start_ns, s.end_ns - s.start_ns, self.message_count)


def hold(path: Path) -> TextIO:
    """Open a file, made where it is missing, that nobody else holds until it is closed.

    Parameters
    ----------
    path : Path
        The file; what it holds stays.

    Raises
    ------
    BlockingIOError
        If another process holds it; not told on Windows.
    """
    stream = path.open("a", encoding="utf-8")
    try:
        import fcntl
    except ImportError:
        return stream
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        stream.close()
        raise
    except OSError:  # a file system without locks
        pass
    return stream


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold a file meanwhile, see `hold`; given back also where forked processes live on."""
    with hold(path) as stream:
        try:
            yield
        finally:
            with suppress(ImportError, OSError):
                import fcntl

                fcntl.flock(stream, fcntl.LOCK_UN)
