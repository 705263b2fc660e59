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
    struct.error,
)

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
                f"{where}: the bag holds no readable definition of {schema.name}; record the "
                "topic anew"
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
    store = get_typestore(Stores.EMPTY)
    store.register(_READERS[encoding](data.decode(errors="replace"), name))
    store.fielddefs[name]
    return store


def _field(node: Message) -> FieldType:
    kind, detail = node
    if kind == Nodetype.BASE:
        return FieldType(str(detail[0]))
    if kind == Nodetype.NAME:
        return FieldType(str(detail))
    inner, size = detail
    base = _field(inner).base
    return FieldType(base, is_array=True, size=int(size) if kind == Nodetype.ARRAY else None)
