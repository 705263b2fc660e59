# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Turn a fit of the positioner into an estimate: what is known, what is not, and why."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import gram_condition
from valve_twin.core.prediction import fit_percent
from valve_twin.core.types import Estimate, ParameterStatus, ParameterValue
from valve_twin.core.valves.kit.intervals import half_width
from valve_twin.core.valves.kit.outcome import (
    Evidence,
    at_bound,
    conclude,
    not_excited,
    refuse,
    unexcited,
)
from valve_twin.core.valves.positioner.fit import shown_speeds
from valve_twin.core.valves.positioner.parameters import DERIVED, ESTIMATOR, FITTED

if TYPE_CHECKING:
    from valve_twin.core.estimation.solvers.least_squares import Limits
    from valve_twin.core.types import Cycle, FloatArray
    from valve_twin.core.valves.positioner.fit import Solution
    from valve_twin.core.valves.positioner.record import Prepared

MIN_DRIVEN = 5.0
"""How long a parameter must have moved the spool to be reported [samples], assumed."""


def refused(model: str, cycle: Cycle, prepared: Prepared) -> Estimate:
    """Return the estimate of a cycle that cannot be fitted, with its reason.

    Parameters
    ----------
    model : str
        Name of the model.
    cycle : Cycle
        The cycle.
    prepared : Prepared
        Why it cannot be fitted.
    """
    evidence = Evidence(replace(prepared.counts, used=0), noise=prepared.noise_sigma)
    names = (*FITTED, *DERIVED)
    return refuse(model, ESTIMATOR, cycle, names, prepared.refusal, evidence)


def accepted(
    model: str,
    cycle: Cycle,
    prepared: Prepared,
    solution: Solution,
    limits: Limits,
    errors: Errors | None = None,
) -> Estimate:
    """Return the estimate of a fitted cycle.

    Parameters
    ----------
    model : str
        Name of the model.
    cycle : Cycle
        The cycle.
    prepared : Prepared
        What was fitted.
    solution : Solution
        The fit.
    limits : tuple of (5,) arrays
        The bounds it obeyed.
    errors : Errors, optional
        Standard errors of the fitted parameters, where the cycle itself gives them.
    """
    fitted = [
        _fitted(name, float(solution.parameters[i]), limits[0][i], limits[1][i], driven)
        for i, (name, driven) in enumerate(zip(FITTED, solution.active, strict=True))
    ]
    if errors is not None:
        fitted = [errors.put_on(value, i) for i, value in enumerate(fitted)]
    values = (*fitted, *derived(fitted, prepared, solution.lag))
    condition = gram_condition(solution.hessian)
    evidence = Evidence(prepared.counts, condition, prepared.noise_sigma, solution.lag)
    return conclude(model, ESTIMATOR, cycle, values, unexcited(values), evidence)


@dataclass(frozen=True, slots=True)
class Errors:
    """Standard errors (P,) from inside a cycle and the degrees of freedom they rest on."""

    standard: FloatArray
    degrees: int

    def put_on(self, value: ParameterValue, i: int) -> ParameterValue:
        """Return the value with its interval, cut at 0, where it has one."""
        error = float(self.standard[i])
        if not value.usable or not np.isfinite(error):
            return value
        half = half_width(error, self.degrees)
        return replace(
            value,
            standard_error=error,
            lower_95=max(value.value - half, 0.0),
            upper_95=value.value + half,
        )


def _fitted(name: str, value: float, lower: float, upper: float, driven: float) -> ParameterValue:
    if name != "dead_band" and driven < MIN_DRIVEN:
        reason = f"it moved the spool for {driven:.0f} samples, fewer than {MIN_DRIVEN:.0f}"
        return not_excited(name, reason)
    if lower < value < upper:
        return ParameterValue(name, value)
    why = ": faster than the sampling shows" if name != "dead_band" and value >= upper else ""
    return at_bound(name, value, why)


def derived(fitted: list[ParameterValue], prepared: Prepared, lag: int) -> list[ParameterValue]:
    """Return what follows from the fit or from the data alone, in the order of `DERIVED`.

    Parameters
    ----------
    fitted : list of ParameterValue
        In the order of `FITTED`.
    prepared : Prepared
        What was fitted.
    lag : int
        Delay [samples].
    """
    delay = lag * prepared.record.period_s
    responses = [
        replace(rate, name=name, value=delay + 1.0 / rate.value)
        if rate.value > 0.0
        else not_excited(name, f"{rate.name}: no motion")
        for name, rate in zip(DERIVED[1:3], fitted[:2], strict=True)
    ]
    shown = shown_speeds(prepared.record)
    speeds = zip(DERIVED[3:5], shown, strict=True)
    record = prepared.record
    y, u = record.position[record.used], record.command[record.used]
    return [
        _delay(delay, at_bound=0 < prepared.max_lag == lag),
        *responses,
        *(ParameterValue(name, value) for name, value in speeds),
        ParameterValue(DERIVED[5], fit_percent(y, u)),
        _asymmetry(*shown),
    ]


def _asymmetry(rising: float, falling: float) -> ParameterValue:
    if rising > 0.0 and falling > 0.0:
        return ParameterValue(DERIVED[6], rising / falling)
    way = "rose" if falling > 0.0 else "fell"
    reason = f"the position never {way} by a fifth of its motion"
    return ParameterValue(DERIVED[6], np.nan, ParameterStatus.REFUSED, reason)


def _delay(delay: float, *, at_bound: bool) -> ParameterValue:
    if not at_bound:
        return ParameterValue(DERIVED[0], delay)
    reason = f"rests on the longest delay tried, {delay:.3g} s: raise max_delay_s"
    return ParameterValue(DERIVED[0], delay, ParameterStatus.AT_BOUND, reason)
