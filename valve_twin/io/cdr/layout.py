# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where a mapped field lies in a CDR message: a message type as a short list of steps.

CDR has no offsets: a string or a sequence moves everything behind it. The steps skip over what is
not wanted and stop at the stamp, the value and the period; `columns_kernel` walks them over every
message. Alignment is worked out here as far as it is known before a message is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.cdr.message_types import FieldType, TypeSystem
from valve_twin.io.cdr.signals import SignalSource, parse_path, stamp_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import IntArray
    from valve_twin.io.cdr.signals import Step

MAX_STEPS = 48
"""Most steps of a layout; a type that needs more goes to the general decoder."""


class Walk(IntEnum):
    """Steps over a message; each has an alignment, a size and an index."""

    SKIP = 0
    STRING = 1
    STRINGS = 2
    SEQUENCE = 3
    STAMP = 4
    VALUE = 5
    ITEM = 6
    BATCH = 7
    PERIOD = 8


class Number(IntEnum):
    """Kinds of numbers, as rosbags reads them."""

    FLOAT64 = 0
    FLOAT32 = 1
    INT8 = 2
    UINT8 = 3
    INT16 = 4
    UINT16 = 5
    INT32 = 6
    UINT32 = 7
    INT64 = 8
    UINT64 = 9
    BOOL = 10


_NUMBERS = {
    "float64": (Number.FLOAT64, 8),
    "float32": (Number.FLOAT32, 4),
    "int8": (Number.INT8, 1),
    "byte": (Number.INT8, 1),
    "uint8": (Number.UINT8, 1),
    "char": (Number.UINT8, 1),
    "int16": (Number.INT16, 2),
    "uint16": (Number.UINT16, 2),
    "int32": (Number.INT32, 4),
    "uint32": (Number.UINT32, 4),
    "int64": (Number.INT64, 8),
    "uint64": (Number.UINT64, 8),
    "bool": (Number.BOOL, 1),
}
_WORD = 4
_TIME = {"sec": FieldType("int32"), "nanosec": FieldType("uint32")}
_MAX_UNROLLED = 16


@dataclass(frozen=True, slots=True)
class Layout:
    """How to find one signal in a message.

    Attributes
    ----------
    steps : (S, 4) int64 array
        `Walk` step, alignment [B], size [B], index [1].
    number : Number
        Kind of the value.
    size : int
        Bytes of one value [B].
    batched : bool
        Whether a message carries many values.
    """

    steps: IntArray
    number: Number
    size: int
    batched: bool


class _UnknownLayoutError(Exception):
    """The type is left to the general decoder."""


def layout_of(source: SignalSource, types: TypeSystem) -> Layout | None:
    """Return where the field of a source lies.

    Parameters
    ----------
    source : SignalSource
        Its type and field are known to exist.
    types : TypeSystem
        What the message type looks like.

    Returns
    -------
    Layout or None
        None for what only the general decoder reads: a sequence of messages, a batch of fixed
        size, a period that is no float64.
    """
    builder = _Builder(types, batched=source.batched)
    stamp = stamp_path(source, types)
    try:
        builder.message(source.type, parse_path(source.field), stamp.split(".") if stamp else ())
    except (_UnknownLayoutError, KeyError):
        return None
    if builder.number is None or len(builder.steps) > MAX_STEPS:
        return None
    steps = np.array(builder.steps, dtype=np.int64)
    return Layout(steps, builder.number, builder.size, source.batched)


@dataclass(slots=True)
class _Builder:
    """Collects steps; the place is known to be `offset` modulo `modulus` from the body on."""

    types: TypeSystem
    batched: bool
    steps: list[tuple[int, int, int, int]] = field(default_factory=list)
    number: Number | None = None
    size: int = 0
    modulus: int = 8
    offset: int = 0

    def message(self, name: str, path: Sequence[Step], stamp: Sequence[str]) -> None:
        """Add the fields of a message; `path` leads to the value, `stamp` to the stamp."""
        fields = self.types.fields(name)
        if not fields:
            raise _UnknownLayoutError
        for key, kind in fields.items():
            here = path if path and path[0].name == key else ()
            if stamp and stamp[0] == key and len(stamp) == 1:
                self._stamp(kind, here)
            elif key == "period" and self.batched and len(path) == 1:
                self._period(kind)
            elif kind.base in _NUMBERS:
                self._numbers(kind, here)
            elif kind.base == "string":
                self._strings(kind)
            else:
                self._messages(kind, here, stamp[1:] if stamp and stamp[0] == key else ())

    def _stamp(self, kind: FieldType, path: Sequence[Step]) -> None:
        if path or kind.is_array or dict(self.types.fields(kind.base)) != _TIME:
            raise _UnknownLayoutError
        self._align(_WORD)
        self._add(Walk.STAMP, size=2 * _WORD)

    def _period(self, kind: FieldType) -> None:
        if kind != FieldType("float64"):
            raise _UnknownLayoutError
        self._align(8)
        self._add(Walk.PERIOD, size=8)

    def _numbers(self, kind: FieldType, path: Sequence[Step]) -> None:
        number, size = _NUMBERS[kind.base]
        index = path[0].index if path else None
        if path:
            self.number, self.size = number, size
        if kind.is_array and kind.size is None:
            step = Walk.SEQUENCE if not path else Walk.BATCH if self.batched else Walk.ITEM
            self.steps.append((step, size, size, index or 0))
            self.modulus, self.offset = min(_WORD, size), 0
            return
        if path and self.batched:
            raise _UnknownLayoutError
        count, at = kind.size or 1, index or 0
        self._align(size)
        if path:
            self._skip(at * size)
            self._add(Walk.VALUE, size=size)
            self._skip((count - at - 1) * size)
        else:
            self._skip(count * size)

    def _strings(self, kind: FieldType) -> None:
        for _ in range(_unrolled(kind)):
            self.steps.append((Walk.STRING, _WORD, 0, 0))
        if kind.is_array and kind.size is None:
            self.steps.append((Walk.STRINGS, _WORD, 0, 0))
        self.modulus, self.offset = 1, 0

    def _messages(self, kind: FieldType, path: Sequence[Step], stamp: Sequence[str]) -> None:
        if kind.is_array and kind.size is None:
            raise _UnknownLayoutError
        wanted = (path[0].index or 0) if path else -1
        for i in range(_unrolled(kind)):
            self.message(kind.base, path[1:] if i == wanted else (), stamp)

    def _align(self, size: int) -> None:
        if size > self.modulus:
            self.steps.append((Walk.SKIP, size, 0, 0))
            self.modulus, self.offset = size, 0
        self._skip(-self.offset % size)

    def _skip(self, size: int) -> None:
        if size and self.steps and self.steps[-1][0] == Walk.SKIP:
            _, alignment, before, _ = self.steps.pop()
            self.steps.append((Walk.SKIP, alignment, before + size, 0))
        elif size:
            self.steps.append((Walk.SKIP, 1, size, 0))
        self.offset = (self.offset + size) % self.modulus

    def _add(self, step: Walk, *, size: int) -> None:
        self.steps.append((step, 1, size, 0))
        self.offset = (self.offset + size) % self.modulus


def _unrolled(kind: FieldType) -> int:
    """Return how often the element of a field stands in a message, 0 = not known before."""
    count = (kind.size or 0) if kind.is_array else 1
    if count > _MAX_UNROLLED:
        raise _UnknownLayoutError
    return count
