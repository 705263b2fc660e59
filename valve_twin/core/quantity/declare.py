# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What one parameter is, and how a field of a dataclass declares it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TypeVar, cast

T = TypeVar("T")

KEY = "valve_twin"
"""Of a field's metadata."""


class Kind(Enum):
    """Type of a parameter; the value is what a user reads."""

    BOOL = "true or false"
    INT = "integer"
    FLOAT = "number"
    STRING = "text"
    STRINGS = "list of texts"
    FLOATS = "list of numbers"


@dataclass(frozen=True, slots=True)
class Descriptor:
    """What one parameter is.

    Attributes
    ----------
    name : str
        Full dotted name.
    kind : Kind
        Type.
    default : object
        Default value of that type.
    unit : str
        Unit ("" = none, "1" = dimensionless).
    text : str
        One line: what it is.
    lower, upper : float
        Limits of a number, both ends included, infinite where there is none [unit].
    choices : tuple of str
        Allowed texts, empty = any.
    assumed : bool
        Whether no source gives the value.
    ages : bool
        Whether it is a physical number that may age or scatter.
    read_only : bool
        True where it takes effect only at configure.
    local : bool
        Whether only who starts the node sets it: what names a place, lifts a rule of safety
        or lets go of data.
    words : type of Enum, optional
        Where the field holds members of it rather than their texts.
    note : str
        What else is to be said of it, behind the text.
    """

    name: str
    kind: Kind
    default: object
    unit: str = ""
    text: str = ""
    lower: float = -math.inf
    upper: float = math.inf
    choices: tuple[str, ...] = ()
    assumed: bool = False
    ages: bool = False
    read_only: bool = True
    local: bool = False
    words: type[Enum] | None = None
    note: str = ""

    @property
    def description(self) -> str:
        """The text, whether the value is assumed, and the note."""
        text = f"{self.text} (assumed)" if self.assumed else self.text
        return f"{text}; {self.note}" if self.note else text

    @property
    def limits(self) -> str:
        """The limits of a number in words, empty where there is none."""
        low, high = math.isfinite(self.lower), math.isfinite(self.upper)
        if low and high:
            return f"{self.lower:g} to {self.upper:g}"
        if low:
            return f"{self.lower:g} or more"
        return f"{self.upper:g} or less" if high else ""

    def check(self, value: object) -> object:
        """Return `value` in the type of the parameter.

        Raises
        ------
        ValueError
            If the type is wrong or the value is outside its limits; says what is wrong and what to
            write.
        """
        if self.kind in {Kind.STRINGS, Kind.FLOATS}:
            if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable):
                raise ValueError(self._wrong(value))
            items = tuple(self._item(item, value) for item in value)
            return tuple(item for item in items if item != "")
        return self._item(value, value)

    def _item(self, item: object, value: object) -> object:
        """Return a value, or an item of a list, in its type."""
        if self.kind in {Kind.STRING, Kind.STRINGS}:
            whole = isinstance(item, int) and not isinstance(item, bool)
            if not (isinstance(item, str) or (whole and self.kind is Kind.STRING)):
                raise ValueError(self._wrong(value))
            return self._choice(str(item))
        if self.kind is Kind.BOOL:
            if not isinstance(item, bool):
                raise ValueError(self._wrong(value))
            return item
        if isinstance(item, bool) or not isinstance(item, (int, float)):
            raise ValueError(self._wrong(value))
        if self.kind is Kind.INT:
            if isinstance(item, float) and not item.is_integer():
                raise ValueError(self._wrong(value))
            return self._number(int(item))
        return self._number(float(item))

    def _wrong(self, value: object) -> str:
        shown = [1.0] if self.kind is Kind.FLOATS and not self.default else self.default
        return f"value {value!r} is no {self.kind.value}; write for example {example(shown)}"

    def _choice(self, text: str) -> str:
        if (
            self.choices
            and text not in self.choices
            and not (text == "" and self.kind is Kind.STRINGS)
        ):
            msg = f"value '{text}' is unknown; write one of {', '.join(self.choices)}"
            raise ValueError(msg)
        return text

    def _number(self, value: float) -> float:
        if math.isnan(value) and self.limits:
            msg = f"value {value!r} is not a number; write {self.limits}"
            raise ValueError(msg)
        if value < self.lower or value > self.upper:
            unit = f" {self.unit}" if self.unit not in {"", "1"} else ""
            msg = f"value {value!r}{unit} is outside its limits; write {self.limits}"
            raise ValueError(msg)
        return value


