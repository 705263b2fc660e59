# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Turn a fit of the extended positioner into an estimate: what its further terms say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import gram_condition
from valve_twin.core.types import Estimate, EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.core.valves.kit.intervals import block_errors
from valve_twin.core.valves.kit.outcome import Evidence, at_bound, conclude, not_excited
from valve_twin.core.valves.positioner import extended as law
from valve_twin.core.valves.positioner.curve import line_through, settled
from valve_twin.core.valves.positioner.fit_extended import correlated_sigma
from valve_twin.core.valves.positioner.outcome import Errors, derived
from valve_twin.core.valves.positioner.parameters import CURVE, ESTIMATOR, FITTED, SECOND_ORDER
from valve_twin.core.valves.positioner.second_order import column, second_order

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import BoolArray, Cycle, FloatArray
    from valve_twin.core.valves.positioner.fit_extended import Extended
    from valve_twin.core.valves.positioner.record import Prepared
    from valve_twin.core.valves.positioner.structure import Structure

_AT_BOUND = 1e-5  # distance to a bound that counts as none, in units of the interval [1]
_LEAST_EFFECT = 2.0  # of a parameter on the residual, in its standard deviations [1], assumed


@dataclass(frozen=True, slots=True)
class Fitted:
    """A fitted cycle: its record, structure, fit and the cycles before."""

    prepared: Prepared
    structure: Structure
    fit: Extended
    earlier: Sequence[Estimate]


def accepted_extended(model: str, cycle: Cycle, found: Fitted, blocks: int) -> Estimate:
    """Return the estimate of a fitted cycle.

    Parameters
    ----------
    model : str
        Name of the model.
    cycle : Cycle
        The cycle.
    found : Fitted
        What was fitted, and how.
    blocks : int
        Blocks of the cycle that give the intervals; fewer than 2 = none.
    """
    fit, structure, period_s = found.fit, found.structure, cycle.period_s
    plain = [_value(name, i, fit, blocks) for i, name in enumerate(FITTED) if i in fit.free]
    values = [*plain, *derived(plain, found.prepared, fit.lags[0])]
    if structure.second_order:
        lag = _value(SECOND_ORDER[0], law.LAG, fit, blocks)
        values += second_order(lag, fit, found.prepared.record)
    if structure.two_delays:
        at_bound = fit.lags[1] == found.prepared.max_lag > 0
        status = ParameterStatus.AT_BOUND if at_bound else ParameterStatus.OK
        reason = "rests on the longest delay tried: raise max_delay_s" if at_bound else ""
        values.append(ParameterValue("delay_falling", fit.lags[1] * period_s, status, reason))
    for name, i in (("stiction", law.STICTION), ("backlash", law.BACKLASH)):
        if i in fit.free:
            values.append(_value(name, i, fit, blocks))
    if structure.static_curve:
        values += _curve(found, blocks)
    absent = (ParameterStatus.NOT_EXCITED, ParameterStatus.REFUSED)
    withheld = [v for v in values if v.status in absent]
    reasons = dict.fromkeys(v.reason for v in withheld if v.status is ParameterStatus.REFUSED)
    missing = [v.name for v in withheld if v.status is ParameterStatus.NOT_EXCITED]
    lines = [*([f"not excited: {', '.join(missing)}"] if missing else []), *reasons]
    judged = EstimateStatus.PARTIAL if withheld else EstimateStatus.ACCEPTED
    condition = gram_condition(fit.jacobian.T @ fit.jacobian)
    prepared = found.prepared
    evidence = Evidence(prepared.counts, condition, prepared.noise_sigma, fit.lags[0])
    reason = "; ".join(lines) or "accepted"
    return conclude(model, ESTIMATOR, cycle, values, (judged, reason), evidence)


def _value(name: str, i: int, fit: Extended, blocks: int) -> ParameterValue:
    """Return one fitted parameter with its doubt."""
    value, lower, upper = float(fit.parameters[i]), float(fit.lower[i]), float(fit.upper[i])
    if i not in fit.free:
        return not_excited(name, "not a term of this valve's options")
    size = max(abs(value), 1e-3)
    may_be_none = name in ("dead_band", "stiction", "backlash")
    effect = float(np.linalg.norm(column(fit, i))) * size
    if not may_be_none and effect <= _LEAST_EFFECT * correlated_sigma(fit.residual):
        return not_excited(name, "it has no effect above the noise")
    near = _AT_BOUND * (upper - lower)
    if value - lower <= near or upper - value <= near:
        return at_bound(name, value)
    errors = _errors(fit, blocks)
    return errors.put_on(ParameterValue(name, value), i) if errors else ParameterValue(name, value)


def _errors(fit: Extended, blocks: int) -> Errors | None:
    if blocks < 2:
        return None
    span = fit.upper - fit.lower
    inside = (fit.parameters > fit.lower + _AT_BOUND * span) & (
        fit.parameters < fit.upper - _AT_BOUND * span
    )
    jacobian = fit.jacobian

    def normal_of(mask: BoolArray) -> tuple[FloatArray, FloatArray]:
        part = jacobian[mask]
        return -part.T @ fit.residual[mask], part.T @ part

    standard = np.full(len(fit.parameters), np.nan)
    standard[fit.free] = block_errors(
        jacobian.T @ jacobian,
        normal_of,
        np.ones(len(fit.residual), dtype=np.bool_),
        inside[fit.free],
        blocks,
    )
    return Errors(standard, blocks - 1)


def _curve(found: Fitted, blocks: int) -> list[ParameterValue]:
    """Return dead command, gain, rest, and what the valve settled at under the top command."""
    fit = found.fit
    record = found.prepared.record
    top = float(record.command[record.used].max())
    dead, gain, rest = (
        float(fit.parameters[i]) for i in (law.DEAD_COMMAND, law.STATIC_GAIN, law.REST_LEVEL)
    )
    above = gain * max(top - dead, 0.0)
    values = [
        _value(CURVE[0], law.DEAD_COMMAND, fit, blocks),
        _value(CURVE[1], law.STATIC_GAIN, fit, blocks),
        ParameterValue(CURVE[2], rest),
        ParameterValue(CURVE[3], top),
        ParameterValue(CURVE[4], rest + above),
    ]
    if law.DEAD_COMMAND in fit.free:
        return values
    commands, levels = settled(found.earlier)
    line = line_through(np.append(commands, top), np.append(levels, above))
    if line is None:
        reason = (
            f"one level of the command so far, {top:.3g}: a dead command and a gain look alike"
        )
        for i in (0, 1):
            values[i] = not_excited(CURVE[i], reason)
    else:
        values[0] = ParameterValue(CURVE[0], line[0])
        values[1] = ParameterValue(CURVE[1], above / max(top - line[0], 1e-9))
    return values
