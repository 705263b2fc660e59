# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""From what a cycle gave to its estimate: parameters without a value, verdict, evidence."""

from __future__ import annotations

from math import isfinite, nan
from typing import TYPE_CHECKING, NamedTuple

from valve_twin.core.types import (
    Estimate,
    EstimateStatus,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.types import Cycle

    Verdict = tuple[EstimateStatus, str]


class Evidence(NamedTuple):
    """What stands beside the parameters of an estimate.

    Attributes
    ----------
    counts : MaskCounts
        Samples that are used and left out.
    condition : float
        Condition number of the sensitivities [1]; NaN where nothing was fitted.
    noise : float
        Noise of the output [unit of the output]; NaN where it is not known.
    lag : int
        Lag of the inputs [samples].
    """

    counts: MaskCounts
    condition: float = nan
    noise: float = nan
    lag: int = 0


def blank(
    names: Iterable[str], reason: str, status: ParameterStatus = ParameterStatus.REFUSED
) -> tuple[ParameterValue, ...]:
    """Return parameters without a value.

    Parameters
    ----------
    names : iterable of str
        Their names.
    reason : str
        Why there is none, in one line.
    status : ParameterStatus
        Whether they were refused or not excited.
    """
    return tuple(ParameterValue(name, nan, status, reason) for name in names)


def not_excited(name: str, reason: str) -> ParameterValue:
    """Return a parameter that the cycle does not show, with the reason."""
    return ParameterValue(name, nan, ParameterStatus.NOT_EXCITED, reason)


def at_bound(name: str, value: float, why: str = "") -> ParameterValue:
    """Return a parameter that rests on its bound.

    Parameters
    ----------
    name : str
        Its name.
    value : float
        The bound [unit of the parameter].
    why : str
        What that says, after the words "rests on its bound".
    """
    reason = f"rests on its bound {value:.3g}{why}"
    return ParameterValue(name, value, ParameterStatus.AT_BOUND, reason)


def at_zero(name: str, value: float) -> ParameterValue:
    """Return a parameter that cannot be negative, marked where it rests on 0."""
    if value <= 0.0:
        return ParameterValue(name, float(value), ParameterStatus.AT_BOUND, "rests on 0")
    return ParameterValue(name, float(value))


def verdict(missing: Sequence[str], word: str) -> Verdict:
    """Return status and reason of an estimate that lacks some parameters, "WORD: their names"."""
    if not missing:
        return EstimateStatus.ACCEPTED, "accepted"
    return EstimateStatus.PARTIAL, f"{word}: {', '.join(missing)}"


def unexcited(values: Iterable[ParameterValue]) -> Verdict:
    """Return status and reason of an estimate whose cycle does not show some parameters."""
    missing = [v.name for v in values if v.status is ParameterStatus.NOT_EXCITED]
    return verdict(missing, "not excited")


def withheld(values: Iterable[ParameterValue], word: str = "withheld") -> Verdict:
    """Return status and reason of an estimate in which some parameters have no value."""
    return verdict([v.name for v in values if not isfinite(v.value)], word)


def conclude(
    model: str,
    estimator: str,
    cycle: Cycle,
    values: Sequence[ParameterValue],
    judged: Verdict,
    evidence: Evidence,
) -> Estimate:
    """Return the estimate of a cycle.

    Parameters
    ----------
    model, estimator : str
        Their names.
    cycle : Cycle
        The cycle.
    values : sequence of ParameterValue
        What it gave.
    judged : tuple of EstimateStatus and str
        Status and reason.
    evidence : Evidence
        What stands beside the parameters.
    """
    status, reason = judged
    return Estimate(
        model=model,
        estimator=estimator,
        parameters=tuple(values),
        status=status,
        reason=reason,
        condition_number=evidence.condition,
        lag=evidence.lag,
        noise_sigma=evidence.noise,
        counts=evidence.counts,
        **cycle.origin,
    )


def refuse(
    model: str, estimator: str, cycle: Cycle, names: Iterable[str], reason: str, evidence: Evidence
) -> Estimate:
    """Return the estimate of a cycle that says nothing; `names` of what it lacks, else `conclude`.

    Parameters
    ----------
    model, estimator : str
        Their names.
    cycle : Cycle
        The cycle.
    names : iterable of str
        Parameters that it does not give.
    reason : str
        Why, in one line.
    evidence : Evidence
        What is known all the same.
    """
    judged = EstimateStatus.REFUSED, reason
    return conclude(model, estimator, cycle, blank(names, reason), judged, evidence)
