# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find MCAP records in damaged bytes: a record is believed where its lengths agree."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.mcap.format import MESSAGE_HEAD, RECORD_HEAD, Op

if TYPE_CHECKING:
    import mmap
    from collections.abc import Container

    Bytes = bytes | mmap.mmap

_SHORT, _LONG = -4, -8
"""A part of the length that stands in a 4 or 8 byte number before it."""

_LAYOUTS: dict[int, tuple[int, ...]] = {
    Op.HEADER: (_SHORT, _SHORT),
    Op.FOOTER: (20,),
    Op.SCHEMA: (2, _SHORT, _SHORT, _SHORT),
    Op.CHANNEL: (4, _SHORT, _SHORT, _SHORT),
    Op.CHUNK: (28, _SHORT, _LONG),
    Op.MESSAGE_INDEX: (2, _SHORT),
    Op.CHUNK_INDEX: (32, _SHORT, 8, _SHORT, 16),
    Op.ATTACHMENT: (16, _SHORT, _SHORT, _LONG, 4),
    Op.ATTACHMENT_INDEX: (40, _SHORT, _SHORT),
    Op.STATISTICS: (42, _SHORT),
    Op.METADATA: (_SHORT, _SHORT),
    Op.METADATA_INDEX: (16, _SHORT),
    Op.SUMMARY_OFFSET: (17,),
    Op.DATA_END: (4,),
}
"""Parts of each record's body (mcap.dev/spec): fixed sizes [B], or a number and what it counts."""

ANCHORS = frozenset(_LAYOUTS)
ANYTHING = ANCHORS | {int(Op.MESSAGE)}
_MESSAGE_BODY = MESSAGE_HEAD.size - RECORD_HEAD.size
_WINDOW = 1 << 20
_CHAIN = 3


def record_end(data: Bytes, at: int, end: int, *, op: int | None = None) -> int | None:
    """Return where a record ends if its length agrees with the lengths in it.

    Parameters
    ----------
    data : bytes
        The file, or decompressed records.
    at, end : int
        Where the record begins and where the bytes end.
    op : int, optional
        Read it as this kind, whatever its first byte says.

    Returns
    -------
    int or None
        None where there is no such record.
    """
    if at + RECORD_HEAD.size > end:
        return None
    kind, length = RECORD_HEAD.unpack_from(data, at)
    kind = kind if op is None else op
    begin = at + RECORD_HEAD.size
    if begin + length > end:
        return None
    if kind == Op.MESSAGE:
        return begin + length if length >= _MESSAGE_BODY else None
    layout = _LAYOUTS.get(kind)
    if layout is None:
        return None
    return begin + length if _body_size(data, begin, end, layout) == length else None


def claimed_end(data: Bytes, at: int, end: int) -> int | None:
    """Return where a record ends by its first length alone, None beyond the end.

    Parameters
    ----------
    data : bytes
        The file, or decompressed records.
    at, end : int
        Where the record begins and where the bytes end [B].
    """
    if at + RECORD_HEAD.size > end:
        return None
    _, length = RECORD_HEAD.unpack_from(data, at)
    stop = at + RECORD_HEAD.size + int(length)
    return stop if stop <= end else None


def may_follow(data: Bytes, at: int, end: int) -> bool:
    """Return whether the file may go on at a place: a record, a record that is cut, or the end.

    Parameters
    ----------
    data : bytes
        The file, or decompressed records.
    at, end : int
        The place, and where the bytes end [B].
    """
    if at == end or record_end(data, at, end) is not None:
        return True
    if at > end:
        return False
    if at + RECORD_HEAD.size > end:
        return int(data[at]) in ANYTHING
    kind, length = RECORD_HEAD.unpack_from(data, at)
    known = kind in _LAYOUTS or kind == Op.MESSAGE
    return bool(known and at + RECORD_HEAD.size + length > end and length < 1 << 32)


def is_whole(data: Bytes, at: int, stop: int, end: int) -> bool:
    """Return whether a message that claims to end at `stop` does so.

    Its length is proved by nothing but what follows it. Where that is damaged, the message is
    whole if no record begins within it.

    Parameters
    ----------
    data : bytes
        The file, or decompressed records.
    at, stop : int
        Where the message begins and where it claims to end [B].
    end : int
        Where the bytes end [B].
    """
    if may_follow(data, stop, end):
        return True
    following = next_record(data, at + 1, end, kinds=ANYTHING)
    return following is None or following >= stop


def next_record(data: Bytes, at: int, end: int, *, kinds: Container[int] = ANCHORS) -> int | None:
    """Return the first place from `at` on where records of some kinds begin, None = nowhere.

    A message proves little by its length, so several must follow one another.

    Parameters
    ----------
    data : bytes
        The file, or decompressed records.
    at, end : int
        Where to begin and where the bytes end [B].
    kinds : container of int
        Opcodes that count.
    """
    for start in range(at, end, _WINDOW):
        stop = min(start + _WINDOW, end)
        for place in _candidates(data, start, min(stop + RECORD_HEAD.size - 1, end)):
            if data[place] in kinds and place < stop and _is_chain(data, place, end):
                return place
    return None


def _is_chain(data: Bytes, at: int, end: int) -> bool:
    links = _CHAIN if data[at] == Op.MESSAGE else 1
    for _ in range(links):
        following = record_end(data, at, end)
        if following is None:
            return False
        at = following
        if at == end:
            return True
    return may_follow(data, at, end)


def _candidates(data: Bytes, start: int, stop: int) -> list[int]:
    """Return where a kind of record may stand before a length below 4 GiB."""
    view = np.frombuffer(data[start:stop], dtype=np.uint8)
    count = len(view) - RECORD_HEAD.size + 1
    if count <= 0:
        return []
    found = (view[:count] > 0) & (view[:count] <= Op.DATA_END)
    for byte in range(5, RECORD_HEAD.size):
        found &= view[byte : byte + count] == 0
    places: list[int] = (np.flatnonzero(found) + start).tolist()
    return places


def _body_size(data: Bytes, begin: int, end: int, layout: tuple[int, ...]) -> int:
    """Return the size of a body by the lengths in it, -1 beyond the end."""
    at = begin
    for part in layout:
        if part > 0:
            at += part
            continue
        if at - part > end:
            return -1
        (size,) = struct.unpack_from("<I" if part == _SHORT else "<Q", data, at)
        at += size - part
        if at > end:
            return -1
    return at - begin
