# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The hydraulic actuator: what is estimated from one cycle and how it predicts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import Estimate, MaskCounts, ParameterValue
from valve_twin.core.valves.hydraulic_actuator.fit import Record, Solution, fit_free_run
from valve_twin.core.valves.hydraulic_actuator.kernels import STATE_SIZE, predict_block
from valve_twin.core.valves.hydraulic_actuator.parameters import (
    ESTIMATOR,
    LIFT,
    LOWER,
    NAMES,
    PARAMETERS,
    HydraulicActuatorOptions,
)
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.outcome import (
    Evidence,
    at_bound,
    conclude,
    not_excited,
    refuse,
    unexcited,
)
from valve_twin.core.valves.kit.record import held, longest_whole

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import Cycle, FloatArray, Parameter

_AT_BOUND = 1e-6  # distance to a bound that counts as none, in units of the interval [1]


@dataclass(frozen=True, slots=True)
class HydraulicActuatorModel(CompiledModel):
    """Implements `ValveModel` for one valve opening and the load pressure."""

    name: str = "hydraulic_actuator"
    inputs: tuple[str, ...] = ("opening",)
    output: str = "pressure"
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: HydraulicActuatorOptions = field(default_factory=HydraulicActuatorOptions)
    kernel = predict_block
    state_size = STATE_SIZE
    trend_estimator: str = ESTIMATOR

    def estimate(
        self, cycle: Cycle, options: HydraulicActuatorOptions, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate flow curve, resonance, throttling and spool lag from one cycle.

        Parameters
        ----------
        cycle : Cycle
            One cycle of N samples.
        options : HydraulicActuatorOptions
            The model's options.
        earlier : sequence of Estimate
            Not used: nothing is pooled.

        Returns
        -------
        tuple of Estimate
            One estimate; REFUSED with its reason where the cycle says nothing.
        """
        del earlier
        record = _record(cycle)
        used = int(np.count_nonzero(record.used))
        refusal = _refusal(record, options)
        if refusal:
            evidence = Evidence(MaskCounts(0, bad=len(cycle.frames)))
            return (refuse(self.name, ESTIMATOR, cycle, NAMES, refusal, evidence),)
        solution = fit_free_run(record, shown=_shown(record, options))
        values = [_value(i, solution) for i in range(len(NAMES))]
        counts = MaskCounts(used, bad=len(cycle.frames) - used)
        evidence = Evidence(counts, solution.condition)
        return (conclude(self.name, ESTIMATOR, cycle, values, unexcited(values), evidence),)

    def coefficients(
        self,
        values: Mapping[str, float],
        lag: int,
        period_s: float,
        options: HydraulicActuatorOptions,
    ) -> FloatArray:
        """Return the (10,) coefficients, parameters as `ValveModel.coefficients`.

        What no cycle has shown of one direction is taken from the other.
        """
        del lag, options
        other = {LIFT[k]: LOWER[k] for k in LIFT} | {LOWER[k]: LIFT[k] for k in LOWER}
        known = {n: values.get(n, values.get(other.get(n, n), float("nan"))) for n in NAMES}
        return np.array([*(known[name] for name in NAMES), period_s])


def _record(cycle: Cycle) -> Record:
    """Return the longest stretch without a gap, from its first usable sample on."""
    part, used = longest_whole(cycle.frames, cycle.period_s)
    pressure, opening = held(part.position, used), held(part.inputs[:, 0], used)
    return Record(pressure, opening, used, cycle.period_s)


def _shown(record: Record, options: HydraulicActuatorOptions) -> tuple[bool, bool]:
    least = options.min_opening
    opening = record.opening[record.used]
    return bool(opening.max() >= least), bool(-opening.min() >= least)


def _refusal(record: Record, options: HydraulicActuatorOptions) -> str:
    used, wanted = int(np.count_nonzero(record.used)), options.min_samples
    if used < wanted:
        text = f"{used} usable samples without a gap, fewer than min_samples {wanted}"
        return Refusal(RefusalCode.FEW_SAMPLES, text)
    if float(np.ptp(record.pressure[record.used])) == 0.0:
        text = f"the pressure stayed at {record.pressure[0]:.4g}: the cycle shows nothing"
        return Refusal(RefusalCode.NO_MOTION, text)
    if not any(_shown(record, options)):
        least = options.min_opening
        text = f"the valve opened by less than min_opening {least:g}: the cycle excites nothing"
        return Refusal(RefusalCode.NOT_EXCITED, text)
    return ""


def _value(i: int, solution: Solution) -> ParameterValue:
    name, value = NAMES[i], float(solution.values[i])
    lift, lower = solution.shown
    if (not lift and name in LIFT.values()) or (not lower and name in LOWER.values()):
        return not_excited(name, "the valve did not open in this direction")
    span = solution.upper[i] - solution.lower[i]
    if min(value - solution.lower[i], solution.upper[i] - value) > _AT_BOUND * span:
        return ParameterValue(name, value)
    return at_bound(name, value)


MODEL = HydraulicActuatorModel()
