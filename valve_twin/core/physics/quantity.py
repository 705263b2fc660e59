# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Physical quantities as dataclass fields: default, unit, allowed range and description."""

from __future__ import annotations

import math
from dataclasses import field, fields
from difflib import get_close_matches
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from collections.abc import Iterable

    from _typeshed import DataclassInstance

ASSUMPTION = "[A] assumption"


def quantity(
    default: float,
    unit: str,
    description: str,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    assumed: bool = False,
    ages: bool = True,
) -> float:
    """Declare a dataclass field that holds a physical number.

    Parameters
    ----------
    default : float
        Default value, in `unit`.
    unit : str
        SI unit, "1" = dimensionless.
    description : str
        One line: what it is.
    lower, upper : float
        Allowed range, both ends included, in `unit`.
    assumed : bool
        Whether no source gives the value: the description then carries the tag "[A] assumption".
    ages : bool
        Whether the quantity may age or scatter; False for numbers of the computation.
    """
    text = f"{description} {ASSUMPTION}" if assumed else description
    meta = {"unit": unit, "description": text, "lower": lower, "upper": upper, "ages": ages}
    return field(default=default, metadata=meta)


def whole(default: int, unit: str, description: str, *, lower: int, upper: int) -> int:
    """Declare a dataclass field that holds a whole number; parameters as in `quantity`."""
    meta = {"unit": unit, "description": description, "lower": lower, "upper": upper}
    return field(default=default, metadata=meta)


def check_quantities(config: DataclassInstance) -> None:
    """Refuse a value outside its declared range.

    Raises
    ------
    ValueError
        Names the quantity, its value and the allowed range.
    """
    for item in fields(config):
        if "lower" not in item.metadata:
            continue
        value = getattr(config, item.name)
        values = value if isinstance(value, tuple) else (value,)
        lower, upper, unit = (item.metadata[key] for key in ("lower", "upper", "unit"))
        for number in values:
            _check_number(f"{type(config).__name__}.{item.name}", number, lower, upper, unit)


def _check_number(name: str, number: object, lower: float, upper: float, unit: str) -> None:
    """Refuse what is not a number inside [lower, upper]."""
    numeric = isinstance(number, (int, float)) and not isinstance(number, bool)
    if not (numeric and lower <= cast("float", number) <= upper):
        message = f"{name} = {number!r}: must be a number from {lower:g} to {upper:g} [{unit}]"
        raise ValueError(message)


def nearest_hint(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the nearest known one, else all."""
    names = list(known)
    near = get_close_matches(name, names, n=1, cutoff=0.5)
    return f"; did you mean '{near[0]}'?" if near else f"; known are {', '.join(names)}"
