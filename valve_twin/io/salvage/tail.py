# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read the end of a file that may be damaged: its summary and how far it can be believed."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from valve_twin.io.mcap.format import FOOTER_SIZE, MAGIC, RECORD_HEAD, Op
from valve_twin.io.mcap.summary import Summary
from valve_twin.io.salvage.records import next_record, record_end

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.io.salvage.records import Bytes

_DATA_END = RECORD_HEAD.pack(Op.DATA_END, 4)
_DATA_END_SIZE = RECORD_HEAD.size + 4
_FOOTER = RECORD_HEAD.pack(Op.FOOTER, 20)
_FIELDS = struct.Struct("<QQI")
_SUMMARY_KINDS = frozenset(
    {Op.SCHEMA, Op.CHANNEL, Op.STATISTICS, Op.CHUNK_INDEX, Op.METADATA_INDEX}
)


class Trust(Enum):
    """How far the summary can be believed."""

    VERIFIED = "its check sum is right"
    UNCHECKED = "it has no check sum"
    DAMAGED = "its check sum is wrong"
    MISSING = "there is none"


@dataclass(slots=True)
class Tail:
    """The end of a file.

    Attributes
    ----------
    trust : Trust
        How far `summary` can be believed.
    begin : int
        Where the records of the data end [B].
    finished : bool
        Whether the file was written to its end, as far as can be seen.
    flaws : list of (int, int, str, str)
        Damaged places: offset, length, what, why.
    summary : Summary
        What was read of it.
    """

    trust: Trust
    begin: int
    finished: bool
    flaws: list[tuple[int, int, str, str]] = field(default_factory=list)
    summary: Summary = field(default_factory=Summary)


def read_tail(data: Bytes) -> Tail:
    """Read the end of a file."""
    size = len(data)
    foot = size - FOOTER_SIZE
    tail = _by_footer(data, foot) if foot >= len(MAGIC) else None
    if tail is None:
        tail = _by_data_end(data, foot)
    if tail.finished and data[size - len(MAGIC) :] != MAGIC:
        flaw = (size - len(MAGIC), len(MAGIC), "closing mark", "is damaged")
        tail.flaws.append(flaw)
    return tail


def _by_footer(data: Bytes, foot: int) -> Tail | None:
    """Read the summary where the footer says it is, None where the footer is not believable."""
    if data[foot : foot + RECORD_HEAD.size] != _FOOTER:
        return None
    start, _, crc = _FIELDS.unpack_from(data, foot + RECORD_HEAD.size)
    begin = start - _DATA_END_SIZE
    if start == 0 or not len(MAGIC) <= begin <= foot:
        begin = foot - _DATA_END_SIZE
        whole = start == 0 and data[begin : begin + len(_DATA_END)] == _DATA_END
        return Tail(Trust.MISSING, begin, finished=True) if whole else None
    marked = data[begin : begin + len(_DATA_END)] == _DATA_END
    flaws = [] if marked else [(begin, _DATA_END_SIZE, "end of data", "is damaged")]
    if crc and crc == _sum(data, start, foot, start):
        return Tail(Trust.VERIFIED, begin, True, flaws, _summary(data, start, foot))
    if not marked and (data[start] not in _SUMMARY_KINDS or record_end(data, start, foot) is None):
        return None
    trust = Trust.DAMAGED if crc else Trust.UNCHECKED
    if crc:
        flaws.append((start, foot - start, "summary", "its check sum is wrong"))
    return Tail(trust, begin, True, flaws, _summary(data, start, foot))


def _by_data_end(data: Bytes, foot: int) -> Tail:
    """Read the summary behind the last record that ends the data."""
    size = len(data)
    begin = data.rfind(_DATA_END, len(MAGIC))
    start = begin + _DATA_END_SIZE
    if begin < 0 or start > size or (start < size and not _goes_on(data, start)):
        return Tail(Trust.MISSING, size, finished=False)
    finished = foot >= start
    if finished:
        crc = _FIELDS.unpack_from(data, foot + RECORD_HEAD.size)[2]
        flaw = (foot, FOOTER_SIZE - len(MAGIC), "footer", "is damaged")
        if crc and crc == _sum(data, start, foot, start):
            return Tail(Trust.VERIFIED, begin, True, [flaw], _summary(data, start, foot))
        return Tail(Trust.UNCHECKED, begin, True, [flaw], _summary(data, start, foot))
    flaw = (start, size - start, "summary", "the file ends in it")
    return Tail(Trust.UNCHECKED, begin, False, [flaw], _summary(data, start, size))


def _goes_on(data: Bytes, start: int) -> bool:
    """Return whether something of a summary, or a footer, stands here."""
    if record_end(data, start, len(data)) is not None:
        return True
    return data[start] in (*_SUMMARY_KINDS, Op.FOOTER) or len(data) - start < FOOTER_SIZE


def _sum(data: Bytes, start: int, foot: int, stated: int) -> int:
    """Return the check sum that a footer with sound fields would carry."""
    offsets = _FIELDS.unpack_from(data, foot + RECORD_HEAD.size)[1]
    head = _FOOTER + struct.pack("<QQ", stated, offsets)
    return zlib.crc32(head, zlib.crc32(data[start:foot]))


def _summary(data: Bytes, start: int, stop: int) -> Summary:
    """Read the records of a summary that can be read."""
    summary = Summary()
    for begin, end in _sound(data, start, stop):
        op = data[begin]
        if op not in _SUMMARY_KINDS:
            continue
        try:
            summary.add(op, data[begin + RECORD_HEAD.size : end])
        except (struct.error, ValueError, OverflowError):
            continue
    return summary


def _sound(data: Bytes, start: int, stop: int) -> Iterator[tuple[int, int]]:
    at: int | None = start
    while at is not None and at < stop:
        end = record_end(data, at, stop)
        if end is None:
            at = next_record(data, at + 1, stop)
            continue
        yield at, end
        at = end
