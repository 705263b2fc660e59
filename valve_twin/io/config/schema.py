# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Describe every parameter once: nodes declare from it, files are checked against it.

Tables come from frozen dataclasses (types from the annotations, texts and units from the numpy
docstring, limits from the field metadata) and from the options of a valve model, so that a field
added there appears everywhere.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, TypeAlias, get_args, get_origin, get_type_hints

from valve_twin.core.quantity import Kind

if TYPE_CHECKING:
    from valve_twin.core.quantity import Descriptor


Instance: TypeAlias = Any
"""An instance of the class that was given."""


@dataclass(frozen=True, slots=True)
class Spec:
    """One parameter.

    Attributes
    ----------
    name : str
        Full dotted name.
    kind : Kind
        Type.
    default : object
        Default value of that type.
    description, unit : str
        One line, and the unit ("" = none, "1" = dimensionless).
    lower, upper : float
        Limits of a number, infinite where there is none.
    choices : tuple of str
        Allowed texts, empty = any.
    read_only : bool
        True where it takes effect only at configure.
    """

    name: str
    kind: Kind
    default: object
    description: str
    unit: str = ""
    lower: float = -math.inf
    upper: float = math.inf
    choices: tuple[str, ...] = ()
    read_only: bool = True

    def check(self, value: object) -> object:
        """Return `value` in the type of the parameter.

        Raises
        ------
        ValueError
            If the type is wrong or the value is outside its limits; says what is wrong and what to
            write.
        """
        return _CHECKS[self.kind](self, value)


def _check_bool(spec: Spec, value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError(_wrong(spec, value))
    return value


def _check_int(spec: Spec, value: object) -> int:
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(_wrong(spec, value))
    _check_limits(spec, value)
    return value


def _check_float(spec: Spec, value: object) -> float:
    number = _number(value)
    if number is None:
        raise ValueError(_wrong(spec, value))
    _check_limits(spec, number)
    return number


def _check_string(spec: Spec, value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, (str, int)):
        raise ValueError(_wrong(spec, value))
    text = str(value)
    _check_choice(spec, text)
    return text


def _check_strings(spec: Spec, value: object) -> tuple[str, ...]:
    items = _items(spec, value)
    if not all(isinstance(item, str) for item in items):
        raise ValueError(_wrong(spec, value))
    texts = tuple(str(item) for item in items if item != "")
    for text in texts:
        _check_choice(spec, text)
    return texts


def _check_floats(spec: Spec, value: object) -> tuple[float, ...]:
    numbers = [_number(item) for item in _items(spec, value)]
    if any(number is None for number in numbers):
        raise ValueError(_wrong(spec, value))
    found = tuple(number for number in numbers if number is not None)
    for number in found:
        _check_limits(spec, number)
    return found


_CHECKS = {
    Kind.BOOL: _check_bool,
    Kind.INT: _check_int,
    Kind.FLOAT: _check_float,
    Kind.STRING: _check_string,
    Kind.STRINGS: _check_strings,
    Kind.FLOATS: _check_floats,
}


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value)


def _items(spec: Spec, value: object) -> Sequence[object]:
    if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable):
        raise ValueError(_wrong(spec, value))
    return list(value)


def _wrong(spec: Spec, value: object) -> str:
    return f"value {value!r} is no {spec.kind.value}; write for example {example(spec.default)}"


def _check_limits(spec: Spec, value: float) -> None:
    if math.isnan(value) and (math.isfinite(spec.lower) or math.isfinite(spec.upper)):
        msg = f"value {value!r} is not a number; write {limits(spec)}"
        raise ValueError(msg)
    if value < spec.lower or value > spec.upper:
        unit = f" {spec.unit}" if spec.unit not in {"", "1"} else ""
        msg = f"value {value!r}{unit} is outside its limits; write {limits(spec)}"
        raise ValueError(msg)


def _check_choice(spec: Spec, text: str) -> None:
    if spec.choices and text not in spec.choices:
        msg = f"value '{text}' is unknown; write one of {', '.join(spec.choices)}"
        raise ValueError(msg)


def limits(spec: Spec) -> str:
    """Return the limits of a number in words, empty where there is none."""
    low, high = math.isfinite(spec.lower), math.isfinite(spec.upper)
    if low and high:
        return f"{spec.lower:g} to {spec.upper:g}"
    if low:
        return f"{spec.lower:g} or more"
    return f"{spec.upper:g} or less" if high else ""


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


def dataclass_specs(cls: type[Any], prefix: str, names: Sequence[str] = ()) -> tuple[Spec, ...]:
    """Return the table of a configuration dataclass.

    Parameters
    ----------
    cls : type
        Frozen dataclass of bool, int, float, str, Enum, tuples of str or float, again such
        dataclasses, or tuples of records whose first field is a name. Field metadata may give
        `description`, `unit`, `lower`, `upper`, `choices`.
    prefix : str
        What stands before the field names, without the dot.
    names : sequence of str
        Names that records can have: each becomes a section of its own.

    Returns
    -------
    tuple of Spec
        One a leaf field, in the order of the fields.
    """
    hints = get_type_hints(cls)
    texts = attribute_texts(cls)
    found: list[Spec] = []
    for field in dataclasses.fields(cls):
        hint, name = hints[field.name], f"{prefix}.{field.name}"
        record = _record(hint)
        if dataclasses.is_dataclass(hint):
            found += dataclass_specs(_class(hint), name, names)
        elif record is not None:
            for key in names:
                found += dataclass_specs(record, f"{name}.{key}")[1:]
        else:
            found.append(_field_spec(field, hint, name, texts.get(field.name, ""), cls))
    return tuple(found)


