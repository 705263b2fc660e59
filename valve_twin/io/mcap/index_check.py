# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether the message indexes behind a chunk say what stands in it: hints, no more.

The compiled walk (`cdr.columns_kernel`) finds the same flaws while it reads.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.mcap.format import MESSAGE_HEAD, RECORD_HEAD, Op

if TYPE_CHECKING:
    import numpy.typing as npt

    from valve_twin.core.types import ByteArray, IntArray

    Entries = npt.NDArray[np.void]

INDEX_HEAD = RECORD_HEAD.size + 6
"""Bytes of a message index before its entries: record head, channel, length of the entries."""

_CHANNEL_AT = RECORD_HEAD.size
_LOG_AT = RECORD_HEAD.size + 6
_ENTRY = np.dtype([("log", "<u8"), ("place", "<u8")])
ENTRY_SIZE = _ENTRY.itemsize


class Flaw(IntEnum):
    """What is wrong with a chunk or its indexes."""

    NONE = 0
    TORN = 1
    PLACES = 2
    COUNT = 3
    TIMES = 4

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
}


def find_flaw(
    records: bytes | memoryview, index: bytes | memoryview, start_ns: int, end_ns: int
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

    Returns
    -------
    Flaw
        The first that is met.
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
        count, torn = _not_indexed(records, data, places)
        if torn or count:
            return Flaw.TORN if torn else Flaw.COUNT
    else:
        walked = _walk(records)
        if walked is None:
            return Flaw.TORN
        logs = walked
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
) -> tuple[int, bool]:
    """Return how many messages no entry points to, and whether the records end too early.

    Only what lies between the messages that entries point to is walked one by one.
    """
    begins = np.sort(places.astype(np.int64))
    size = len(data)
    if len(begins):
        head = data[begins[:, None] + np.arange(1, RECORD_HEAD.size)]
        lengths = np.ascontiguousarray(head).view("<u8")[:, 0]
        if int(lengths.max()) > size:
            return 0, True
        ends = begins + RECORD_HEAD.size + lengths.astype(np.int64)
        froms, tos = np.r_[0, ends], np.r_[begins, size]
    else:
        froms, tos = np.array([0]), np.array([size])
    if (froms > tos).any():
        return 0, True
    count = 0
    for i in np.flatnonzero(froms < tos).tolist():
        at, stop = int(froms[i]), int(tos[i])
        while at < stop:
            if at + RECORD_HEAD.size > stop:
                return count, True
            op, length = RECORD_HEAD.unpack_from(records, at)
            count += op == Op.MESSAGE
            at += RECORD_HEAD.size + length
        if at != stop:
            return count, True
    return count, False


def _walk(records: bytes | memoryview) -> IntArray | None:
    """Return the log times of all messages [ns]; None where the records end too early."""
    at, end = 0, len(records)
    logs = []
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
        at += RECORD_HEAD.size + length
    return np.array(logs, dtype=np.uint64) if at == end else None
