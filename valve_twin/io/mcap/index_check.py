# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether summary and message indexes say what stands in a chunk: they are hints, no more.

The compiled walk (`cdr.columns_kernel`) finds the same flaws while it reads.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.mcap.format import MESSAGE_HEAD, RECORD_HEAD, Op

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    import numpy.typing as npt

    from valve_twin.core.types import ByteArray, IntArray

    Entries = npt.NDArray[np.void]

INDEX_HEAD = RECORD_HEAD.size + 6
"""Bytes of a message index before its entries: record head, channel, length of the entries."""

_CHANNEL_AT = RECORD_HEAD.size
_LOG_AT = RECORD_HEAD.size + 6
_ENTRY = np.dtype([("log", "<u8"), ("place", "<u8")])
ENTRY_SIZE = _ENTRY.itemsize
DEFINITIONS = frozenset({int(Op.SCHEMA), int(Op.CHANNEL)})


class Flaw(IntEnum):
    """What is wrong with a chunk or its indexes."""

    NONE = 0
    TORN = 1
    PLACES = 2
    COUNT = 3
    TIMES = 4
    DEFINITIONS = 5
    CHANNELS = 6
    LATE = 7

    @property
    def text(self) -> str:
        """Say it in words."""
        return _TEXTS[self]


_TEXTS = {
    Flaw.NONE: "",
    Flaw.TORN: "its records do not reach its end",
    Flaw.PLACES: "its message index names places, times or channels that it does not hold",
    Flaw.COUNT: "its message index counts other messages than it holds",
    Flaw.TIMES: "its messages lie outside the times that are stated for it",
    Flaw.DEFINITIONS: "it defines topics or types otherwise than the summary",
    Flaw.CHANNELS: "it holds messages of channels that nothing defines",
    Flaw.LATE: "it defines topics or types behind messages",
}


def _any(_: bytes) -> bool:
    return True


def find_flaw(
    records: bytes | memoryview,
    index: bytes | memoryview,
    start_ns: int,
    end_ns: int,
    is_known: Callable[[bytes], bool] = _any,
    known: Collection[int] | None = None,
) -> Flaw:
    """Compare the records of a chunk with what is stated about them.

    Parameters
    ----------
    records : bytes
        The chunk, unpacked.
    index : bytes
        The message indexes behind it; empty = there are none.
    start_ns, end_ns : int
        First and last log time that are stated [ns].
    is_known : callable
        Gets the record of a definition; returns whether the summary knows it alike.
    known : collection of int, optional
        Channels of which the summary knows the topic; None = any.

    Returns
    -------
    Flaw
        The first that is met; never `Flaw.LATE`, with which the compiled walk asks to look here.
    """
    data = np.frombuffer(records, dtype=np.uint8)
    found = _read_index(index)
    if found is None:
        return Flaw.PLACES
    channels, logs, places = found
    if len(places) and (
        int(places.max()) + MESSAGE_HEAD.size > len(data)
        or len(np.unique(places)) < len(places)
        or not _agree(data, channels, logs, places)
    ):
        return Flaw.PLACES
    if index:
        count, torn, defined = _not_indexed(records, data, places)
        if torn or count:
            return Flaw.TORN if torn else Flaw.COUNT
    else:
        walked = _walk(records)
        if walked is None:
            return Flaw.TORN
        logs, channels, defined = walked
    if not all(map(is_known, defined)):
        return Flaw.DEFINITIONS
    if known is not None and not set(np.unique(channels).tolist()) <= set(known):
        return Flaw.CHANNELS
    if len(logs) and not start_ns <= int(logs.min()) <= int(logs.max()) <= end_ns:
        return Flaw.TIMES
    return Flaw.NONE


