# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fits to the records of a test bench: what a valve brings beside its estimator.

A bench fit takes columns in SI units, returns values with 95 % intervals and curves to look at.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.trend import quantile

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.core.estimation.solvers.nonlinear import CurveFit
    from valve_twin.core.types import FloatArray

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "length": {"m": 1.0, "mm": 1e-3, "um": 1e-6},
    "force": {"N": 1.0, "kN": 1e3},
    "current": {"A": 1.0, "mA": 1e-3},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "any": {},
}
"""Units of a column by what it measures, each with its size in SI; "any" keeps its own."""

CONFIDENCE = 0.95
_FEWEST = 8


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a bench record: its name before the unit, what it measures, its description."""

    name: str
    measures: str
    about: str


@dataclass(frozen=True, slots=True)
class Setting:
    """A number or word that the record does not hold.

    Attributes
    ----------
    name, about : str
        Its name, its description with the unit.
    default : float or str or None
        None = it must be given.
    choices : tuple of str
        Words that are taken; empty = a number.
    """

    name: str
    about: str
    default: float | str | None = None
    choices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class BenchValue:
    """A fitted value, the limits of its 95 % interval (NaN = none) and its unit."""

    name: str
    value: float
    lower: float
    upper: float
    unit: str


@dataclass(frozen=True, slots=True)
class BenchPlot:
    """One pair of axes: labels with units, measured points and fitted lines, (x, y) each."""

    x_label: str
    y_label: str
    measured: tuple[tuple[FloatArray, FloatArray], ...]
    fitted: tuple[tuple[FloatArray, FloatArray], ...] = ()


@dataclass(frozen=True, slots=True)
class BenchResult:
    """What a record shows.

    Attributes
    ----------
    values : tuple of BenchValue
        In the order in which they are shown.
    plots : tuple of BenchPlot
        One to three pairs of axes.
    remark : str
        How good the fit is, in one line.
    doubt : str
        Why the values must not be used; empty = they may.
    """

    values: tuple[BenchValue, ...]
    plots: tuple[BenchPlot, ...]
    remark: str
    doubt: str = ""


@dataclass(frozen=True, slots=True)
class BenchFit:
    """A kind of bench record and how it is evaluated.

    Attributes
    ----------
    kind, about : str
        Its name on the command line and its line of help.
    columns : tuple of Column
        What the record holds.
    settings : tuple of Setting
        What is told beside it.
    fit : callable
        (columns by name in SI units, (N,) each; settings by name) -> result; ValueError with one
        clear line where the record cannot be evaluated.
    """

    kind: str
    about: str
    columns: tuple[Column, ...]
    fit: Callable[[Mapping[str, FloatArray], Mapping[str, float | str]], BenchResult]
    settings: tuple[Setting, ...] = ()


def with_interval(name: str, value: float, error: float, freedom: float, unit: str) -> BenchValue:
    """Return a value with its 95 % interval by Student's t.

    Parameters
    ----------
    name, unit : str
        Its name and unit.
    value, error : float
        Estimate and standard error; NaN = no interval [unit].
    freedom : float
        Degrees of freedom [1].
    """
    half = quantile(freedom, CONFIDENCE) * error if freedom > 0.0 else np.nan
    return BenchValue(name, value, value - half, value + half, unit)


def fitted_value(
    fit: CurveFit, name: str, unit: str, function: Callable[[FloatArray], float]
) -> BenchValue:
    """Return a function of fitted parameters with its 95 % interval, by linear propagation.

    Parameters
    ----------
    fit : CurveFit
        The fit.
    name, unit : str
        Of the value.
    function : callable
        Of the parameters (P,) of the fit.
    """
    p = fit.values
    slope = np.zeros(len(p))
    for k in range(len(p)):
        step = 1e-6 * max(abs(p[k]), 1e-12)
        ends = [function(np.where(np.arange(len(p)) == k, p + s * step, p)) for s in (1.0, -1.0)]
        slope[k] = (ends[0] - ends[1]) / (2.0 * step)
    used = slope != 0.0
    variance = slope[used] @ fit.covariance[np.ix_(used, used)] @ slope[used]
    error = float(np.sqrt(variance)) if np.isfinite(variance) and variance >= 0.0 else np.nan
    return with_interval(name, float(function(p)), error, fit.freedom, unit)


def check_time(time_s: FloatArray, *, uniform: bool = False) -> float:
    """Return the sampling time [s] of increasing times (N,); ValueError says where they are not.

    Parameters
    ----------
    time_s : (N,) array
        Times [s].
    uniform : bool
        Whether every step must be the same within 1 %.
    """
    if len(time_s) < _FEWEST:
        message = f"{len(time_s)} rows; {_FEWEST} or more are needed"
        raise ValueError(message)
    steps = np.diff(time_s)
    back = np.flatnonzero(steps <= 0.0)
    if len(back):
        message = f"time goes from {time_s[back[0]]:g} to {time_s[back[0] + 1]:g} s: must increase"
        raise ValueError(message)
    step = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - step) > 0.01 * step)
    if uniform and len(uneven):
        message = (
            f"a step of {steps[uneven[0]]:g} s at {time_s[uneven[0]]:g} s among steps of "
            f"{step:g} s: must be sampled evenly"
        )
        raise ValueError(message)
    return step
