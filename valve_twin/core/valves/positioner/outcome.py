# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Turn a fit of the positioner into an estimate: what is known, what is not, and why."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import (
    Estimate,
    EstimateStatus,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.core.valves.positioner.fit import shown_speeds
from valve_twin.core.valves.positioner.parameters import DERIVED, ESTIMATOR, FITTED

if TYPE_CHECKING:
    from valve_twin.core.types import Cycle
    from valve_twin.core.valves.positioner.fit import Limits, Record, Solution
    from valve_twin.core.valves.positioner.record import Prepared

_MIN_DRIVEN = 5.0
"""How long a parameter must have moved the spool to be reported [samples] [A]."""


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
    reason = prepared.refusal
    blank = (
        ParameterValue(name, np.nan, ParameterStatus.REFUSED, reason)
        for name in (*FITTED, *DERIVED)
    )
    return Estimate(
        model=model,
        estimator=ESTIMATOR,
        parameters=tuple(blank),
        status=EstimateStatus.REFUSED,
        reason=reason,
        noise_sigma=prepared.noise_sigma,
        counts=replace(prepared.counts, used=0),
        **cycle.origin,
    )


def accepted(
    model: str, cycle: Cycle, prepared: Prepared, solution: Solution, limits: Limits
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
    """
    fitted = [
        _fitted(name, float(solution.parameters[i]), limits[0][i], limits[1][i], driven)
        for i, (name, driven) in enumerate(zip(FITTED, solution.active, strict=True))
    ]
    values = (*fitted, *_derived(fitted, prepared, solution))
    withheld = [v.name for v in values if v.status is ParameterStatus.NOT_EXCITED]
    return Estimate(
        model=model,
        estimator=ESTIMATOR,
        parameters=values,
        status=EstimateStatus.PARTIAL if withheld else EstimateStatus.ACCEPTED,
        reason=f"not excited: {', '.join(withheld)}" if withheld else "accepted",
        condition_number=_condition(solution),
        lag=solution.lag,
        noise_sigma=prepared.noise_sigma,
        counts=prepared.counts,
        **cycle.origin,
    )


def _fitted(name: str, value: float, lower: float, upper: float, driven: float) -> ParameterValue:
    if name != "dead_band" and driven < _MIN_DRIVEN:
        reason = f"it moved the spool for {driven:.0f} samples, fewer than {_MIN_DRIVEN:.0f}"
        return ParameterValue(name, np.nan, ParameterStatus.NOT_EXCITED, reason)
    if lower < value < upper:
        return ParameterValue(name, value)
    why = ": faster than the sampling shows" if name != "dead_band" and value >= upper else ""
    reason = f"rests on its bound {value:.3g}{why}"
    return ParameterValue(name, value, ParameterStatus.AT_BOUND, reason)


def _derived(
    fitted: list[ParameterValue], prepared: Prepared, solution: Solution
) -> list[ParameterValue]:
    """Return what follows from the fit or from the data alone, in the order of `DERIVED`."""
    delay = solution.lag * prepared.record.period_s
    responses = [
        replace(rate, name=name, value=delay + 1.0 / rate.value)
        if rate.value > 0.0
        else ParameterValue(name, np.nan, ParameterStatus.NOT_EXCITED, f"{rate.name}: no motion")
        for name, rate in zip(DERIVED[1:3], fitted[:2], strict=True)
    ]
    speeds = zip(DERIVED[3:5], shown_speeds(prepared.record), strict=True)
    return [
        _delay(delay, at_bound=0 < prepared.max_lag == solution.lag),
        *responses,
        *(ParameterValue(name, value) for name, value in speeds),
        ParameterValue(DERIVED[5], _command_fit(prepared.record)),
    ]


def _delay(delay: float, *, at_bound: bool) -> ParameterValue:
    if not at_bound:
        return ParameterValue(DERIVED[0], delay)
    reason = f"rests on the longest delay tried, {delay:.3g} s: raise max_delay_s"
    return ParameterValue(DERIVED[0], delay, ParameterStatus.AT_BOUND, reason)


def _command_fit(record: Record) -> float:
    """Return the fit of "the position is the command" [%]."""
    y, u = record.position[record.used], record.command[record.used]
    miss, spread = np.sum((y - u) ** 2), np.sum((y - y.mean()) ** 2)
    return float(100.0 * (1.0 - np.sqrt(miss / spread)))


def _condition(solution: Solution) -> float:
    """Return the condition number of the column-scaled sensitivities of what is excited."""
    scale = np.sqrt(np.diag(solution.hessian))
    seen = scale > 0
    if not seen.any():
        return float("nan")
    scaled = solution.hessian[np.ix_(seen, seen)] / np.outer(scale[seen], scale[seen])
    return float(np.sqrt(np.linalg.cond(scaled)))
