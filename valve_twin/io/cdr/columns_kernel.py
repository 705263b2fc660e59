# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled walk over the records of a chunk that writes the mapped fields into columns.

Importing this module imports numba: `columns` does so when there is enough to read. A message is
laid out step by step (`layout`); the words that decided the layout - lengths of strings and
sequences - are kept, and a message of the same size with the same words is read at the same
places. Every place is inside the message: what does not fit makes the row odd, which sends the
chunk to the general decoder.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import ir
from numba.extending import intrinsic

from valve_twin.io.cdr.layout import Number, Walk
from valve_twin.io.cdr.signals import LONGEST_BATCH_S
from valve_twin.io.mcap.format import Op
from valve_twin.io.mcap.index_check import ENTRY_SIZE, INDEX_HEAD, Flaw
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import ByteArray, FloatArray, IntArray

MAX_WORDS = 24
"""Lengths that are kept of a layout; a message with more is laid out anew each time."""

# columns of `plan`, one row a mapped field of a channel
ROW, NEXT, NUMBER, SIZE, BATCHED, STEPS, FIRST_STEP = 0, 1, 2, 3, 4, 5, 6
# columns of `memory`, `SLOTS` rows a mapped field of a channel; words follow as place, value
LENGTH, STAMP_AT, VALUE_AT, PERIOD_AT, COUNT, WORDS, FIRST_WORD = 0, 1, 2, 3, 4, 5, 6
MEMORY_SIZE = FIRST_WORD + 2 * MAX_WORDS
UNDEFINED, LATE, STATED = -2, 4, 40
SLOTS = 32
"""Layouts that are kept of a field, by the size of the message [1]."""

# columns of `counts` and `read`, one row a signal; BEFORE is what stood there before a chunk
SAMPLES, BEFORE, ODD = 0, 1, 2
MESSAGES, REJECTED, MESSAGES_BEFORE, REJECTED_BEFORE = 0, 1, 2, 3

types: Any = import_module("numba.types")  # untyped: its names are made on import

_UNKNOWN = _ABSENT = _TERMINATOR = -1
_MESSAGE, _INDEX = int(Op.MESSAGE), int(Op.MESSAGE_INDEX)
_SCHEMA, _CHANNEL = int(Op.SCHEMA), int(Op.CHANNEL)
_NONE, _TORN, _PLACES = int(Flaw.NONE), int(Flaw.TORN), int(Flaw.PLACES)
_COUNT, _TIMES, _LATE = int(Flaw.COUNT), int(Flaw.TIMES), int(Flaw.LATE)
FLAW_BITS = 8
"""Bits of what `take` returns that hold the flaw; the others count odd signals."""

_RECORD_HEAD = 9
_MESSAGE_HEAD = 22
_CHANNEL_AT, _LOG_AT = 9, 15
_CHANNEL_STEP = 0x1E3779B97F4A7C15
_ENCAPSULATION = 4
_SECOND_NS = 1_000_000_000

_STRING, _STRINGS = int(Walk.STRING), int(Walk.STRINGS)
_SEQUENCE, _STAMP, _VALUE = int(Walk.SEQUENCE), int(Walk.STAMP), int(Walk.VALUE)
_ITEM, _BATCH, _PERIOD = int(Walk.ITEM), int(Walk.BATCH), int(Walk.PERIOD)

_BYTES = types.Array(types.uint8, 1, "C", readonly=True)
_INTS, _INT_ROWS = types.int64[::1], types.int64[:, ::1]
_FLOAT_ROWS, _BYTE_ROWS = types.float64[:, ::1], types.uint8[:, ::1]


def _loader(kind: Any, word: Any) -> Callable[[ByteArray, int], Any]:  # noqa: ANN401
    """Return a function that reads a little-endian number at any byte, aligned or not."""

    def load(context: Any, data: Any, at: Any) -> Any:  # noqa: ANN401
        def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ANN401
            array = context.make_array(signature.args[0])(context, builder, args[0])
            place = builder.gep(array.data, [args[1]])
            value = builder.load(builder.bitcast(place, word.as_pointer()))
            value.align = 1
            return value

        return kind(data, types.int64), build

    found: Any = intrinsic(load)
    return found  # type: ignore[no-any-return]


_f64, _f32 = _loader(types.float64, ir.DoubleType()), _loader(types.float32, ir.FloatType())
_i64, _u64 = _loader(types.int64, ir.IntType(64)), _loader(types.uint64, ir.IntType(64))
_i32, _u32 = _loader(types.int32, ir.IntType(32)), _loader(types.uint32, ir.IntType(32))
_i16, _u16 = _loader(types.int16, ir.IntType(16)), _loader(types.uint16, ir.IntType(16))
_i8 = _loader(types.int8, ir.IntType(8))

