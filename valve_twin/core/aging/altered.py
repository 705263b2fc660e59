# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Copies of results with some fields changed, in less time than by `dataclasses.replace`."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from dataclasses import replace as altered  # whose arguments are checked

else:

    def altered(of: object, /, **changes: object) -> object:
        """Return a copy of a dataclass that is made of all its fields, with some changed."""
        read, place = _fields_of(type(of))
        values = list(read(of))
        for name, value in changes.items():
            values[place[name]] = value
        return type(of)(*values)


__all__ = ["altered"]


@cache
def _fields_of(kind: type) -> tuple[Callable[[object], tuple[object, ...]], dict[str, int]]:
    names = [field.name for field in fields(kind)]
    return attrgetter(*names), {name: place for place, name in enumerate(names)}
