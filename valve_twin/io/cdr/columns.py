# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Columns of samples that grow while a bag is read, filled by the compiled walk or by hand."""

from __future__ import annotations

import struct
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.mcap.format import RECORD_HEAD
from valve_twin.io.mcap.index_check import Flaw

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from valve_twin.core.types import BoolArray, ByteArray, FloatArray, IntArray
    from valve_twin.io.cdr.layout import Layout
    from valve_twin.io.cdr.signals import SignalSource
    from valve_twin.io.mcap.format import ChunkIndex

COMPILED_FROM = 20_000
"""Messages from which on it pays to import numba where nothing else needed it [1]."""

_SMALLEST_MESSAGE = 35
_LEAST_CAPACITY = 1024
_SAMPLES, _ODD = 0, 2
_LAST_NS = 2**63 - 1
_STATED = struct.Struct("<4q")
_NO_ROWS: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class Columns:
    """N samples of one signal.

    Attributes
    ----------
    log_ns, stamp_ns : (N,) int64 arrays
        Receive time of the message and stamp of the sample [ns].
    values : (N,) array
        Values in the unit of the signal.
    stamped : (N,) bool array
        Whether the stamp comes from the message.
    """

    log_ns: IntArray
    stamp_ns: IntArray
    values: FloatArray
    stamped: BoolArray

    def __len__(self) -> int:
        return len(self.log_ns)


class ColumnStore:
    """Samples of R signals in the order in which they were read.

    Parameters
    ----------
    sources : sequence of SignalSource
        The signals; values are kept as they stand in the messages and scaled when taken out.
    capacity : int
        Samples a signal for which there is room at first [1].
    """

    def __init__(self, sources: Sequence[SignalSource], capacity: int = 0) -> None:
        self._sources = tuple(sources)
        self._capacity = capacity
        self.counts: IntArray = np.zeros((len(self._sources), 3), dtype=np.int64)
        self._make(0)

    def _make(self, capacity: int) -> None:
        rows = len(self._sources)
        self._free = capacity
        self.times: IntArray = np.empty((2 * rows, capacity), dtype=np.int64)
        self.values: FloatArray = np.empty((rows, capacity))
        self.stamped: ByteArray = np.empty((rows, capacity), dtype=np.uint8)

    def reserve(self, extra: int) -> None:
        """Make room for more samples of every signal."""
        self._free -= extra
        if self._free < 0:
            self._grow(extra)

    def _grow(self, extra: int) -> None:
        used = int(self.counts[:, _SAMPLES].max(initial=0))
        times, values, stamped = self.times, self.values, self.stamped
        if used + extra > values.shape[1]:
            self._make(max(used + extra, self._capacity, _LEAST_CAPACITY, 2 * used))
            self.times[:, :used] = times[:, :used]
            self.values[:, :used] = values[:, :used]
            self.stamped[:, :used] = stamped[:, :used]
        self._free = self.values.shape[1] - used - extra

    def append(
        self, row: int, log_ns: int, stamp_ns: IntArray, values: FloatArray, *, stamped: bool
    ) -> None:
        """Add the samples of one message; the values as they stand in it.

        Parameters
        ----------
        row : int
            Place of the signal among the wanted ones.
        log_ns : int
            Log time of the message [ns].
        stamp_ns : (N,) int64 array
            Stamps [ns].
        values : (N,) array
            Values before scale and offset [any].
        stamped : bool
            Whether the stamps come from the message.
        """
        count = len(values)
        self.reserve(count)
        begin = int(self.counts[row, _SAMPLES])
        part = slice(begin, begin + count)
        self.times[2 * row, part] = log_ns
        self.times[2 * row + 1, part] = stamp_ns
        self.values[row, part] = values
        self.stamped[row, part] = stamped
        self.counts[row, _SAMPLES] += count

    def take(self) -> dict[int, Columns]:
        """Hand out what was read, by signal in log-time order, and begin anew."""
        found = {
            row: self._columns(row, source)
            for row, source in enumerate(self._sources)
            if self.counts[row, _SAMPLES]
        }
        self._capacity = max(self._capacity, self.values.shape[1])  # the next are as many
        self.counts[:] = 0
        self._make(0)
        return found

    def _columns(self, row: int, source: SignalSource) -> Columns:
        part = slice(0, int(self.counts[row, _SAMPLES]))
        log_ns, stamp_ns = self.times[2 * row, part], self.times[2 * row + 1, part]
        values, stamped = self.values[row, part], self.stamped[row, part].view(np.bool_)
        if source.scale != 1.0 or source.offset != 0.0:
            values = values * source.scale + source.offset
        if bool((log_ns[1:] >= log_ns[:-1]).all()):
            return Columns(log_ns, stamp_ns, values, stamped)
        order = np.argsort(log_ns, kind="stable")
        return Columns(log_ns[order], stamp_ns[order], values[order], stamped[order])


