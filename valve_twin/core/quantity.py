# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One descriptor of a parameter, declared where the parameter is: a field of a dataclass.

    @dataclass(frozen=True, slots=True)
    class Tank:
        volume: float = quantity(1.0, "m^3", "Volume.", lower=0.1, upper=5.0)
        lid: str = setting("open", "State of the lid.", choices=("open", "shut"))

`describe(Tank)` lists the descriptors; YAML keys and their checks, parameters of nodes, the
reference of parameters, limits, settings of a simulation and options of a model come from them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from difflib import get_close_matches
from enum import Enum
from typing import TYPE_CHECKING, TypeVar, cast

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T")

_KEY = "valve_twin"  # of a field's metadata


class QuantityError(ValueError):
    """A value that its owner refuses.

    Parameters
    ----------
    owner : str
        Name of the record that has it.
    reason : str
        Which field, its value and what it must be.
    """

    def __init__(self, owner: str, reason: str) -> None:
        super().__init__(owner, reason)  # both are `args`: such an error can be pickled
        self.reason = reason

    def __str__(self) -> str:
        """Return one line: `owner.field = value: what it must be`."""
        return ".".join(self.args)


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
        Whether only who starts the node sets it: what names a place or lifts a rule of safety.
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
        return (
            f"value {value!r} is no {self.kind.value}; write for example {example(self.default)}"
        )

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
    """
    kinds = {float: Kind.FLOAT, int: Kind.INT, tuple: Kind.FLOATS}
    kind = kinds[type(default)]
    ages = ages and kind is Kind.FLOAT
    meta = Descriptor("", kind, default, unit, text, lower, upper, (), assumed, ages)
    return field(default=default, metadata={_KEY: meta})


def assumed(
    default: T, unit: str, text: str, lower: float = -math.inf, upper: float = math.inf, *,
    ages: bool = True) -> T:  # fmt: skip
    """Declare a number that no source gives; parameters as `quantity`."""
    return quantity(default, unit, text, lower, upper, assumed=True, ages=ages)


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
        "", kind, _plain(default), "", text,
        choices=choices, assumed=assumed, words=words, local=local,
    )  # fmt: skip
    return field(default=default, metadata={_KEY: meta})


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
    return cast("float", field(metadata={_KEY: meta}))


def records(record: type[T]) -> tuple[T, ...]:
    """Declare a tuple of records: a section each, named by the record's first field."""
    return cast("tuple[T, ...]", field(default=(), metadata={_KEY: record}))


def describe(
    node: DataclassInstance | type[DataclassInstance], prefix: str = "", names: Sequence[str] = ()
) -> tuple[Descriptor, ...]:
    """Return the descriptors of a dataclass, or of an instance with its values as defaults.

    Parameters
    ----------
    node : dataclass or instance of one
        Fields declared by `quantity`, `setting`, `needed` and `records`, and fields that hold such
        dataclasses; others are passed over.
    prefix : str
        What stands before the names of the fields, with its dot.
    names : sequence of str
        Names that records can have: each becomes a section of its own.

    Returns
    -------
    tuple of Descriptor
        One a leaf field, in the order of the fields.
    """
    return tuple(_describe(node, prefix, names))


def _describe(
    node: DataclassInstance | type[DataclassInstance], prefix: str, names: Sequence[str]
) -> Iterator[Descriptor]:
    for item in fields(node):
        name, meta = f"{prefix}{item.name}", item.metadata.get(_KEY)
        if isinstance(meta, Descriptor):
            value = meta.default if isinstance(node, type) else _plain(getattr(node, item.name))
            yield replace(meta, name=name, default=value)
        elif meta is not None:
            for key in names:
                yield from _describe(meta, f"{name}.{key}.", ())
        else:
            part = item.default_factory if isinstance(node, type) else getattr(node, item.name)
            if is_dataclass(part):
                yield from _describe(part, f"{name}.", names)


def replaced(node: T, values: Mapping[str, object], prefix: str = "") -> T:
    """Return a copy of a tree of dataclasses with the checked `values` by dotted name in it.

    Parameters
    ----------
    node : dataclass
        Where to start from.
    values : mapping
        Values as `Descriptor.check` returns them; names that the tree does not have are passed
        over. Records that are named replace those that stand in their field.
    prefix : str
        What stands before the names, with its dot.

    Raises
    ------
    ValueError
        If a record lacks a value it cannot do without, or a dataclass refuses a value.
    """
    changes: dict[str, object] = {}
    for item in fields(cast("DataclassInstance", node)):
        name, meta = f"{prefix}{item.name}", item.metadata.get(_KEY)
        present = getattr(node, item.name)
        if isinstance(meta, Descriptor):
            if name in values:
                value = values[name]
                changes[item.name] = meta.words(value) if meta.words else value
        elif meta is not None:
            found = _records(meta, f"{name}.", values)
            changes |= {item.name: found} if found else {}
        elif is_dataclass(present):
            changes[item.name] = replaced(present, values, f"{name}.")
    return cast("T", replace(cast("DataclassInstance", node), **changes))


def _records(
    record: type[DataclassInstance], prefix: str, values: Mapping[str, object]
) -> tuple[DataclassInstance, ...]:
    """Build one record a name; its first field is the name."""
    first, *others = fields(record)
    names = dict.fromkeys(
        k[len(prefix) :].rsplit(".", 1)[0] for k in values if k.startswith(prefix)
    )
    built = []
    for name in names:
        given = {f.name: values.get(f"{prefix}{name}.{f.name}", f.default) for f in others}
        lacking = [key for key, value in given.items() if value is MISSING]
        if lacking:
            msg = (
                f"'{prefix}{name}.{lacking[0]}' is missing; write it or remove the section "
                f"'{prefix}{name}'"
            )
            raise ValueError(msg)
        built.append(record(**{first.name: name}, **given))
    return tuple(built)


def check_quantities(config: DataclassInstance) -> None:
    """Refuse a number outside its declared range and a word that is no choice.

    Raises
    ------
    QuantityError
        Names the quantity, its value and the allowed range.
    """
    for item in fields(config):
        meta = item.metadata.get(_KEY)
        if not isinstance(meta, Descriptor) or meta.kind is Kind.BOOL:
            continue
        value = getattr(config, item.name)
        for one in value if isinstance(value, tuple) else (value,):
            refusal = _refusal(one, meta)
            if refusal:
                raise QuantityError(type(config).__name__, f"{item.name} = {one!r}: {refusal}")


def _refusal(value: object, meta: Descriptor) -> str:
    """Return what a value must be where it is no number inside its range or no choice."""
    if meta.kind in {Kind.STRING, Kind.STRINGS}:
        known = not meta.choices or _plain(value) in meta.choices
        return "" if known else f"must be one of {', '.join(meta.choices)}"
    numeric = isinstance(value, (int, float)) and not isinstance(value, bool)
    if numeric and meta.lower <= cast("float", value) <= meta.upper:
        return ""
    both = math.isfinite(meta.lower) and math.isfinite(meta.upper)
    allowed = f" from {meta.limits}" if both else f", {meta.limits}" if meta.limits else ""
    return f"must be a number{allowed} [{meta.unit}]"


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


def nearest_hint(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the nearest known one, else all."""
    names = list(known)
    near = get_close_matches(name, names, n=1, cutoff=0.5)
    return f"; did you mean '{near[0]}'?" if near else f"; known are {', '.join(names)}"


def _plain(value: object) -> object:
    return value.value if isinstance(value, Enum) else value
