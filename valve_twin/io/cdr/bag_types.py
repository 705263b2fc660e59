# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Message types as a bag defines them: never those that happen to be installed."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from valve_twin.io.cdr.message_types import FieldType, Message, known_type_name
from valve_twin.io.errors import BagError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from mcap.records import Schema
    from rosbags.interfaces.typing import Typesdict
    from rosbags.typesys.store import Typestore

_UNDECODABLE = (
    SerdeError,
    AssertionError,
    IndexError,
    KeyError,
    ValueError,
    TypeError,
    OverflowError,
    MemoryError,
    RecursionError,
    struct.error,
)

_MAX_DEFINITION = 1 << 20
_MAX_NESTED = 40
_MAX_MESSAGES, _MAX_NUMBERS = 1 << 16, 1 << 26
"""Messages within one another and numbers that one message may hold for sure [1]."""

_READERS: Mapping[str, Callable[[str, str], Typesdict]] = {
    "ros2msg": get_types_from_msg,
    "ros2idl": lambda text, _: get_types_from_idl(text),
}


class BagTypes:
    """The types of one schema of a bag.

    Parameters
    ----------
    schema : Schema
        With its definition, "ros2msg" or "ros2idl".
    where : str
        File and topic for error messages.

    Raises
    ------
    BagError
        If there is no definition or it cannot be read.
    """

    def __init__(self, schema: Schema, where: str) -> None:
        self.where = where
        self.name = known_type_name(schema.name)
        if schema.encoding not in _READERS:
            msg = (
                f"{where}: the definition of {schema.name} is of kind "
                f"'{schema.encoding}', not ros2msg or ros2idl; "
                "record the topic anew with ROS 2 Jazzy"
            )
            raise BagError(msg)
        try:
            self._store = _parsed(self.name, schema.encoding, schema.data)
        except Exception as err:  # the parser of rosbags raises what its grammar meets
            msg = (
                f"{where}: the bag holds no readable definition of {schema.name} "
                f"({_line_of(err)}); record the topic anew"
            )
            raise BagError(msg) from err

    def fields(self, type_name: str) -> Mapping[str, FieldType]:
        """Return the fields of a type; KeyError if the bag does not define it."""
        return {name: _field(node) for name, node in self._store.fielddefs[type_name][1]}

    def decode(self, data: bytes, log_ns: int) -> Message:
        """Return a message.

        Raises
        ------
        BagError
            If the bytes do not fit the definition.
        """
        try:
            return self._store.deserialize_cdr(data, self.name)
        except _UNDECODABLE as err:
            msg = (
                f"{self.where}: the message at log time {log_ns} ns is no valid {self.name}; "
                "rewrite the bag with 'valve-twin recover'"
            )
            raise BagError(msg) from err


@lru_cache(maxsize=64)
def _parsed(name: str, encoding: str, data: bytes) -> Typestore:
    """Return the types of a definition; the parser takes longer than a thousand messages."""
    if len(data) > _MAX_DEFINITION:
        msg = f"the definition is longer than {_MAX_DEFINITION} bytes"
        raise ValueError(msg)
    store = get_typestore(Stores.EMPTY)
    store.register(_READERS[encoding](data.decode(errors="replace"), name))
    store.fielddefs[name]
    _expanded(store, name, (), {})
    return store


def _expanded(
    store: Typestore, name: str, around: tuple[str, ...], known: dict[str, tuple[int, int]]
) -> tuple[int, int]:
    """Return how many messages and numbers one message of a type holds for sure.

    Raises
    ------
    ValueError
        If it holds itself, or more than any sensor sends.
    """
    if name in around or len(around) > _MAX_NESTED:
        msg = f"type {name} holds itself, or is nested deeper than {_MAX_NESTED} types"
        raise ValueError(msg)
    if name in known:
        return known[name]
    messages = numbers = 1
    for _, node in store.fielddefs[name][1]:
        found = _field(node)
        times = (found.size or 1) if found.is_array else 1
        inner = (0, 1)
        if found.base in store.fielddefs:
            inner = _expanded(store, found.base, (*around, name), known)
        messages, numbers = messages + times * inner[0], numbers + times * inner[1]
        if messages > _MAX_MESSAGES or numbers > _MAX_NUMBERS:
            msg = f"a message of type {name} holds more than {_MAX_NUMBERS} values"
            raise ValueError(msg)
    known[name] = messages, numbers
    return known[name]


def _line_of(err: Exception) -> str:
    """Return the first words of an error of the parser."""
    return " ".join(str(err).split())[:120] or type(err).__name__


def _field(node: Message) -> FieldType:
    kind, detail = node
    if kind == Nodetype.BASE:
        return FieldType(str(detail[0]))
    if kind == Nodetype.NAME:
        return FieldType(str(detail))
    inner, size = detail
    base = _field(inner).base
    return FieldType(base, is_array=True, size=int(size) if kind == Nodetype.ARRAY else None)
