# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write rosbag2 folders with MCAP storage that ROS 2 tools read."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.cdr import encode_series, encode_stamped
from valve_twin.io.definitions import definition, type_hash
from valve_twin.io.errors import BagError
from valve_twin.io.mapping import SERIES_TYPE, STAMPED_TYPE
from valve_twin.io.mcap_writer import McapWriter
from valve_twin.io.metadata import (
    FILE_NAME,
    FileEntry,
    QosProfile,
    TopicEntry,
    metadata_map,
    metadata_text,
    qos_text,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType

    from valve_twin.core.types import FloatArray

FLUSH_S = 1.0
"""Longest time that written messages stay in memory [s]."""


@dataclass(slots=True)
class _Topic:
    name: str
    type: str
    type_hash: str
    qos: tuple[QosProfile, ...]
    channel: int
    count: int = 0


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
    ) -> None:
        self.path = Path(path)
        self._flush_s, self._clock, self._sync = flush_s, clock, sync
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._custom: dict[str, str] = {}
        self._closed = False
        try:
            self.path.mkdir(parents=True)
            self._file = self.path / f"{self.path.name}_0.mcap"
            self._stream = self._file.open("xb")
        except FileExistsError:
            msg = f"{self.path}: exists already; give a new folder or remove it"
            raise BagError(msg) from None
        except OSError as err:
            msg = f"{self.path}: cannot be written ({err.strerror}); check the path and free space"
            raise BagError(msg) from err
        self._mcap = McapWriter(self._stream)
        self._flushed_s = clock()

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
            if known.type != type_name:
                msg = (
                    f"{self.path}: topic '{topic}' is of type {known.type}, not {type_name}; "
                    "use another name"
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
        key = (type_name, text)
        if key not in self._schemas:
            self._schemas[key] = self._mcap.add_schema(type_name, encoding, text.encode())
        metadata = {"offered_qos_profiles": qos_text(qos), "topic_type_hash": digest}
        channel = self._mcap.add_channel(self._schemas[key], topic, metadata)
        self._topics[topic] = _Topic(topic, type_name, digest, qos, channel)

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
            If the topic was not added or the disk is full.
        """
        entry = self._topics.get(topic)
        if entry is None:
            msg = f"{self.path}: topic '{topic}' was not added; call add_topic first"
            raise BagError(msg)
        entry.count += 1
        sent = log_ns if publish_ns is None else publish_ns
        try:
            self._mcap.write(
                entry.channel, data, log_ns=log_ns, publish_ns=sent, sequence=entry.count
            )
            if self._clock() - self._flushed_s >= self._flush_s:
                self.flush()
        except OSError as err:
            raise self._full(err) from err

    def write_sample(
        self, topic: str, stamp_ns: int, value: float, *, log_ns: int | None = None
    ) -> None:
        """Append a Float64Stamped; its log time is its stamp unless one is given."""
        self.add_topic(topic, STAMPED_TYPE)
        self._write_at(topic, encode_stamped(stamp_ns, value), stamp_ns, log_ns)

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
        """Put everything written so far on disk."""
        self._mcap.end_chunk()
        self._stream.flush()
        self._sync(self._stream.fileno())
        self._flushed_s = self._clock()

    @property
    def counts(self) -> dict[str, int]:
        """Messages written by topic."""
        return {t.name: t.count for t in self._topics.values()}

    @property
    def size(self) -> int:
        """Bytes written so far [B]."""
        return self._mcap.size

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing.

        Raises
        ------
        BagError
            If the disk is full.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._mcap.end_chunk()
            content = self._content()
            self._mcap.add_metadata("rosbag2", {"serialized_metadata": metadata_text(content)})
            if self._custom:
                self._mcap.add_metadata("valve_twin", self._custom)
            self._mcap.finish()
            self._stream.flush()
            self._sync(self._stream.fileno())
            self._write_metadata(metadata_text(content))
        except OSError as err:
            raise self._full(err) from err
        finally:
            self._stream.close()

    def _content(self) -> dict[str, object]:
        s = self._mcap.statistics
        files = [FileEntry(self._file.name, s.start_ns, s.end_ns - s.start_ns, s.message_count)]
        topics = [
            TopicEntry(t.name, t.type, t.type_hash, t.qos, t.count) for t in self._topics.values()
        ]
        return metadata_map(files, topics, self._custom)

    def _write_metadata(self, text: str) -> None:
        """Write the file beside and rename it: it is whole or not there."""
        beside = self.path / f"{FILE_NAME}.new"
        with beside.open("w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            self._sync(stream.fileno())
        beside.replace(self.path / FILE_NAME)

    def _full(self, err: OSError) -> BagError:
        return BagError(
            f"{self._file}: cannot be written ({err.strerror}); free some space, what is "
            "written stays readable"
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
