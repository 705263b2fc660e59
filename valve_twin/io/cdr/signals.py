# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Take signals out of messages of any type: one mapping for live topics, bags and CSV columns.

A field path is checked against the message type when a connection is set up and compiled to a
getter; in the data path nothing raises: a value that is missing or no number becomes NaN.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.core.quantity import suggest
from valve_twin.io.cdr.codec import decode_series, decode_stamped
from valve_twin.io.cdr.run import decode_stamped_run
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.io.cdr.message_types import FieldType, Message, TypeSystem

STAMPED_TYPE = "valve_twin_msgs/msg/Float64Stamped"
SERIES_TYPE = "valve_twin_msgs/msg/Float64Series"

LONGEST_BATCH_S = 1e9
"""Time that a batch spans at most [s]: thirty years are no period but a damaged number."""

_TIME = "builtin_interfaces/msg/Time"
_HEADER = "std_msgs/msg/Header"
_NUMBERS = {
    "bool", "boolean", "byte", "octet", "char",
    "float", "double", "float32", "float64", "long double",
    "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class SignalSource:
    """Where a signal comes from.

    Attributes
    ----------
    signal : str
        Name of the signal.
    topic, type, field : str
        Topic, full message type and field path, such as "position[2]", "pose.position.x" or
        "values[]".
    scale, offset : float
        The signal is scale * field + offset.
    lower, upper : float
        Values outside are not believed.
    column : str
        Name or number of the column in a CSV file.
    """

    signal: str
    topic: str
    type: str = STAMPED_TYPE
    field: str = "value"
    scale: float = 1.0
    offset: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    column: str = ""

    @property
    def batched(self) -> bool:
        """Whether one message carries many samples."""
        return self.field.endswith("[]")


@dataclass(frozen=True, slots=True)
class SignalBlock:
    """Consecutive samples of one signal.

    Attributes
    ----------
    signal : str
        Name of the signal.
    stamp_ns : (N,) int64 array
        Acquisition time, else receive time [ns].
    values : (N,) array
        Values in the unit of the signal; NaN = no value.
    has_header : bool
        Whether all stamps come from the messages.
    log_ns : (N,) int64 array, optional
        When each sample was recorded, not decreasing [ns]; None = not known.
    """

    signal: str
    stamp_ns: IntArray
    values: FloatArray
    has_header: bool
    log_ns: IntArray | None = None


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a field path.

    Attributes
    ----------
    name : str
        Attribute.
    index : int, optional
        Element, -1 = the whole batch, None = no array.
    """

    name: str
    index: int | None = None


_BATCH = -1


class Extractor:
    """Compiled way from a message to samples of one signal.

    Parameters
    ----------
    source : SignalSource
        What is wanted.
    types : TypeSystem
        What the message type looks like.
    where : str
        File or node for error messages.

    Raises
    ------
    ConfigError
        If the type is unknown, or the field is none of the type or holds no number; names the
        nearest valid one.
    """

    def __init__(self, source: SignalSource, types: TypeSystem, where: str) -> None:
        self.source = source
        self._scaled = source.scale != 1.0 or source.offset != 0.0
        steps = _check_path(source, types, where)
        self._get = _compile(steps)
        self._stamp = _stamp_getter(source, types)
        self._period = _period_getter(source, steps, types, where) if source.batched else None
        self.rejected = 0

    @property
    def has_header(self) -> bool:
        """Whether the message type carries a stamp."""
        return self._stamp is not None

    @property
    def is_raw_readable(self) -> bool:
        """Whether `from_raw` reads this source without the message class."""
        source = self.source
        return (source.type, source.field) in {(STAMPED_TYPE, "value"), (SERIES_TYPE, "values[]")}

    def __call__(self, message: Message, receive_ns: int) -> SignalBlock:
        """Return the samples of a message.

        Parameters
        ----------
        message : message
            Of rclpy or decoded from a bag.
        receive_ns : int
            Receive time, taken where the message carries no stamp or stamp 0 [ns].

        Returns
        -------
        SignalBlock
            One sample, or those of the batch; empty where the period of a batch cannot be.
        """
        stamp = self._stamp(message) if self._stamp is not None else 0
        if self._period is None:
            value = np.array([_to_float(self._get(message))])
            return self._block(stamp, 0.0, value, receive_ns)
        values = np.asarray(self._get(message), dtype=np.float64)
        return self._block(stamp, _to_float(self._period(message)), values, receive_ns)

    def from_raw(self, data: bytes, receive_ns: int) -> SignalBlock:
        """Return the samples of serialized bytes of our own types; the same as of the message.

        Raises
        ------
        ValueError
            If the bytes are too short for the type.
        """
        if self._period is None:
            stamp, value = decode_stamped(data)
            return self._block(stamp, 0.0, np.array([value]), receive_ns)
        stamp, period, values = decode_series(data)
        return self._block(stamp, period, values, receive_ns)

    def from_run(self, messages: Sequence[bytes], receive_ns: Sequence[int]) -> SignalBlock | None:
        """Return the samples of many serialized Float64Stamped; the same as one by one.

        Parameters
        ----------
        messages : sequence of bytes
            N serialized messages, N >= 1.
        receive_ns : sequence of int
            Their receive times [ns].

        Returns
        -------
        SignalBlock or None
            None where they have to be read one by one.
        """
        found = decode_stamped_run(messages) if self._period is None else None
        if found is None:
            return None
        stamps, values = found
        if self._scaled:
            values = values * self.source.scale + self.source.offset
        stamped = bool(stamps.all())
        if not stamped:
            stamps = np.where(stamps == 0, np.array(receive_ns, dtype=np.int64), stamps)
        return SignalBlock(self.source.signal, stamps, values, stamped)

    def _block(
        self, stamp: int, period: float, values: FloatArray, receive_ns: int
    ) -> SignalBlock:
        stamped = stamp != 0
        begin = stamp if stamped else receive_ns
        if self._scaled:
            values = values * self.source.scale + self.source.offset
        n = len(values)
        if n == 1:
            return SignalBlock(
                self.source.signal, np.array([begin], dtype=np.int64), values, stamped
            )
        if not (period > 0.0 and n * period < LONGEST_BATCH_S):
            self.rejected += n > 0
            n, values = 0, values[:0]
        return SignalBlock(self.source.signal, batch_stamps(begin, period, n), values, stamped)


def batch_stamps(begin_ns: int, period_s: float, count: int) -> IntArray:
    """Return the stamps of a batch: each rounded by itself, so that no error adds up.

    Parameters
    ----------
    begin_ns : int
        Stamp of the first sample [ns].
    period_s : float
        Time between two samples [s].
    count : int
        Samples [1].


    Returns
    -------
    (N,) int64 array
        begin + round(i * period) [ns].
    """
    if count == 0:
        return np.empty(0, dtype=np.int64)
    stamps: IntArray = np.rint(np.arange(count) * (period_s * 1e9)).astype(np.int64) + begin_ns
    return stamps


def _to_float(value: Message) -> float:
    return math.nan if value is None else float(value)


def parse_path(path: str) -> tuple[Step, ...]:
    """Split a field path into steps.

    Raises
    ------
    ValueError
        If the path cannot be read.
    """
    steps = []
    for part in path.split("."):
        found = re.fullmatch(r"([A-Za-z]\w*)(?:\[(\d*)\])?", part)
        if not found:
            msg = (
                f"'{path}' is no field path; write for example value, position[2], "
                "pose.position.x or values[]"
            )
            raise ValueError(msg)
        index = found.group(2)
        steps.append(
            Step(found.group(1), None if index is None else int(index) if index else _BATCH)
        )
    if any(s.index == _BATCH for s in steps[:-1]):
        msg = f"'{path}' has [] before its end; write [] only after the last field"
        raise ValueError(msg)
    return tuple(steps)


def _check_path(source: SignalSource, types: TypeSystem, where: str) -> tuple[Step, ...]:
    """Walk the type along the path; name the step that does not fit."""
    place = f"{where}: signal '{source.signal}', topic '{source.topic}'"
    try:
        steps = parse_path(source.field)
    except ValueError as err:
        msg = f"{place}: field {err}"
        raise ConfigError(msg) from None
    current = source.type
    for i, step in enumerate(steps):
        fields = _fields(types, current, place)
        if step.name not in fields:
            msg = (
                f"{place}: type {current} has no field '{step.name}'; {suggest(step.name, fields)}"
            )
            raise ConfigError(msg)
        found = fields[step.name]
        _check_index(step, found, f"{place}: field '{source.field}' of {current}")
        current, last = found.base, i == len(steps) - 1
        if last and current not in _NUMBERS:
            below = fields_of(types, current)
            more = (
                f"; {suggest('', [f'{source.field}.{f}' for f in below])}"
                if below
                else "; name a numeric field"
            )
            msg = f"{place}: field '{source.field}' is of type {current}, not a number{more}"
            raise ConfigError(msg)
        if not last and current in _NUMBERS | {"string", "wstring"}:
            msg = (
                f"{place}: field '{step.name}' of {source.type} is a plain {current}; end the "
                "path there"
            )
            raise ConfigError(msg)
    return steps


def _fields(types: TypeSystem, name: str, place: str) -> Mapping[str, FieldType]:
    try:
        return types.fields(name)
    except KeyError:
        msg = (
            f"{place}: message type {name} is unknown; install its package or correct the key "
            "'type'"
        )
        raise ConfigError(msg) from None


def fields_of(types: TypeSystem, name: str) -> Mapping[str, FieldType]:
    """Return the fields of a type, none where it is unknown."""
    try:
        return types.fields(name)
    except KeyError:
        return {}


def _check_index(step: Step, found: FieldType, place: str) -> None:
    if found.is_array and step.index is None:
        msg = f"{place} is an array; write {step.name}[0] for one element"
        raise ConfigError(msg)
    if not found.is_array and step.index is not None:
        msg = f"{place} is no array; write {step.name} without brackets"
        raise ConfigError(msg)
    if found.size is not None and step.index is not None and step.index >= found.size:
        msg = f"{place} has {found.size} elements; write an index from 0 to {found.size - 1}"
        raise ConfigError(msg)


def _compile(steps: tuple[Step, ...]) -> Callable[[Any], Any]:
    """Return a getter; None where an index lies beyond the end of a sequence."""
    if all(s.index is None or s.index == _BATCH for s in steps):
        return attrgetter(".".join(s.name for s in steps))

    def get(message: Message) -> Message:
        for step in steps:
            message = getattr(message, step.name)
            if step.index is not None:
                if step.index >= len(message):
                    return None
                message = message[step.index]
        return message

    return get


def stamp_path(source: SignalSource, types: TypeSystem) -> str:
    """Return where the stamp is: a std_msgs header, a field `stamp` of the message, or nowhere."""
    fields = fields_of(types, source.type)
    if "header" in fields and fields["header"].base == _HEADER:
        return "header.stamp"
    if "stamp" in fields and fields["stamp"].base == _TIME:
        return "stamp"
    return ""


def _stamp_getter(source: SignalSource, types: TypeSystem) -> Callable[[Any], int] | None:
    path = stamp_path(source, types)
    if not path:
        return None
    get = attrgetter(path)

    def stamp_ns(message: Message) -> int:
        stamp = get(message)
        return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)

    return stamp_ns


def _period_getter(
    source: SignalSource, steps: tuple[Step, ...], types: TypeSystem, where: str
) -> Callable[[Any], Any]:
    current = source.type
    for step in steps[:-1]:
        current = types.fields(current)[step.name].base
    if "period" not in types.fields(current):
        msg = (
            f"{where}: signal '{source.signal}', topic '{source.topic}': {current} has no "
            "field 'period' beside "
            f"'{steps[-1].name}', so the samples of a batch have no time; publish {SERIES_TYPE}"
        )
        raise ConfigError(msg)
    return _compile((*steps[:-1], Step("period")))
