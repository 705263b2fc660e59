# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the tolerances of known constants do to any estimate: estimated again with each moved.

For a valve whose fit does not hold its constants as unknowns (`tolerances` has those that do):
one more estimate a constant that has a relative tolerance, none where all are known exactly. A
place such as a stop or a seat acts on one side of it only, so these are moved to both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot, inf, isfinite, isnan, sqrt
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from valve_twin.core.estimation.data.robust import NORMAL_975
from valve_twin.core.quantity import declared
from valve_twin.core.types import EstimateStatus
from valve_twin.core.valves.kit.outcome import not_excited
from valve_twin.core.valves.kit.tolerances import limiting

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.core.types import Estimate, FloatArray, ParameterValue
    from valve_twin.core.valves.interface import ModelOptions

T = TypeVar("T", bound="ModelOptions")

_UNMOVED = 1e-9  # of a value, below which nothing moved it [1]


@dataclass(frozen=True, slots=True)
class Moves:
    """Constants that are not known exactly, in their units.

    Attributes
    ----------
    names : tuple of str
        Their names.
    values : tuple of tuple of float
        What each is moved to: a standard deviation up or, for a place, down, too, inside its
        limits [unit of the constant].
    """

    names: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]


def moves_of(options: ModelOptions, *, absolute: bool) -> Moves:
    """Return the constants with a tolerance above 0, and by how much they may be off.

    Parameters
    ----------
    options : dataclass
        Has the values of the constants and their `tolerances`, see `tolerance_section`.
    absolute : bool
        The tolerances are in the unit of the constant, not in parts of it.
    """
    found: dict[str, tuple[float, ...]] = {}
    tolerances, known = options.tolerances, declared(type(options))
    for name in declared(type(tolerances)):
        value = float(getattr(options, name))
        sigma = getattr(tolerances, name) * (1.0 if absolute else abs(value)) / sqrt(3.0)
        if sigma > 0.0:
            lower, upper = known[name].lower, known[name].upper
            sides = [x for x in (value + sigma, value - sigma) if lower <= x <= upper]
            sides = sides or [lower, upper]
            found[name] = tuple(sides if absolute else sides[:1])
    return Moves(tuple(found), tuple(found.values()))


def with_tolerances(
    options: T,
    estimate: Callable[[T], tuple[Estimate, ...]],
    of: Sequence[str],
    *,
    absolute: bool = False,
) -> tuple[Estimate, ...]:
    """Return a cycle's estimates; their intervals hold what known constants may be off.

    Parameters
    ----------
    options : dataclass
        The model's options, with `tolerances`.
    estimate : callable
        Takes options, returns the estimates of the cycle for constants that are known exactly.
    of : sequence of str
        Names of the estimators that are widened.
    absolute : bool
        The tolerances are in the unit of the constant, not in parts of it.
    """
    found = estimate(options)
    refused = all(e.status is EstimateStatus.REFUSED for e in found)
    if refused or not any(e.estimator in of for e in found):
        return found
    moves = moves_of(options, absolute=absolute)
    if not moves.names:
        return found
    asked = tuple(name for name in options.estimators if name in of)
    asides = []
    for name, values in zip(moves.names, moves.values, strict=True):
        changes = [{"estimators": asked, name: value} for value in values]
        sides = [estimate(replace(options, **changed)) for changed in changes]
        asides.append([{e.estimator: e for e in side} for side in sides])
    return tuple(
        _widened(e, [[side[e.estimator] for side in sides] for sides in asides], moves)
        if e.estimator in of
        else e
        for e in found
    )


def _widened(estimate: Estimate, asides: Sequence[Sequence[Estimate]], moves: Moves) -> Estimate:
    """Return an estimate whose limits hold what each constant, moved, changes in it at most."""
    parameters = tuple(
        _around(
            p, np.array([max(_off(p, side) for side in sides) for sides in asides]), moves.names
        )
        if p.usable
        else p
        for p in estimate.parameters
    )
    return replace(estimate, parameters=parameters)


def _off(p: ParameterValue, moved: Estimate) -> float:
    """Return how far a parameter moved, infinite where it was lost."""
    off = abs(moved.value(p.name) - p.value)
    return off if isfinite(off) else inf


def _around(p: ParameterValue, moved: FloatArray, names: Sequence[str]) -> ParameterValue:
    """Return a value whose limits hold what each of the K constants moves it."""
    if not np.isfinite(moved).all():
        lost = names[int(np.flatnonzero(~np.isfinite(moved))[0])]
        return not_excited(p.name, f"{lost} moved by its tolerance gives no value")
    if not np.abs(moved).max() > _UNMOVED * abs(p.value):
        return p
    own = 0.0 if isnan(p.lower_95) else max(p.value - p.lower_95, p.upper_95 - p.value)
    squares = np.square(NORMAL_975 * moved)
    half = hypot(own, sqrt(float(squares.sum())))
    line = limiting(squares / half**2, names)
    reason = "; ".join(filter(None, (p.reason, line)))
    return replace(p, reason=reason, lower_95=p.value - half, upper_95=p.value + half)