_FLOAT64, _FLOAT32, _BOOL = int(Number.FLOAT64), int(Number.FLOAT32), int(Number.BOOL)
_INT8, _INT16, _INT32, _INT64 = (
    int(n) for n in (Number.INT8, Number.INT16, Number.INT32, Number.INT64)
)
_UINT16, _UINT32, _UINT64 = (int(n) for n in (Number.UINT16, Number.UINT32, Number.UINT64))


@njit
def _number(data: ByteArray, at: int, kind: int) -> float:  # noqa: PLR0911  one a kind
    """Return a number of any kind as float64."""
    if kind == _FLOAT64:
        return float(_f64(data, at))
    if kind == _FLOAT32:
        return float(_f32(data, at))
    if kind == _INT32:
        return float(_i32(data, at))
    if kind == _UINT32:
        return float(_u32(data, at))
    if kind == _INT16:
        return float(_i16(data, at))
    if kind == _UINT16:
        return float(_u16(data, at))
    if kind == _INT64:
        return float(_i64(data, at))
    if kind == _UINT64:
        return float(_u64(data, at))
    if kind == _INT8:
        return float(_i8(data, at))
    if kind == _BOOL:
        return 1.0 if data[at] != 0 else 0.0
    return float(data[at])


@njit
def _keep(memory: IntArray, m: int, place: int, value: int) -> None:
    """Keep a word that decided the layout."""
    count = memory[m, WORDS]
    if count < MAX_WORDS:
        memory[m, FIRST_WORD + 2 * count] = place
        memory[m, FIRST_WORD + 2 * count + 1] = value
    memory[m, WORDS] = count + 1


@njit
def _string(data: ByteArray, body: int, at: int, size: int, memory: IntArray, m: int) -> int:
    """Return the end of a string, -1 where it does not fit."""
    at = (at + 3) & -4
    if at + 4 > size:
        return _ABSENT
    length = int(_u32(data, body + at))
    end = at + 4 + length
    if length < 1 or end > size or data[body + end - 1] != 0:
        return _ABSENT
    _keep(memory, m, at, length)
    _keep(memory, m, end - 1, _TERMINATOR)
    return end


@njit
def _counted(
    data: ByteArray,
    body: int,
    at: int,
    size: int,
    plan: IntArray,
    k: int,
    s: int,
    memory: IntArray,
    m: int,
) -> int:
    """Return the end of a sequence, -1 where it does not fit; note where the value is in it."""
    step, alignment = plan[k, FIRST_STEP + 4 * s], plan[k, FIRST_STEP + 4 * s + 1]
    width, index = plan[k, FIRST_STEP + 4 * s + 2], plan[k, FIRST_STEP + 4 * s + 3]
    at = (at + 3) & -4
    if at + 4 > size:
        return _ABSENT
    count = int(_u32(data, body + at))
    if count > size:
        return _ABSENT
    _keep(memory, m, at, count)
    at += 4
    if step == _STRINGS:
        for _ in range(count):
            at = _string(data, body, at, size, memory, m)
            if at < 0:
                return _ABSENT
        return at
    if count > 0:
        at = (at + alignment - 1) & -alignment
    if step == _BATCH:
        memory[m, VALUE_AT] = at
        memory[m, COUNT] = count
    elif step == _ITEM and index < count:
        memory[m, VALUE_AT] = at + index * width
    end: int = at + count * width
    return end


@njit
def _lay_out(
    data: ByteArray, body: int, size: int, plan: IntArray, k: int, memory: IntArray, m: int
) -> bool:
    """Find the places of stamp, value and period; False where the bytes do not fit the type."""
    memory[m, LENGTH] = _UNKNOWN
    memory[m, STAMP_AT] = memory[m, VALUE_AT] = memory[m, PERIOD_AT] = _ABSENT
    memory[m, WORDS] = 0
    memory[m, COUNT] = 1
    at = 0
    for s in range(plan[k, STEPS]):
        step = plan[k, FIRST_STEP + 4 * s]
        if step == _STRING:
            at = _string(data, body, at, size, memory, m)
        elif step in (_STRINGS, _SEQUENCE, _ITEM, _BATCH):
            at = _counted(data, body, at, size, plan, k, s, memory, m)
        else:
            alignment = plan[k, FIRST_STEP + 4 * s + 1]
            at = (at + alignment - 1) & -alignment
            if step == _STAMP:
                memory[m, STAMP_AT] = at
            elif step == _VALUE:
                memory[m, VALUE_AT] = at
            elif step == _PERIOD:
                memory[m, PERIOD_AT] = at
            at += plan[k, FIRST_STEP + 4 * s + 2]
        if at < 0 or at > size:
            return False
    if at + 3 < size:
        return False
    if memory[m, WORDS] <= MAX_WORDS:
        memory[m, LENGTH] = size
    return True


