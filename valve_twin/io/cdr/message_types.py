# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Message types: their names, which fields they have, and those that are installed."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping

Message: TypeAlias = Any
"""A message of rclpy or of a bag, or a value in it: generated classes have no common base."""


@dataclass(frozen=True, slots=True)
class FieldType:
    """Type of one field: `base` is a number or full message type; sequences are arrays, too."""

    base: str
    is_array: bool = False
    size: int | None = None


class TypeSystem(Protocol):
    """Says which fields a message type has."""

    def fields(self, type_name: str) -> Mapping[str, FieldType]:
        """Return the fields of a full message type name; KeyError if it is unknown."""
        ...


def full_type_name(name: str) -> str:
    """Return `pkg/msg/Name` of either `pkg/msg/Name` or `pkg/Name`.

    Raises
    ------
    ValueError
        If it is no name of a message type.
    """
    parts = name.strip().split("/")
    if len(parts) in {2, 3} and all(re.fullmatch(r"[A-Za-z]\w*", p) for p in parts):
        return name.strip() if len(parts) == 3 else f"{parts[0]}/msg/{parts[1]}"
    msg = (
        f"'{name}' is no message type; write it as package/msg/Name, for example "
        "valve_twin_msgs/msg/Float64Stamped"
    )
    raise ValueError(msg)


def known_type_name(name: str) -> str:
    """Return the full name of a type, or what stands in the bag where that is no name."""
    try:
        return full_type_name(name)
    except ValueError:
        return name


class RosTypes:
    """Type system of the installed rclpy message classes."""

    def fields(self, type_name: str) -> Mapping[str, FieldType]:
        """Return the fields of an installed message type; KeyError if it is not installed."""
        found = message_class(type_name)
        names = found.get_fields_and_field_types()
        return dict(zip(names, map(_ros_field, found.SLOT_TYPES), strict=True))


def message_class(type_name: str) -> Message:
    """Return the rclpy class of a full message type name; KeyError if it is not installed."""
    from importlib import import_module

    package, kind, name = type_name.split("/")
    try:
        return getattr(import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError) as err:
        raise KeyError(type_name) from err


def _ros_field(kind: Message) -> FieldType:
    """Return the type of a field as rosidl describes it."""
    from rosidl_parser import definition as idl

    is_array = isinstance(kind, idl.AbstractNestedType)
    inner = kind.value_type if is_array else kind
    if isinstance(inner, idl.NamespacedType):
        base = "/".join(inner.namespaced_name())
    elif isinstance(inner, idl.BasicType):
        base = inner.typename
    else:
        base = "wstring" if isinstance(inner, idl.AbstractWString) else "string"
    return FieldType(base, is_array, kind.size if isinstance(kind, idl.Array) else None)
