# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Take columns of our own sample messages out of a decompressed chunk in one step.

All messages of a channel in a chunk must have the length and the layout words (byte order, length
of frame_id, count of values) of the first; anything else is left to the general decoder.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import as_strided

from valve_twin.io.mapping import SERIES_TYPE, STAMPED_TYPE, SignalSource
from valve_twin.io.mcap_format import MESSAGE_HEAD, RECORD_HEAD, Op

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

ByteTable = np.ndarray[tuple[int, int], np.dtype[np.uint8]]
"""One row a record, one column a byte."""

_RECORD = struct.Struct("<BQH")
_LOG_AT = 15
_LENGTH_AT = 1
_LITTLE = 1
_BODY = 4
_SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Columns:
    """N samples of one signal in file order.

    Attributes
    ----------
    log_ns, stamp_ns : (N,) int64 arrays
        Receive time of the message and stamp of the sample [ns].
    values : (N,) array
        Values in the unit of the signal.
    stamped : (N,) bool array
        Whether the stamp comes from the message.
    messages : int
        Messages that the samples come from.
    """

    log_ns: IntArray
    stamp_ns: IntArray
    values: FloatArray
    stamped: BoolArray
    messages: int = 0


def gather(data: bytes, offsets: IntArray, source: SignalSource, channel: int) -> Columns | None:
    """Take a channel's samples out of a chunk.

    Parameters
    ----------
    data : bytes
        Decompressed records of the chunk.
    offsets : (M,) int64 array
        Where the channel's message records begin.
    source : SignalSource
        A signal of type Float64Stamped or Float64Series.
    channel : int
        Number of the channel.

    Returns
    -------
    Columns or None
        None where the messages differ in layout or are of another type.
    """
    known = {STAMPED_TYPE: "value", SERIES_TYPE: "values[]"}
    if known.get(source.type) != source.field or not len(offsets):
        return None
    first = int(offsets[0])
    size = int.from_bytes(data[first + _LENGTH_AT : first + 9], "little") + 9
    if offsets.min() < 0 or int(offsets.max()) + size > len(data):
        return None
    flat = np.frombuffer(data, dtype=np.uint8)
    if not _is_uniform(_table(flat, offsets, _RECORD.size), size, channel):
        return None
    rows = _table(flat, offsets, size)
    body = rows[:, MESSAGE_HEAD.size :]
    if not _is_uniform_header(body):
        return None
    read = _stamped if source.type == STAMPED_TYPE else _series
    return read(rows, body, source)


def _table(
    flat: np.ndarray[tuple[int], np.dtype[np.uint8]], offsets: IntArray, width: int
) -> ByteTable:
    """Return `width` bytes from each offset on; a view where the offsets are evenly spaced."""
    step = int(offsets[1] - offsets[0]) if len(offsets) > 1 else 0
    if step >= width and bool((np.diff(offsets) == step).all()):
        shape = (len(offsets), width)
        return as_strided(flat[int(offsets[0]) :], shape, (step, 1), writeable=False)
    table: ByteTable = flat[offsets[:, None] + np.arange(width)]
    return table


def _is_uniform(heads: ByteTable, size: int, channel: int) -> bool:
    """Return whether all records are messages of the channel with the same length."""
    expected = _RECORD.pack(Op.MESSAGE, size - RECORD_HEAD.size, channel)
    return size > MESSAGE_HEAD.size and bool((heads == np.frombuffer(expected, np.uint8)).all())


def _is_uniform_header(body: ByteTable) -> bool:
    """Return whether all messages are little-endian with a frame_id of the same length."""
    if body.shape[1] < _BODY + 12 or not bool((body[:, 1] == _LITTLE).all()):
        return False
    return bool((body[:, 12:16] == body[0, 12:16]).all())


def _column(
    rows: ByteTable, at: int, kind: str, count: int = 1
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    size = np.dtype(kind).itemsize * count
    return np.ascontiguousarray(rows[:, at : at + size]).view(kind)


def _value_at(body: ByteTable) -> int:
    end = 12 + int.from_bytes(body[0, 12:16].tobytes(), "little")
    return _BODY + end + (-end % 8)


def _times(
    rows: ByteTable,
    body: ByteTable,
) -> tuple[IntArray, IntArray, BoolArray]:
    """Return log times, stamps with the log time where there is none, and which are stamps."""
    log_ns = _column(rows, _LOG_AT, "<u8")[:, 0].astype(np.int64)
    sec = _column(body, _BODY, "<i4")[:, 0].astype(np.int64)
    nanosec = _column(body, _BODY + 4, "<u4")[:, 0].astype(np.int64)
    stamp_ns = sec * _SECOND_NS + nanosec
    stamped = stamp_ns != 0
    return log_ns, np.where(stamped, stamp_ns, log_ns), stamped


def _scaled(values: FloatArray, source: SignalSource) -> FloatArray:
    if source.scale == 1.0 and source.offset == 0.0:
        return values
    return values * source.scale + source.offset


def _stamped(
    rows: ByteTable,
    body: ByteTable,
    source: SignalSource,
) -> Columns | None:
    at = _value_at(body)
    if body.shape[1] != at + 8:
        return None
    log_ns, stamp_ns, stamped = _times(rows, body)
    values = _column(body, at, "<f8")[:, 0].astype(np.float64)
    return Columns(log_ns, stamp_ns, _scaled(values, source), stamped, len(rows))


def _series(
    rows: ByteTable,
    body: ByteTable,
    source: SignalSource,
) -> Columns | None:
    at = _value_at(body)
    if body.shape[1] < at + 16 or not bool((body[:, at : at + 12] == body[0, at : at + 12]).all()):
        return None
    period = float(_column(body[:1], at, "<f8")[0, 0])
    count = int.from_bytes(body[0, at + 8 : at + 12].tobytes(), "little")
    if count < 1 or body.shape[1] != at + 16 + 8 * count or not 0.0 < period < np.inf:
        return None
    log_ns, begin_ns, stamped = _times(rows, body)
    steps = np.rint(np.arange(count) * (period * 1e9)).astype(np.int64)
    values = _column(body, at + 16, "<f8", count).astype(np.float64).reshape(-1)
    return Columns(
        np.repeat(log_ns, count),
        (begin_ns[:, None] + steps).reshape(-1),
        _scaled(values, source),
        np.repeat(stamped, count),
        len(rows),
    )