@njit
def _times_flaw(data: ByteArray, start_ns: int, end_ns: int) -> int:
    """Return whether all messages of a chunk lie in a span of log time [ns]."""
    at, end = 0, len(data)
    while at + _RECORD_HEAD <= end:
        if data[at] == _MESSAGE and not start_ns <= _i64(data, at + _LOG_AT) <= end_ns:
            return _TIMES
        at += _RECORD_HEAD + _i64(data, at + 1)
    return _NONE


@njit
def _mixed(channel: int, log_ns: int, place: int) -> int:
    """Return a number, modulo 2^64, of which a sum over messages tells where one is another's.

    Both factors are odd: whichever of the three differs alone, so does their product.
    """
    return (2 * place + 1) * (2 * (log_ns + channel * _CHANNEL_STEP) + 1)


@njit
def _index_flaw(
    data: ByteArray, messages: int, found: int, content: ByteArray, stated: IntArray
) -> int:
    """Compare a chunk with what the file states of it."""
    at, end, start_ns, end_ns = stated[0], stated[1], stated[2], stated[3]
    if at == end:
        return _times_flaw(data, start_ns, end_ns)
    entries, sum_, outside, last = 0, 0, False, len(data) - _RECORD_HEAD - _MESSAGE_HEAD
    while at < end:
        if at + INDEX_HEAD > end or content[at] != _INDEX:
            return _PLACES
        size = int(_u32(content, at + 11))
        channel, begin = np.int64(_u16(content, at + _CHANNEL_AT)), at + INDEX_HEAD
        if _i64(content, at + 1) != size + 6 or begin + size > end or size % ENTRY_SIZE != 0:
            return _PLACES
        # the first and the last in full, of all others what they add up to
        for entry in (begin, begin + size - ENTRY_SIZE):
            if size == 0:
                break
            log_ns, place = _i64(content, entry), _i64(content, entry + 8)
            if place < 0 or place > last or data[place] != _MESSAGE:
                return _PLACES
            if _u16(data, place + _CHANNEL_AT) != channel or _i64(data, place + _LOG_AT) != log_ns:
                return _PLACES
            outside = outside or log_ns < start_ns or log_ns > end_ns
        for entry in range(begin, begin + size, ENTRY_SIZE):
            sum_ += _mixed(int(channel), _i64(content, entry), _i64(content, entry + 8))
        entries += size // ENTRY_SIZE
        at = begin + size
    if entries != messages:
        return _COUNT
    if sum_ != found:
        return _PLACES
    return _TIMES if outside else _NONE