def _read_index(index: bytes | memoryview) -> tuple[IntArray, IntArray, IntArray] | None:
    """Return channel, log time [ns] and place of every entry; None where that cannot be read."""
    at, end = 0, len(index)
    channels, entries = [], []
    while at < end:
        if at + INDEX_HEAD > end or index[at] != Op.MESSAGE_INDEX:
            return None
        length = int.from_bytes(index[at + 1 : at + 9], "little")
        size = int.from_bytes(index[at + 11 : at + INDEX_HEAD], "little")
        stop = at + RECORD_HEAD.size + length
        if length != size + 6 or stop > end or size % _ENTRY.itemsize:
            return None
        found = np.frombuffer(index[at + INDEX_HEAD : stop], dtype=_ENTRY)
        channel = int.from_bytes(index[at + 9 : at + 11], "little")
        channels.append(np.full(len(found), channel, dtype=np.int64))
        entries.append(found)
        at = stop
    if not entries:
        nothing = np.empty(0, dtype=np.int64)
        return nothing, nothing, nothing
    joined = np.concatenate(entries)
    return np.concatenate(channels), joined["log"], joined["place"]


def _agree(data: ByteArray, channels: IntArray, logs: IntArray, places: IntArray) -> bool:
    """Return whether a message of each channel and log time stands at each place."""
    at = places.astype(np.int64)
    head = data[at[:, None] + np.arange(MESSAGE_HEAD.size)]
    channel = np.ascontiguousarray(head[:, _CHANNEL_AT : _CHANNEL_AT + 2]).view("<u2")[:, 0]
    log = np.ascontiguousarray(head[:, _LOG_AT : _LOG_AT + 8]).view("<u8")[:, 0]
    return bool((head[:, 0] == Op.MESSAGE).all() and (channel == channels).all()) and bool(
        (log == logs).all()
    )


def _not_indexed(
    records: bytes | memoryview, data: ByteArray, places: IntArray
) -> tuple[int, bool, list[bytes]]:
    """Return how many messages no entry points to, whether the records end too early, definitions.

    Only what lies between the messages that entries point to is walked one by one.
    """
    begins = np.sort(places.astype(np.int64))
    size = len(data)
    if len(begins):
        head = data[begins[:, None] + np.arange(1, RECORD_HEAD.size)]
        lengths = np.ascontiguousarray(head).view("<u8")[:, 0]
        if int(lengths.max()) > size:
            return 0, True, []
        ends = begins + RECORD_HEAD.size + lengths.astype(np.int64)
        froms, tos = np.r_[0, ends], np.r_[begins, size]
    else:
        froms, tos = np.array([0]), np.array([size])
    if (froms > tos).any():
        return 0, True, []
    count, defined = 0, list[bytes]()
    for i in np.flatnonzero(froms < tos).tolist():
        at, stop = int(froms[i]), int(tos[i])
        while at < stop:
            if at + RECORD_HEAD.size > stop:
                return count, True, defined
            op, length = RECORD_HEAD.unpack_from(records, at)
            begin, at = at, at + RECORD_HEAD.size + length
            count += op == Op.MESSAGE
            if op in DEFINITIONS and at <= stop:
                defined.append(bytes(records[begin:at]))
        if at != stop:
            return count, True, defined
    return count, False, defined


def _walk(records: bytes | memoryview) -> tuple[IntArray, IntArray, list[bytes]] | None:
    """Return log times [ns] and channels of messages, and definitions; None where it is torn."""
    at, end = 0, len(records)
    logs, channels, defined = [], list[int](), list[bytes]()
    while at < end:
        if at + RECORD_HEAD.size > end:
            return None
        op, length = RECORD_HEAD.unpack_from(records, at)
        if op == Op.MESSAGE:
            if length < MESSAGE_HEAD.size - RECORD_HEAD.size:
                return None
            if at + MESSAGE_HEAD.size > end:
                return None
            logs.append(int.from_bytes(records[at + _LOG_AT : at + _LOG_AT + 8], "little"))
            channels.append(records[at + _CHANNEL_AT] | records[at + _CHANNEL_AT + 1] << 8)
        begin, at = at, at + RECORD_HEAD.size + length
        if op in DEFINITIONS and at <= end:
            defined.append(bytes(records[begin:at]))
    if at != end:
        return None
    return np.array(logs, dtype=np.uint64), np.array(channels, dtype=np.int64), defined
