# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The positioner model: what is estimated from one cycle and how it predicts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import (
    BoolArray,
    ByteArray,
    Cycle,
    Estimate,
    EstimateStatus,
    FloatArray,
    MaskCounts,
    Parameter,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.core.valves.interface import Option, Options
from valve_twin.core.valves.positioner.fit import Record, Solution, bounds, fit_free_run
from valve_twin.core.valves.positioner.kernels import MAX_LAG, STATE_SIZE, predict_block

if TYPE_CHECKING:
    from collections.abc import Mapping

_MIN_DRIVEN = 5
"""Fewest samples in which a parameter must have moved the spool to be reported [A]."""

_ESTIMATOR = "output_error"
_NAMES = ("rate_rising", "rate_falling", "slew_rising", "slew_falling", "dead_band")

PARAMETERS = (
    Parameter(
        "rate_rising",
        "1/s",
        "speed per distance to the command, rising position [A]",
        0.0,
        trend=True,
    ),
    Parameter("rate_falling", "1/s", "the same, falling position [A]", 0.0, trend=True),
    Parameter("slew_rising", "1/s", "largest speed, rising position [A]", 0.0, trend=True),
    Parameter("slew_falling", "1/s", "largest speed, falling position [A]", 0.0, trend=True),
    Parameter("dead_band", "1", "distance to the command that moves nothing [A]", 0.0, trend=True),
    Parameter("delay", "s", "command to position delay, whole samples [A]", 0.0),
)

OPTIONS = (
    Option("max_delay_s", 0.5, "longest delay tried [A]", "s", 0.0, 60.0),
    Option("max_dead_band", 0.05, "upper bound of the dead band [A]", "1", 0.0, 1.0),
    Option("min_motion", 0.02, "a cycle that moves less is refused [A]", "1", 0.0, 1.0),
    Option("lower_stop", -0.1, "mechanical stop of falling position", "1", -10.0, 10.0),
    Option("upper_stop", 1.1, "mechanical stop of rising position", "1", -10.0, 10.0),
    Option("estimators", [_ESTIMATOR], "estimators to run", choices=(_ESTIMATOR,)),
)


@dataclass(frozen=True, slots=True)
class PositionerModel:
    """Implements `ValveModel` for one command and one position."""

    name: str = "positioner"
    inputs: tuple[str, ...] = ("command",)
    output: str = "position"
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: tuple[Option, ...] = OPTIONS
    trend_estimator: str = _ESTIMATOR

    def estimate(self, cycle: Cycle, options: Options) -> tuple[Estimate, ...]:
        """Estimate rates, slew limits, dead band and delay from one cycle by output error.

        Parameters
        ----------
        cycle : Cycle
            One cycle of N samples.
        options : mapping
            The model's options, complete.

        Returns
        -------
        tuple of Estimate
            One estimate; REFUSED with its reason where the cycle says nothing.
        """
        record, bad = _record(cycle, options)
        max_lag = _max_lag(options, cycle.period_s)
        refusal = _refusal(record, max_lag, options)
        if refusal:
            return (_refused(self.name, cycle, refusal, bad),)
        solution = fit_free_run(
            record, max_lag=max_lag, max_dead_band=_number(options, "max_dead_band")
        )
        return (_accepted(self.name, cycle, record, solution, bad, options),)

    def coefficients(
        self, values: Mapping[str, float], lag: int, period_s: float, options: Options
    ) -> FloatArray:
        """Return the 9 coefficients of `predict`; what no cycle has shown does not limit it.

        A rate known in one direction only serves both; an unknown slew limit is one stroke a
        sample.
        """
        fastest = 1.0 / period_s
        rising = values.get("rate_rising", values.get("rate_falling", fastest))
        return np.array(
            [
                rising,
                values.get("rate_falling", rising),
                values.get("slew_rising", fastest),
                values.get("slew_falling", fastest),
                values.get("dead_band", 0.0),
                period_s,
                float(lag),
                _number(options, "lower_stop"),
                _number(options, "upper_stop"),
            ]
        )

    def initial_state(self) -> FloatArray:
        """Return the state before the first sample."""
        return np.zeros(STATE_SIZE)

    def predict(
        self,
        state: FloatArray,
        coefficients: FloatArray,
        position: FloatArray,
        inputs: FloatArray,
        restart: ByteArray,
        predicted: FloatArray,
        simulated: FloatArray,
        validity: ByteArray,
    ) -> None:
        """Predict a block of samples; see `ValveModel.predict`."""
        predict_block(
            state, coefficients, position, inputs, restart, predicted, simulated, validity
        )


def _number(options: Options, name: str) -> float:
    value = options[name]
    assert isinstance(value, (int, float))  # checked when the configuration was read
    return float(value)


def _max_lag(options: Options, period_s: float) -> int:
    return min(max(1, round(_number(options, "max_delay_s") / period_s)), MAX_LAG)