@njit(
    types.int64(
        _BYTES,
        types.Tuple((_BYTES, _INTS)),
        _INTS,
        _INT_ROWS,
        _INT_ROWS,
        _INT_ROWS,
        _INT_ROWS,
        _INT_ROWS,
        _FLOAT_ROWS,
        _BYTE_ROWS,
    ),
    cache=True,
)
def take(  # noqa: PLR0912, PLR0915  to hand arrays on to a call costs more than a message
    data: ByteArray,
    about: tuple[ByteArray, IntArray],
    first_of: IntArray,
    plan: IntArray,
    memory: IntArray,
    read: IntArray,
    counts: IntArray,
    times: IntArray,
    values: FloatArray,
    stamped: ByteArray,
) -> int:
    """Append the samples of a chunk to the columns.

    Parameters
    ----------
    data : (B,) uint8 array
        Records, one after another.
    about : (F,) uint8 array, (`STATED`,) int64 array
        The file, and what it states of the records: begin and end of their message indexes in it
        [B], first and last log time [ns]; begin -1 = nothing. From `LATE` on, filled: how many
        definitions stand behind messages, more than there is room for = look; where [B].
    first_of : (C,) int64 array
        By channel, the first of its fields, -1 = none, `UNDEFINED` = nothing defines it.
    plan : (K, .) int64 array
        What is wanted of each field.
    memory : (SLOTS K, .) int64 array
        Layouts of the messages before.
    read : (R, 4) int64 array
        By signal, messages read of this file and batches whose period cannot be; grows.
    counts : (R, 3) int64 array
        By signal, samples, and whether the chunk is odd; grows, except for what is odd.
    times : (2 R, N) int64 array
        By signal, log times and stamps [ns].
    values : (R, N) array
        Values as they stand in the messages [any].
    stamped : (R, N) uint8 array
        Whether the stamp comes from the message.

    Returns
    -------
    int
        Signals that only the general decoder can read in these records, above `FLAW_BITS` that
        hold the `Flaw` of the chunk.
    """
    for k in range(len(plan)):
        row = plan[k, ROW]
        counts[row, BEFORE], counts[row, ODD] = counts[row, SAMPLES], 0
        read[row, MESSAGES_BEFORE] = read[row, MESSAGES]
        read[row, REJECTED_BEFORE] = read[row, REJECTED]
    odd, at, end, messages, sum_, stated = 0, 0, len(data), 0, 0, about[1]
    while at + _RECORD_HEAD <= end:
        length = _i64(data, at + 1)
        if length < 0 or length > end - at - _RECORD_HEAD:
            break
        following = at + _RECORD_HEAD + length
        if data[at] != _MESSAGE:
            if messages > 0 and (data[at] == _SCHEMA or data[at] == _CHANNEL):
                stated[LATE] += 1
                stated[min(LATE + stated[LATE], STATED - 1)] = at
            at = following
            continue
        if length < _MESSAGE_HEAD:
            for k in range(len(plan)):
                counts[plan[k, ROW], ODD] = 1
            odd = len(plan)
            break
        messages += 1
        channel = np.int64(_u16(data, at + _CHANNEL_AT))
        sum_ += _mixed(int(channel), _i64(data, at + _LOG_AT), at)
        k = first_of[channel] if channel < len(first_of) else UNDEFINED
        stated[LATE] += STATED * (k == UNDEFINED)
        while k >= 0:
            row = plan[k, ROW]
            if counts[row, ODD] != 0:
                k = plan[k, NEXT]
                continue
            log_ns = _i64(data, at + _LOG_AT)
            body = at + _RECORD_HEAD + _MESSAGE_HEAD + _ENCAPSULATION
            size = following - body
            m = k * SLOTS + (size >> 2 & (SLOTS - 1))
            fits = size >= 0 and log_ns >= 0 and data[body - 4] == 0 and data[body - 3] == 1
            if fits:
                alike = memory[m, LENGTH] == size
                if alike:
                    for w in range(memory[m, WORDS]):
                        place = body + memory[m, FIRST_WORD + 2 * w]
                        value = memory[m, FIRST_WORD + 2 * w + 1]
                        if value == _TERMINATOR:
                            alike = alike and data[place] == 0
                        else:
                            alike = alike and np.int64(_u32(data, place)) == value
                fits = alike or _lay_out(data, body, size, plan, k, memory, m)
            begin_ns, is_stamped = log_ns, 0
            if fits and memory[m, STAMP_AT] >= 0:
                place = body + memory[m, STAMP_AT]
                stamp_ns = np.int64(_i32(data, place)) * _SECOND_NS + np.int64(
                    _u32(data, place + 4)
                )
                if stamp_ns != 0:
                    begin_ns, is_stamped = stamp_ns, 1
            count, period_ns = memory[m, COUNT], 0.0
            if fits and plan[k, BATCHED] and count > 1:
                period = _f64(data, body + memory[m, PERIOD_AT])
                period_ns = period * 1e9
                if not (period > 0.0 and count * period < LONGEST_BATCH_S):
                    read[plan[k, ROW], REJECTED] += 1
                    count = 0
            if not fits:
                counts[row, ODD] = 1
                odd += 1
                k = plan[k, NEXT]
                continue
            n, kind, width = counts[row, SAMPLES], plan[k, NUMBER], plan[k, SIZE]
            place = body + memory[m, VALUE_AT]
            is_there = memory[m, VALUE_AT] >= 0
            counts[row, SAMPLES] = n + count
            read[row, MESSAGES] += 1
            k = plan[k, NEXT]
            if count == 1:
                times[2 * row, n] = log_ns
                times[2 * row + 1, n] = begin_ns
                stamped[row, n] = is_stamped
                if is_there and kind == _FLOAT64:
                    values[row, n] = _f64(data, place)
                else:
                    values[row, n] = _number(data, place, kind) if is_there else np.nan
                continue
            for i in range(count):
                times[2 * row, n + i] = log_ns
                times[2 * row + 1, n + i] = begin_ns + np.int64(np.rint(i * period_ns))
                stamped[row, n + i] = is_stamped
                if kind == _FLOAT64:
                    values[row, n + i] = _f64(data, place + 8 * i)
                else:
                    values[row, n + i] = _number(data, place + i * width, kind)
        at = following
    if odd > 0:
        for k in range(len(plan)):
            row = plan[k, ROW]
            if counts[row, ODD] != 0:
                counts[row, SAMPLES] = counts[row, BEFORE]
                read[row, MESSAGES] = read[row, MESSAGES_BEFORE]
                read[row, REJECTED] = read[row, REJECTED_BEFORE]
    if stated[0] < 0:
        return odd << FLAW_BITS
    flaw = _index_flaw(data, messages, sum_, about[0], stated) if at == end else _TORN
    flaw = _LATE if stated[LATE] > 0 and flaw == _NONE else flaw
    return odd << FLAW_BITS | flaw
