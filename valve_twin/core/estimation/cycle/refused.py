# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cycles that give nothing: with a reason, and without an end of what follows."""

from __future__ import annotations

from dataclasses import replace
from textwrap import shorten
from traceback import extract_tb
from typing import TYPE_CHECKING

from valve_twin.core.refusal import Refusal, RefusalCode, code_of
from valve_twin.core.types import Estimate, EstimateStatus, ParameterStatus, ParameterValue

if TYPE_CHECKING:
    from valve_twin.core.types import Cycle
    from valve_twin.core.valves.interface import Options, ValveModel

_LONGEST = 300
"""Characters of what an error says of itself."""


def estimated(
    model: ValveModel, options: Options, cycle: Cycle, earlier: tuple[Estimate, ...]
) -> tuple[Estimate, ...]:
    """Return what a model estimates; where its code fails that cycle alone is refused.

    Parameters
    ----------
    model : ValveModel
        The valve's model, perhaps of another package.
    options : dataclass
        Its options, complete.
    cycle : Cycle
        The cycle.
    earlier : tuple of Estimate
        Estimates of the cycles before.
    """
    try:
        return model.estimate(cycle, options, earlier)
    except Exception as err:
        at = extract_tb(err.__traceback__)[-1]
        file = at.filename.rpartition("/")[2]
        where = f"{type(err).__name__} in {at.name}, line {at.lineno} of {file}"
        text = shorten(f"the code of {model.name} failed: {where}: {err}", _LONGEST)
        failed = Refusal(RefusalCode.FAILED, f"{text}; report it with the record of this cycle")
        return (nothing_of(model, cycle, failed),)


def refused(estimate: Estimate, reason: str) -> Estimate:
    """Take back an estimate."""
    nothing = float("nan")
    parameters = tuple(
        ParameterValue(p.name, nothing, ParameterStatus.REFUSED, reason)
        for p in estimate.parameters
    )
    return replace(estimate, parameters=parameters, status=EstimateStatus.REFUSED, reason=reason)


def coded(estimate: Estimate) -> Estimate:
    """Give a refused estimate the code of its reason."""
    if estimate.status is not EstimateStatus.REFUSED:
        return estimate
    reason = estimate.reason
    return replace(estimate, reason=str(reason), reason_code=code_of(reason))


def nothing_of(model: ValveModel, cycle: Cycle, reason: str) -> Estimate:
    """Refuse a cycle to which nothing can be fitted.

    Parameters
    ----------
    model : ValveModel
        Its trend's estimator says so.
    cycle : Cycle
        The cycle; it may be empty.
    reason : str
        Why, a `Refusal` where it has a code.
    """
    there = len(cycle.frames) > 0
    parameters = tuple(
        ParameterValue(p.name, float("nan"), ParameterStatus.REFUSED, reason)
        for p in model.parameters
    )
    return Estimate(
        model=model.name,
        estimator=model.trend_estimator,
        cycle=cycle.number,
        start_ns=cycle.start_ns if there else 0,
        end_ns=cycle.end_ns if there else 0,
        parameters=parameters,
        status=EstimateStatus.REFUSED,
        reason=reason,
        missed_cycles=cycle.missed_cycles,
        used_by_trend=True,
        reproducible=there and cycle.reproducible,
    )