def _record(cycle: Cycle, options: Options) -> tuple[Record, int]:
    """Take the longest stretch without a gap; hold commands over unusable samples."""
    frames = cycle.frames
    steps = np.diff(frames.stamp_ns) > 1.5e9 * cycle.period_s
    edges = np.concatenate(([0], np.flatnonzero(steps) + 1, [len(frames)]))
    longest = int(np.argmax(np.diff(edges)))
    part = frames[int(edges[longest]) : int(edges[longest + 1])]
    usable = part.valid & np.isfinite(part.position)
    first = int(np.argmax(usable)) if usable.any() else 0
    part, usable = part[first:], usable[first:]
    command = _held(part.inputs[:, 0], np.isfinite(part.inputs[:, 0]))
    record = Record(
        position=_held(part.position, usable),
        command=command,
        used=np.ascontiguousarray(usable),
        period_s=cycle.period_s,
        stops=np.array([_number(options, "lower_stop"), _number(options, "upper_stop")]),
    )
    return record, len(frames) - int(np.count_nonzero(usable))


def _held(values: FloatArray, known: BoolArray) -> FloatArray:
    index = np.maximum.accumulate(np.where(known, np.arange(len(values)), 0))
    return np.nan_to_num(values[index], nan=0.0, posinf=0.0, neginf=0.0)


def _refusal(record: Record, max_lag: int, options: Options) -> str:
    n = int(np.count_nonzero(record.used))
    least = max_lag + 20
    if n < least:
        return f"{n} usable samples without a gap, fewer than the {least} a fit needs"
    span = float(np.ptp(record.position[record.used]))
    wanted = _number(options, "min_motion")
    if span < wanted:
        return f"the position moved by {span:.3g} of the stroke, less than min_motion {wanted:g}"
    if float(np.ptp(record.command)) == 0.0:
        return f"the command stayed at {record.command[0]:.3g}: the cycle excites nothing"
    return ""


def _accepted(
    model: str,
    cycle: Cycle,
    record: Record,
    solution: Solution,
    bad: int,
    options: Options,
) -> Estimate:
    upper = bounds(record.period_s, _number(options, "max_dead_band"))[1]
    values = [
        _value(name, float(p), float(limit), int(driven))
        for name, p, limit, driven in zip(
            _NAMES, solution.parameters, upper, solution.active, strict=True
        )
    ]
    values.append(ParameterValue("delay", solution.lag * record.period_s))
    withheld = [v.name for v in values if not np.isfinite(v.value)]
    status = EstimateStatus.PARTIAL if withheld else EstimateStatus.ACCEPTED
    return Estimate(
        model=model,
        estimator=_ESTIMATOR,
        cycle=cycle.number,
        start_ns=cycle.start_ns,
        end_ns=cycle.end_ns,
        parameters=tuple(values),
        status=status,
        reason=f"not excited: {', '.join(withheld)}" if withheld else "accepted",
        condition_number=_condition(solution),
        lag=solution.lag,
        counts=MaskCounts(used=int(np.count_nonzero(record.used)), bad=bad),
        missed_cycles=cycle.missed_cycles,
        reproducible=cycle.reproducible,
    )


def _value(name: str, value: float, upper: float, driven: int) -> ParameterValue:
    if name == "dead_band":
        at_bound = value <= 0.0 or value >= upper
        reason = f"rests on its bound {value:.3g}" if at_bound else ""
    elif driven < _MIN_DRIVEN:
        reason = f"{driven} samples moved by it, fewer than {_MIN_DRIVEN}"
        return ParameterValue(name, np.nan, ParameterStatus.NOT_EXCITED, reason)
    else:
        at_bound = value >= upper or value <= 0.0
        reason = (
            f"rests on its bound {value:.3g} 1/s: faster than the sampling shows"
            if at_bound
            else ""
        )
    status = ParameterStatus.AT_BOUND if at_bound else ParameterStatus.OK
    return ParameterValue(name, value, status, reason)


def _condition(solution: Solution) -> float:
    """Return the condition number of the column-scaled sensitivities of what is excited."""
    scale = np.sqrt(np.diag(solution.hessian))
    seen = scale > 0
    if not seen.any():
        return float("nan")
    scaled = solution.hessian[np.ix_(seen, seen)] / np.outer(scale[seen], scale[seen])
    return float(np.sqrt(np.linalg.cond(scaled)))


def _refused(model: str, cycle: Cycle, reason: str, bad: int) -> Estimate:
    blank = [
        ParameterValue(n, np.nan, ParameterStatus.REFUSED, reason) for n in (*_NAMES, "delay")
    ]
    return Estimate(
        model=model,
        estimator=_ESTIMATOR,
        cycle=cycle.number,
        start_ns=cycle.start_ns,
        end_ns=cycle.end_ns,
        parameters=tuple(blank),
        status=EstimateStatus.REFUSED,
        reason=reason,
        counts=MaskCounts(used=0, bad=bad),
        missed_cycles=cycle.missed_cycles,
        reproducible=cycle.reproducible,
    )


MODEL = PositionerModel()
