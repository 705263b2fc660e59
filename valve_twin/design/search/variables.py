# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Numbers of a design that a search changes, and designs with changed numbers.

Unless the stroke is changed itself, it is kept: a valve needs its way, and a solenoid that is
faster because it moves less is no better.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from valve_twin.core.quantity import Kind, describe, replaced, suggest

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.design.geometry import DoubleStroke

_DIGITS = 6  # significant ones of a changed number: designs that agree in them are one
_WIDE = 8.0  # bounds further apart are searched by their logarithm, assumed [1]
_KEPT = ("wire", "wire_grade", "wire_overall")  # come in the sizes of a standard


@dataclass(frozen=True, slots=True)
class Variable:
    """A number of a design and its bounds.

    Attributes
    ----------
    name : str
        Dotted name in the design.
    lower, upper : float
        Bounds [its unit].
    whole : bool
        Whether it is a whole number.
    """

    name: str
    lower: float
    upper: float
    whole: bool = False

    def at(self, share: float) -> float:
        """Return the value at a share of the way from lower to upper, 0..1 [1]."""
        if self.lower > 0.0 and self.upper > _WIDE * self.lower:
            value = self.lower * (self.upper / self.lower) ** share
        else:
            value = self.lower + share * (self.upper - self.lower)
        return float(round(value)) if self.whole else float(f"{value:.{_DIGITS}g}")

    def share(self, value: float) -> float:
        """Return where a value [its unit] stands between the bounds, 0..1 [1]."""
        if self.lower > 0.0 and self.upper > _WIDE * self.lower:
            found = math.log(value / self.lower) / math.log(self.upper / self.lower)
        else:
            found = (value - self.lower) / (self.upper - self.lower)
        return min(max(found, 0.0), 1.0)


def make_variable(start: DoubleStroke, name: str, lower: float, upper: float) -> Variable:
    """Return a variable of a design.

    Parameters
    ----------
    start : DoubleStroke
        Where the search starts.
    name : str
        Dotted name.
    lower, upper : float
        Bounds [its unit].

    Raises
    ------
    ValueError
        If the design has no such number, or the bounds are reversed or outside its limits.
    """
    known = {d.name: d for d in describe(start) if d.kind in {Kind.FLOAT, Kind.INT}}
    if name not in known:
        message = f"'{name}' is no number of the design; {suggest(name, known)}"
        raise ValueError(message)
    of = known[name]
    if not lower < upper:
        message = f"{name}: bounds {lower:g} to {upper:g}: the lower must be below the upper"
        raise ValueError(message)
    if lower < of.lower or upper > of.upper:
        message = f"{name}: bounds {lower:g} to {upper:g}: must lie in {of.limits} [{of.unit}]"
        raise ValueError(message)
    return Variable(name, lower, upper, whole=of.kind is Kind.INT)


def dimensions(start: DoubleStroke) -> tuple[str, ...]:
    """Return the numbers of a solenoid that may change: not 0, and in no standard's sizes."""
    return tuple(
        d.name
        for d in describe(start)
        if "." not in d.name and d.name not in _KEPT and isinstance(d.default, (int, float))
        and d.default
    )  # fmt: skip


def value_of(design: DoubleStroke, name: str) -> float:
    """Return a number of a design.

    Parameters
    ----------
    design : DoubleStroke
        The design.
    name : str
        Dotted name [its unit].
    """
    found: object = design
    for part in name.split("."):
        found = getattr(found, part)
    if not isinstance(found, (int, float)):
        message = f"'{name}' is no number of the design"
        raise TypeError(message)
    return float(found)


def changed(start: DoubleStroke, values: Mapping[str, float]) -> DoubleStroke:
    """Return a design with changed numbers and, unless it is among them, the same stroke.

    Parameters
    ----------
    start : DoubleStroke
        The design.
    values : mapping
        By dotted name [its unit].

    Raises
    ------
    ValueError
        If a number is outside its limits.
    """
    kinds = {d.name: d.kind for d in describe(start)}
    exact = {n: round(v) if kinds[n] is Kind.INT else v for n, v in values.items()}
    found = replaced(start, exact)
    if "stroke_ratio" not in values and found.gap > 0.0:
        found = replace(found, stroke_ratio=start.stroke / found.gap)
    return found


def key_of(values: Mapping[str, float]) -> str:
    """Return what a design is known by: its changed numbers in the order of their names."""
    return " ".join(f"{name}={values[name]:.{_DIGITS}g}" for name in sorted(values))