@dataclass(frozen=True, slots=True)
class FieldPlan:
    """One mapped field of one channel and the row of the store that takes it."""

    row: int
    channel: int
    layout: Layout


class Walker:
    """Compiled walk over the records of one file.

    Parameters
    ----------
    fields : sequence of FieldPlan
        What is wanted; a row stands in it with all its channels or not at all.
    read : (R, 4) int64 array
        Messages read of this file and batches whose period cannot be, by row; grows.
    known : collection of int
        Channels that the file defines.
    """

    def __init__(
        self, fields: Sequence[FieldPlan], read: IntArray, known: Collection[int]
    ) -> None:
        from valve_twin.io.cdr import columns_kernel as kernel

        self._take, self._read = kernel.take, read
        self._flaw_bits = kernel.FLAW_BITS
        self._stated, self._late = np.zeros(kernel.STATED, dtype=np.int64), kernel.LATE
        self.flaw = Flaw.NONE
        self._rows = {f.row for f in fields}
        steps = max((len(f.layout.steps) for f in fields), default=0)
        plan = np.zeros((len(fields), kernel.FIRST_STEP + 4 * steps), dtype=np.int64)
        first = np.full(1 + max(known, default=0), kernel.UNDEFINED, dtype=np.int64)
        first[sorted(known)] = -1
        for k, field in enumerate(fields):
            layout = field.layout
            plan[k, kernel.ROW], plan[k, kernel.NEXT] = field.row, first[field.channel]
            plan[k, kernel.NUMBER], plan[k, kernel.SIZE] = layout.number, layout.size
            plan[k, kernel.BATCHED], plan[k, kernel.STEPS] = layout.batched, len(layout.steps)
            plan[k, kernel.FIRST_STEP : kernel.FIRST_STEP + layout.steps.size] = (
                layout.steps.ravel()
            )
            first[field.channel] = k
        self._plan, self._first = plan, first
        self._memory = np.full(
            (kernel.SLOTS * len(fields), kernel.MEMORY_SIZE), -1, dtype=np.int64
        )
        sizes = [f.layout.size if f.layout.batched else _SMALLEST_MESSAGE for f in fields]
        self._least = min(sizes, default=_SMALLEST_MESSAGE)

    def take(
        self,
        data: bytes | memoryview,
        store: ColumnStore,
        content: ByteArray | None = None,
        chunk: ChunkIndex | None = None,
    ) -> Collection[int]:
        """Append the samples of a chunk and compare it with what is stated of it, see `flaw`.

        Parameters
        ----------
        data : bytes
            Records.
        store : ColumnStore
            Takes the samples.
        content : (F,) uint8 array, optional
            The file.
        chunk : ChunkIndex, optional
            What the file states of these records; None = nothing.

        Returns
        -------
        collection of int
            Rows that are odd: of these, nothing was appended.
        """
        store.reserve(len(data) // self._least + 1)
        self._stated[self._late] = 0
        records = np.frombuffer(data, dtype=np.uint8)
        if content is None or chunk is None:
            content = records
            self._stated[0] = -1
        else:
            at = chunk.offset + chunk.length
            end, times = at + chunk.index_length, (chunk.start_ns, min(chunk.end_ns, _LAST_NS))
            _STATED.pack_into(self._stated.data, 0, at, end, *times)
        found = self._take(
            records,
            (content, self._stated),
            self._first,
            self._plan,
            self._memory,
            self._read,
            store.counts,
            store.times,
            store.values,
            store.stamped,
        )
        if not found:
            self.flaw = Flaw.NONE
            return _NO_ROWS
        self.flaw = Flaw(found & (1 << self._flaw_bits) - 1)
        if not found >> self._flaw_bits:
            return _NO_ROWS
        return set(np.flatnonzero(store.counts[:, _ODD]).tolist()) & self._rows

    def late_definitions(self, data: bytes | memoryview) -> list[bytes] | None:
        """Return the definitions behind messages of the chunk just taken, record heads included.

        Parameters
        ----------
        data : bytes
            Its records.

        Returns
        -------
        list of bytes or None
            None where there are more than are looked at, or messages that nothing defines.
        """
        count, *places = self._stated[self._late :].tolist()
        if count >= len(places):
            return None
        found = []
        for at in places[:count]:
            _, length = RECORD_HEAD.unpack_from(data, at)
            found.append(bytes(data[at : at + RECORD_HEAD.size + length]))
        return found


def pays(messages: int) -> bool:
    """Return whether the compiled walk is worth its import for so many messages (-1 = unknown)."""
    return messages < 0 or messages >= COMPILED_FROM or "numba" in sys.modules