def quantity(
    default: T,
    unit: str,
    text: str,
    lower: float = -math.inf,
    upper: float = math.inf,
    *,
    assumed: bool = False,
    ages: bool = True,
    local: bool = False,
) -> T:
    """Declare a dataclass field that holds a number, or a tuple of numbers.

    Parameters
    ----------
    default : float, int or tuple of float
        Default value [unit]; an int makes it a whole number.
    unit : str
        SI unit, "1" = dimensionless.
    text : str
        One line: what it is.
    lower, upper : float
        Allowed range, both ends included [unit].
    assumed : bool
        Whether no source gives the value.
    ages : bool
        Whether the number of a plant may age or scatter; False for those of the computation.
    local : bool
        As of `Descriptor`.
    """
    kinds = {float: Kind.FLOAT, int: Kind.INT, tuple: Kind.FLOATS}
    kind = kinds[type(default)]
    ages = ages and kind is Kind.FLOAT
    meta = Descriptor(
        "", kind, default, unit, text, lower, upper,
        assumed=assumed, ages=ages, local=local,
    )  # fmt: skip
    return field(default=default, metadata={KEY: meta})


def assumed(
    default: T, unit: str, text: str, lower: float = -math.inf, upper: float = math.inf, *,
    ages: bool = True, local: bool = False) -> T:  # fmt: skip
    """Declare a number that no source gives; parameters as `quantity`."""
    return quantity(default, unit, text, lower, upper, assumed=True, ages=ages, local=local)


def compiled(kind: type[T], owner: object, **others: object) -> T:
    """Return the numbers of a configuration as compiled functions take them.

    Parameters
    ----------
    kind : type
        The named tuple to fill; its annotations say which numbers are whole.
    owner : dataclass
        Has numbers of the same names.
    others : float, int or named tuple
        Numbers that are not those of the owner [unit by number].
    """
    takes = {"int": int, "bool": bool, "float": float}
    numbers = {}
    for name, annotation in kind.__annotations__.items():
        value = others[name] if name in others else getattr(owner, name)
        numbers[name] = takes[annotation](value) if annotation in takes else value
    return kind(**numbers)


def setting(
    default: T,
    text: str,
    *,
    choices: tuple[str, ...] = (), assumed: bool = False, local: bool = False,
) -> T:  # fmt: skip
    """Declare a dataclass field that holds a word, a tuple of words or a flag.

    Parameters
    ----------
    default : str, tuple of str, bool or member of an Enum
        Default value; an Enum allows the values of its members.
    text : str
        One line: what it is.
    choices, assumed, local
        As of `Descriptor`.
    """
    kinds = {str: Kind.STRING, bool: Kind.BOOL, tuple: Kind.STRINGS}
    words = type(default) if isinstance(default, Enum) else None
    kind = Kind.STRING if words else kinds[type(default)]
    choices = tuple(str(member.value) for member in words) if words else choices
    meta = Descriptor(
        "", kind, plain(default), "", text,
        choices=choices, assumed=assumed, words=words, local=local,
    )  # fmt: skip
    return field(default=default, metadata={KEY: meta})


def needed(unit: str, text: str, *, lower: float = -math.inf, upper: float = math.inf) -> float:
    """Declare a number without default: a record needs it.

    Parameters
    ----------
    unit : str
        SI unit, "1" = dimensionless.
    text : str
        One line: what it is.
    lower, upper : float
        Allowed range, both ends included [unit].
    """
    meta = Descriptor("", Kind.FLOAT, math.nan, unit, text, lower, upper)
    return cast("float", field(metadata={KEY: meta}))


def records(record: type[T]) -> tuple[T, ...]:
    """Declare a tuple of records: a section each, named by the record's first field."""
    return cast("tuple[T, ...]", field(default=(), metadata={KEY: record}))


def example(value: object) -> str:
    """Return a value as it is written in a YAML file of parameters."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        if math.isnan(value):
            return ".nan"
        if math.isinf(value):
            return ".inf" if value > 0 else "-.inf"
        text = repr(value)
        return text if any(c in text for c in ".n") else text.replace("e", ".0e")
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(example(item) for item in (value or ("",))) + "]"
    return str(value) if isinstance(value, int) else f'"{value}"'


def plain(value: object) -> object:
    """Return a member of an Enum as its text, anything else as it is."""
    return value.value if isinstance(value, Enum) else value
