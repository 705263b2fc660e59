# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Results as named columns: the one description that all their formats are derived from.

A message, a line of JSON and a row of a table are flat, our results are not: an estimate holds
parameters, guards and conditions. `columns` reads the dataclass: a plain field is a column of the
same name, a field with a part (`MaskCounts`) or with a tuple of parts (`Guard`) gives one column
for each field of the part. `Annotated[float, "values"]` names a column otherwise. A format that
knows how to write a column of each kind therefore needs no list of fields of its own.
"""

from __future__ import annotations

import dataclasses
import typing
from functools import cache
from itertools import starmap
from operator import attrgetter
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

T = TypeVar("T")


def once_a_record(function: Callable[[type], T]) -> Callable[[type], T]:
    """Let a function of a class of records work once for each class."""
    return cache(function)


@dataclasses.dataclass(frozen=True, slots=True)
class Column:
    """One value of a record, or one of each of its parts.

    Attributes
    ----------
    name : str
        Name in messages and lines of JSON.
    field : str
        Field of the record that holds it.
    kind : type
        float, int, bool, str or an IntEnum.
    part : str
        Field of the part; empty where the field itself is the value.
    many : bool
        Whether the field is a tuple of parts: the column is a list then.
    """

    name: str
    field: str
    kind: type
    part: str = ""
    many: bool = False

    @property
    def path(self) -> str:
        """Where a value stands in the record, for `operator.attrgetter`; not of a list."""
        return f"{self.field}.{self.part}" if self.part else self.field


@dataclasses.dataclass(frozen=True, slots=True)
class Field:
    """One field of a record and its columns.

    Attributes
    ----------
    name : str
        Name of the field.
    columns : tuple of Column
        One, or one for each field of the part.
    part : type or None
        Class of the part or the parts; None where the field itself is the value.
    """

    name: str
    columns: tuple[Column, ...]
    part: Callable[..., object] | None = None

    @property
    def many(self) -> bool:
        """Whether it is a tuple of parts."""
        return self.columns[0].many


@once_a_record
def columns(record: type) -> tuple[Column, ...]:
    """Return the columns of a dataclass in the order of its fields.

    Raises
    ------
    TypeError
        If a field is neither a float, int, bool, str or IntEnum nor a dataclass or tuple of them.
    """
    return tuple(column for field in fields(record) for column in field.columns)


@once_a_record
def fields(record: type) -> tuple[Field, ...]:
    """Return the fields of a dataclass with their columns; raises as `columns` does."""
    return tuple(_field(record, name, kind, column) for name, kind, column in _hints(record))


def flat(value: object) -> dict[str, object]:
    """Return a record as a mapping from the names of its columns to their values or lists."""
    plan = _plan(type(value))
    found = dict(zip(plan.names, plan.read(value), strict=True))
    for field, names, read in plan.lists:
        rows = [read(part) for part in getattr(value, field)]
        lists = map(list, zip(*rows, strict=True)) if rows else ([] for _ in names)
        found.update(zip(names, lists, strict=True))
    return {name: found[name] for name in plan.order}


def build(record: type[T], values: Mapping[str, object]) -> T:
    """Return the record of a mapping as `flat` makes it.

    Parameters
    ----------
    record : type
        Dataclass to make.
    values : mapping
        By name of the column; one that is not there takes the default of its field.

    Raises
    ------
    TypeError
        If a column without a default is not there.
    ValueError
        If the columns of one tuple of parts differ in length.
    """
    found: dict[str, object] = {}
    for field in fields(record):
        if field.part is None:
            name = field.columns[0].name
            if name in values:
                found[field.name] = values[name]
        elif field.many:
            lists = [typing.cast("list[object]", values[c.name]) for c in field.columns]
            found[field.name] = tuple(starmap(field.part, zip(*lists, strict=True)))
        else:
            given = {c.part: values[c.name] for c in field.columns if c.name in values}
            found[field.name] = field.part(**given)
    make: Callable[..., T] = record
    return make(**found)


class _Plan(typing.NamedTuple):
    """How `flat` reads a record: all single values at once, then the lists."""

    names: tuple[str, ...]
    read: Callable[[object], tuple[object, ...]]
    lists: tuple[tuple[str, tuple[str, ...], Callable[[object], tuple[object, ...]]], ...]
    order: tuple[str, ...]


@once_a_record
def _plan(record: type) -> _Plan:
    known = columns(record)
    single = [c for c in known if not c.many]
    lists = [(f.name, f.columns) for f in fields(record) if f.many]
    return _Plan(
        tuple(c.name for c in single),
        read_all([c.path for c in single]),
        tuple((n, tuple(c.name for c in cs), read_all([c.part for c in cs])) for n, cs in lists),
        tuple(c.name for c in known),
    )


def read_all(paths: Sequence[str]) -> Callable[[object], tuple[object, ...]]:
    """Return a function that reads attributes of a value as a tuple, also a single one."""
    read = attrgetter(*paths)
    return read if len(paths) > 1 else lambda value: (read(value),)


def _field(record: type, name: str, kind: object, column: str) -> Field:
    many = typing.get_origin(kind) is tuple
    part = typing.get_args(kind)[0] if many else kind
    if isinstance(part, type) and dataclasses.is_dataclass(part):
        found = (Column(c, name, _plain(part, f, k), f, many) for f, k, c in _hints(part))
        return Field(name, tuple(found), part)
    return Field(name, (Column(column, name, _plain(record, name, kind)),))


def _hints(record: type) -> list[tuple[str, object, str]]:
    """Return name, type and name of the column of every field of a dataclass."""
    hints = typing.get_type_hints(record, include_extras=True)
    found = []
    for field in dataclasses.fields(record):
        kind, name = hints[field.name], field.name
        if typing.get_origin(kind) is typing.Annotated:
            kind, name = typing.get_args(kind)
        found.append((field.name, kind, name))
    return found


def _plain(record: type, field: str, kind: object) -> type:
    if isinstance(kind, type) and issubclass(kind, (float, int, str)):
        return kind
    msg = (
        f"{record.__name__}.{field}: {kind} fits in no column: make it a float, int, bool, str or "
        "IntEnum, or a dataclass or tuple of dataclasses of these"
    )
    raise TypeError(msg)
