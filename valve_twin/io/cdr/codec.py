# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Serialize and read our own sample messages as CDR bytes, without ROS.

Layout of Float64Stamped after the 4 bytes of encapsulation: int32 sec, uint32 nanosec, uint32
length of frame_id with its closing zero, frame_id, padding to 8, float64 value. Float64Series goes
on with float64 period, uint32 count, padding to 8, float64 values. Alignment counts from behind
the encapsulation.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.io.mcap.format import ByteTable

_LITTLE = b"\x00\x01\x00\x00"
_SECOND_NS = 1_000_000_000
_HEADS = {0: struct.Struct(">iII"), 1: struct.Struct("<iII")}
_DOUBLES = {0: struct.Struct(">d"), 1: struct.Struct("<d")}
_COUNTS = {0: struct.Struct(">I"), 1: struct.Struct("<I")}
_BODY = 4
_FRAME_ID = 16
_MAX_SECONDS = 2**31


def _pad(size: int) -> int:
    return -size % 8


def _header(stamp_ns: int, frame_id: str) -> bytes:
    sec, nanosec = divmod(int(stamp_ns), _SECOND_NS)
    if not 0 <= sec < _MAX_SECONDS:
        msg = (
            f"stamp {stamp_ns} ns does not fit into a message header, which holds the years "
            "1970 to 2038"
        )
        raise ValueError(msg)
    name = frame_id.encode() + b"\0"
    body = struct.pack("<iII", sec, nanosec, len(name)) + name
    return _LITTLE + body + bytes(_pad(len(body)))


def encode_stamped(stamp_ns: int, value: float, frame_id: str = "") -> bytes:
    """Serialize a Float64Stamped.

    Parameters
    ----------
    stamp_ns : int
        Stamp [ns].
    value : float
        In the unit of the topic [any].
    frame_id : str
        Frame of the header.


    Raises
    ------
    ValueError
        If the stamp does not fit into a header.
    """
    return _header(stamp_ns, frame_id) + _DOUBLES[1].pack(value)


def encode_stamped_rows(stamps_ns: IntArray, values: FloatArray) -> ByteTable:
    """Serialize many Float64Stamped at once.

    Parameters
    ----------
    stamps_ns : (N,) int64 array
        Stamps [ns].
    values : (N,) array
        Values [any].

    Returns
    -------
    (N, S) uint8 array
        One message a row.

    Raises
    ------
    ValueError
        If a stamp does not fit into a header.
    """
    for stamp in (int(stamps_ns.min(initial=0)), int(stamps_ns.max(initial=0))):
        head = _header(stamp, "")
    name = head[_FRAME_ID - _BODY :]
    kinds = [("order", "V4"), ("sec", "<i4"), ("nanosec", "<u4")]
    rows = np.empty(len(stamps_ns), dtype=[*kinds, ("name", f"V{len(name)}"), ("value", "<f8")])
    rows["order"], rows["name"] = np.void(_LITTLE), np.void(name)
    rows["sec"], rows["nanosec"] = np.divmod(stamps_ns, _SECOND_NS)
    rows["value"] = values
    return rows.view(np.uint8).reshape(len(rows), rows.itemsize)


def encode_series(stamp_ns: int, period_s: float, values: FloatArray, frame_id: str = "") -> bytes:
    """Serialize a Float64Series.

    Parameters
    ----------
    stamp_ns : int
        Stamp of values[0] [ns].
    period_s : float
        Time between two values [s].
    values : (N,) array
        The samples [any].
    frame_id : str
        Frame of the header.

    Raises
    ------
    ValueError
        If the stamp does not fit into a header.
    """
    data = np.ascontiguousarray(values, dtype="<f8")
    head = _header(stamp_ns, frame_id) + _DOUBLES[1].pack(period_s) + _COUNTS[1].pack(len(data))
    return head + (bytes(4) + data.tobytes() if len(data) else b"")


def _read_header(data: bytes) -> tuple[int, int, int]:
    """Return byte order (1 = little), stamp and offset of what follows the header."""
    order = data[1]
    sec, nanosec, length = _HEADS[order].unpack_from(data, _BODY)
    end = _FRAME_ID - _BODY + length
    return order, sec * _SECOND_NS + nanosec, _BODY + end + _pad(end)


def decode_stamped(data: bytes) -> tuple[int, float]:
    """Read a Float64Stamped.

    Returns
    -------
    int, float
        Stamp [ns] and value.

    Raises
    ------
    ValueError
        If the bytes are no such message.
    """
    try:
        order, stamp_ns, at = _read_header(data)
        return stamp_ns, _DOUBLES[order].unpack_from(data, at)[0]
    except (struct.error, IndexError, KeyError) as err:
        raise ValueError(_broken(data, "Float64Stamped")) from err


def decode_series(data: bytes) -> tuple[int, float, FloatArray]:
    """Read a Float64Series.

    Returns
    -------
    int, float, (N,) array
        Stamp of the first value [ns], period [s], values.

    Raises
    ------
    ValueError
        If the bytes are no such message.
    """
    try:
        order, stamp_ns, at = _read_header(data)
        period = _DOUBLES[order].unpack_from(data, at)[0]
        count = _COUNTS[order].unpack_from(data, at + 8)[0]
        if not count:
            return stamp_ns, period, np.empty(0)
        values = np.frombuffer(data, dtype="<f8" if order else ">f8", count=count, offset=at + 16)
    except (struct.error, IndexError, KeyError, ValueError) as err:
        raise ValueError(_broken(data, "Float64Series")) from err
    return stamp_ns, period, values.astype(np.float64)


def decode_string(data: bytes) -> str:
    """Return the text of a std_msgs/msg/String.

    Raises
    ------
    ValueError
        If the bytes are no valid message.
    """
    try:
        (size,) = struct.unpack_from("<I" if data[1] & 1 else ">I", data, 4)
        if not 1 <= size <= len(data) - 8:
            raise ValueError(_broken(data, "String"))
        return data[8 : 7 + size].decode()
    except (struct.error, IndexError, UnicodeDecodeError) as err:
        raise ValueError(_broken(data, "String")) from err


def _broken(data: bytes, name: str) -> str:
    return f"{len(data)} bytes are no valid {name}"


def encode_string(text: str) -> bytes:
    """Serialize a std_msgs/msg/String."""
    data = text.encode() + b"\0"
    return _LITTLE + struct.pack("<I", len(data)) + data
