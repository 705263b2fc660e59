# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tolerances of the known constants of a valve, and what they do to the estimates.

A tolerance is the half width of a relative interval in which the constant lies for certain, every
place in it alike: its standard deviation is the tolerance over sqrt(3). The constants join the
least squares as unknowns that are known that well beforehand. The covariance P = (N + L)^-1, of
what the record knows (N = J^T J) and what the tolerances know (L), is P N P + P L P: the second
is a sum over the constants, so that each is told its share.
"""

from __future__ import annotations

from dataclasses import dataclass, make_dataclass
from math import isfinite, sqrt
from operator import attrgetter
from typing import TYPE_CHECKING, cast

import numpy as np

from valve_twin.core.estimation.data.robust import NORMAL_975
from valve_twin.core.quantity import assumed, describe
from valve_twin.core.types import ParameterValue
from valve_twin.core.valves.kit.outcome import at_zero, not_excited

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from _typeshed import DataclassInstance

    from valve_twin.core.quantity import Descriptor
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.interface import ModelOptions

_BEYOND = 4.0  # standard deviations beyond its tolerance that show a constant to be wrong [1]
_WORTH_NAMING = 0.1  # share of the variance from which a constant limits a parameter [1]
_MOST_NAMED = 3
_TINY = 1e-300


def tolerance_section(
    name: str,
    module: str,
    numbers: type[DataclassInstance],
    tolerances: Mapping[str, float],
    *,
    absolute: bool = False,
) -> type[DataclassInstance]:
    """Return a dataclass with a tolerance for each known constant, as a section of the options.

    Parameters
    ----------
    name, module : str
        What the dataclass is bound to and where: options are sent to other processes.
    numbers : dataclass
        Declares the constants.
    tolerances : mapping
        Half widths by name, relative to the value [1]; all are our assumption.
    absolute : bool
        The half widths are not relative but in the unit of the constant, which may be 0.

    Raises
    ------
    ValueError
        If there is no such number.
    """
    known = {d.name: d for d in describe(numbers)}
    wrong = [key for key in tolerances if key not in known]
    if wrong:
        message = f"{numbers.__name__}: no number {', '.join(wrong)} to tolerate"
        raise ValueError(message)
    fields = [
        (key, float, _width(known[key], size, absolute=absolute))
        for key, size in tolerances.items()
    ]
    made = make_dataclass(name, fields, frozen=True, slots=True)
    made.__module__ = module
    return cast("type[DataclassInstance]", made)


def _width(constant: Descriptor, size: float, *, absolute: bool) -> float:
    said = "Half width" if absolute else "Half width in parts of the value"
    text = f"{said}: {constant.text[:1].lower()}{constant.text[1:]}"
    return assumed(size, constant.unit if absolute else "1", text, 0.0, 0.5, ages=False)


@dataclass(frozen=True, slots=True)
class Tolerated:
    """Constants that are not known exactly.

    Attributes
    ----------
    names : tuple of str
        Their names.
    widths : (K,) array
        Half widths of their tolerances, in parts of the value [1].
    """

    names: tuple[str, ...]
    widths: FloatArray

    @property
    def sigmas(self) -> FloatArray:
        """The (K,) standard deviations, in parts of the value [1]."""
        return np.asarray(self.widths / sqrt(3.0))


def tolerated(options: ModelOptions) -> Tolerated:
    """Return the constants with a tolerance above 0; a value of 0 has no relative tolerance.

    Parameters
    ----------
    options : dataclass
        Has the values of the constants and their `tolerances`, see `tolerance_section`.
    """
    widths = describe(cast("DataclassInstance", options.tolerances))
    given = {d.name: cast("float", d.default) for d in widths}
    names = tuple(n for n, w in given.items() if w > 0.0 and attrgetter(n)(options) != 0.0)
    return Tolerated(names, np.array([given[n] for n in names]))


def limits(covariance: FloatArray, constants: Tolerated) -> tuple[str, ...]:
    """Return which tolerances limit each unknown, (U,), in one line; empty where the noise does.

    Parameters
    ----------
    covariance : (U + K, U + K) array
        Of the unknowns and the constants, the constants last in parts of their values [units].
    constants : Tolerated
        The K constants.
    """
    count = len(covariance) - len(constants.names)
    parts = (covariance[:count, count:] / constants.sigmas) ** 2
    whole = np.maximum(np.diag(covariance)[:count, None], _TINY)
    return tuple(limiting(row, constants.names) for row in parts / whole)


def limiting(shares: FloatArray, names: Sequence[str]) -> str:
    """Return which constants limit a parameter, in one line; empty where none does.

    Parameters
    ----------
    shares : (K,) array
        Of the constants in its variance [1].
    names : sequence of str
        Their K names.
    """
    order = np.argsort(-shares, kind="stable")[:_MOST_NAMED]
    named = [int(k) for k in order if shares[k] >= _WORTH_NAMING]
    if not named:
        return ""
    parts = (f"{names[k]} ({100.0 * shares[k]:.0f} %)" for k in named)
    return f"limited by the tolerance of {', '.join(parts)}"


@dataclass(frozen=True, slots=True)
class Doubt:
    """What is wrong with a parameter in every cycle alike.

    Attributes
    ----------
    moved : (K,) array
        What each constant changes in it, moved by a standard deviation [unit of the parameter].
    names : tuple of str
        Names of the K constants.
    method : float
        Standard error of the method itself [unit of the parameter].
    """

    moved: FloatArray
    names: tuple[str, ...]
    method: float = 0.0

    def around(self, name: str, value: float) -> ParameterValue:
        """Return a value whose limits hold this doubt; what scatters is added to them later.

        Parameters
        ----------
        name : str
            Name of the parameter.
        value : float
            Its value [unit of the parameter]; where it is 0 it rests on its bound.
        """
        if value <= 0.0:
            return at_zero(name, value)
        squares = np.square(self.moved)
        whole = float(squares.sum() + self.method**2)
        if not isfinite(whole):
            return not_excited(name, "a constant moved by its tolerance gives no value")
        half = NORMAL_975 * sqrt(whole)
        line = limiting(squares / max(whole, _TINY), self.names)
        return ParameterValue(
            name, value, reason=line, lower_95=value - half, upper_95=value + half
        )


def contradicted(found: FloatArray, errors: FloatArray, constants: Tolerated) -> str:
    """Return which constant the record shows beyond its tolerance, empty if none.

    Parameters
    ----------
    found, errors : (K,) arrays
        What the fit found, over the value of the option, and its standard errors [1].
    constants : Tolerated
        The constants.
    """
    if not len(found):
        return ""
    away = (np.abs(found - 1.0) - constants.widths) / np.maximum(errors, 1e-300)
    worst = int(np.argmax(away))
    if away[worst] <= _BEYOND:
        return ""
    return (
        f"the record shows {constants.names[worst]} {100.0 * (found[worst] - 1.0):+.2g} % off its "
        f"option, its tolerance is {100.0 * constants.widths[worst]:g} %: correct the option, or "
        "a part is not as the equations say"
    )
