# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Trees of dataclasses whose fields are declared: listed, filled and checked."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields, is_dataclass, replace
from typing import TYPE_CHECKING, TypeVar, cast

from valve_twin.core.quantity.declare import KEY, Descriptor, Kind, plain
from valve_twin.core.quantity.names import suggest
from valve_twin.core.records import once_a_record

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from _typeshed import DataclassInstance

T = TypeVar("T")


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


@once_a_record
def declared(node: type) -> Mapping[str, Descriptor]:
    """Return the descriptors of a dataclass's own fields by name, without those of its parts.

    Parameters
    ----------
    node : dataclass
        Fields as of `describe`; those that hold records or other dataclasses are passed over.
    """
    found = (
        (item.name, item.metadata.get(KEY)) for item in fields(cast("DataclassInstance", node))
    )
    return {name: meta for name, meta in found if isinstance(meta, Descriptor)}


def _describe(
    node: DataclassInstance | type[DataclassInstance], prefix: str, names: Sequence[str]
) -> Iterator[Descriptor]:
    for item in fields(node):
        name, meta = f"{prefix}{item.name}", item.metadata.get(KEY)
        if isinstance(meta, Descriptor):
            value = meta.default if isinstance(node, type) else plain(getattr(node, item.name))
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
        name, meta = f"{prefix}{item.name}", item.metadata.get(KEY)
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


def checked(
    known: DataclassInstance | type[DataclassInstance],
    given: Mapping[str, object],
    *,
    where: str = "",
    unknown: str = "unknown setting",
) -> dict[str, object]:
    """Return settings by name in the types of their parameters, as `replaced` takes them.

    Parameters
    ----------
    known : dataclass or instance of one
        Has the parameters, as `describe` lists them.
    given : mapping
        Values by dotted name.
    where : str
        What a message puts before a name, with its dot.
    unknown : str
        What a message calls a name that is not known.

    Raises
    ------
    ValueError
        If a name is unknown (the nearest one is named), a type is wrong or a value outside its
        range.
    """
    descriptors = {d.name: d for d in describe(known)}
    values = {}
    for name, value in given.items():
        if name not in descriptors:
            message = f"{where}{name}: {unknown}; {suggest(name, descriptors)}"
            raise ValueError(message)
        try:
            values[name] = descriptors[name].check(value)
        except ValueError as err:
            message = f"{where}{name}: {err}"
            raise ValueError(message) from None
    return values


def check_quantities(config: DataclassInstance) -> None:
    """Refuse a number outside its declared range and a word that is no choice.

    Raises
    ------
    QuantityError
        Names the quantity, its value and the allowed range.
    """
    for item in fields(config):
        meta = item.metadata.get(KEY)
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
        known = not meta.choices or plain(value) in meta.choices
        return "" if known else f"must be one of {', '.join(meta.choices)}"
    numeric = isinstance(value, (int, float)) and not isinstance(value, bool)
    if numeric and meta.lower <= cast("float", value) <= meta.upper:
        return ""
    both = math.isfinite(meta.lower) and math.isfinite(meta.upper)
    allowed = f" from {meta.limits}" if both else f", {meta.limits}" if meta.limits else ""
    return f"must be a number{allowed} [{meta.unit}]"