def _field_spec(
    field: dataclasses.Field[Any],
    hint: object,
    name: str,
    text: str,
    cls: type[Any],
) -> Spec:
    kind, choices = _kind(hint, cls, field.name)
    text, unit = _split_unit(str(field.metadata.get("description", text)))
    return Spec(
        name,
        kind,
        _default(field, kind),
        text,
        str(field.metadata.get("unit", unit)),
        float(field.metadata.get("lower", -math.inf)),
        float(field.metadata.get("upper", math.inf)),
        tuple(field.metadata.get("choices", choices)),
    )


def _default(field: dataclasses.Field[Any], kind: Kind) -> object:
    if field.default is not MISSING:
        return _plain(field.default)
    if field.default_factory is not MISSING:
        return _plain(field.default_factory())
    return _EMPTY[kind]


_EMPTY: dict[Kind, object] = {
    Kind.BOOL: False,
    Kind.INT: 0,
    Kind.FLOAT: math.nan,
    Kind.STRING: "",
    Kind.STRINGS: (),
    Kind.FLOATS: (),
}
"""Stands for "not given" where a field has no default."""


def _record(hint: object) -> type[Any] | None:
    """Return R of tuple[R, ...] where R is a dataclass."""
    inner = get_args(hint)
    if get_origin(hint) is tuple and inner and dataclasses.is_dataclass(inner[0]):
        return _class(inner[0])
    return None


def _class(hint: object) -> type[Any]:
    assert isinstance(hint, type)
    return hint


def build(cls: type[Any], prefix: str, values: Mapping[str, object]) -> Instance:
    """Build a configuration dataclass from checked values; what is not given keeps its default.

    Raises
    ------
    ValueError
        If a record lacks a value it cannot do without, or the class refuses a value.
    """
    hints = get_type_hints(cls)
    arguments: dict[str, object] = {}
    for field in dataclasses.fields(cls):
        hint, name = hints[field.name], f"{prefix}.{field.name}"
        record = _record(hint)
        if dataclasses.is_dataclass(hint):
            arguments[field.name] = build(_class(hint), name, values)
        elif record is not None:
            arguments[field.name] = _build_records(record, name, values)
        elif name in values:
            value = values[name]
            is_enum = isinstance(hint, type) and issubclass(hint, Enum)
            arguments[field.name] = hint(value) if is_enum else value
    return cls(**arguments)


def _build_records(
    record: type[Any], prefix: str, values: Mapping[str, object]
) -> tuple[Any, ...]:
    """Build one record a name; its first field is the name."""
    first, *others = dataclasses.fields(record)
    begin = prefix + "."
    names = dict.fromkeys(k[len(begin) :].rsplit(".", 1)[0] for k in values if k.startswith(begin))
    built = []
    for name in names:
        given = {f.name: values.get(f"{begin}{name}.{f.name}", f.default) for f in others}
        lacking = [key for key, value in given.items() if value is MISSING]
        if lacking:
            msg = (
                f"'{begin}{name}.{lacking[0]}' is missing; write it or remove the section "
                f"'{begin}{name}'"
            )
            raise ValueError(msg)
        built.append(record(**{first.name: name}, **given))
    return tuple(built)


def descriptor_specs(descriptors: Iterable[Descriptor]) -> tuple[Spec, ...]:
    """Return the table of described parameters."""
    return tuple(
        Spec(d.name, d.kind, d.default, d.description, d.unit, d.lower, d.upper, d.choices)
        for d in descriptors
    )


def attribute_texts(cls: type[Any]) -> dict[str, str]:
    """Return the texts of the Attributes section of a numpy docstring by attribute name."""
    doc = inspect.cleandoc(cls.__doc__ or "")
    part = re.split(r"^Attributes\n-+\n", doc, maxsplit=1, flags=re.MULTILINE)
    if len(part) == 1:
        return {}
    texts: dict[str, str] = {}
    names: list[str] = []
    for line in part[1].splitlines():
        head = re.match(r"^(\w[\w, ]*) : ", line)
        if head:
            names = [name.strip() for name in head.group(1).split(",")]
        elif line.startswith(" "):
            for name in names:
                texts[name] = f"{texts.get(name, '')} {line.strip()}".strip()
        elif line.strip():
            break
    return texts


def _split_unit(text: str) -> tuple[str, str]:
    found = re.search(r"\s*\[([^\[\]]+)\](\.?)$", text)
    if not found:
        return text, ""
    return text[: found.start()] + found.group(2), found.group(1)


def _kind(hint: object, cls: type[Any], name: str) -> tuple[Kind, tuple[str, ...]]:
    if isinstance(hint, type) and issubclass(hint, Enum):
        return Kind.STRING, tuple(str(member.value) for member in hint)
    simple = {bool: Kind.BOOL, int: Kind.INT, float: Kind.FLOAT, str: Kind.STRING}
    if isinstance(hint, type) and hint in simple:
        return simple[hint], ()
    inner = get_args(hint)
    if get_origin(hint) in {tuple, list} and inner:
        if inner[0] is str:
            return Kind.STRINGS, ()
        if inner[0] in {float, int}:
            return Kind.FLOATS, ()
    if type(None) in inner:
        rest = [i for i in inner if i is not type(None)]
        return _kind(rest[0], cls, name)
    msg = f"{cls.__name__}.{name}: a configuration field cannot be of type {hint}"
    raise TypeError(msg)


def _plain(value: object) -> object:
    if isinstance(value, Enum):
        return value.value
    return tuple(value) if isinstance(value, list) else value
