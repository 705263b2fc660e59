# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve that is a law plus data: everything a model has to bring follows from these."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.quantity import quantity, setting
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import Estimate, EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.core.valves.interface import ModelOptions
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.fit import fit_free_run
from valve_twin.core.valves.kit.law import Law, Lawful
from valve_twin.core.valves.kit.loops import MAX_LAG, memory_size
from valve_twin.core.valves.kit.outcome import Evidence, at_bound, conclude, not_excited, unexcited
from valve_twin.core.valves.kit.plant import simulation_of
from valve_twin.core.valves.kit.prediction import state_size
from valve_twin.core.valves.kit.record import take_record
from valve_twin.core.valves.kit.strangers import READ_OTHERWISE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import Cycle, FloatArray, Parameter
    from valve_twin.core.valves.kit.fit import Fit
    from valve_twin.core.valves.kit.plant import Program
    from valve_twin.core.valves.kit.record import Record

ESTIMATOR = "output_error"


@dataclass(frozen=True, slots=True)
class LawOptions(ModelOptions):
    """Options of a valve that is a law plus data."""

    max_lag: int = quantity(
        8, "samples", "longest command to output lag that is tried", 1, MAX_LAG
    )
    min_samples: int = quantity(100, "1", "a cycle of fewer usable samples is refused", 20, 1e6)
    min_motion: float = quantity(0.02, "1", "a cycle whose output moves less is refused", 0.0, 1e6)
    estimators: tuple[str, ...] = setting(
        (ESTIMATOR,), "estimators to run", choices=(ESTIMATOR, FEATURES)
    )


@dataclass(frozen=True)
class Valve(Lawful, CompiledModel):
    """A valve from a law of motion and a program of commands.

    Attributes
    ----------
    name : str
        Name in configurations, e.g. "first_order".
    inputs : tuple of str
        Signal names of the M commands.
    output : str
        Signal name of what is measured.
    law : Law
        Its law of motion with its parameters.
    program : Program, optional
        What the simulated valve is commanded; None = it cannot be simulated.
    normalised : bool
        Whether inputs and output are parts of their full scale: other values are then refused as a
        wrong scale.
    proposed_for : str
        Kind of record for which `configure` proposes it, as in `ValveModel`; empty = none.
    """

    name: str
    inputs: tuple[str, ...]
    output: str
    law: Law
    program: Program | None = None
    normalised: bool = True
    proposed_for: str = ""

    trend_estimator: str = ESTIMATOR
    options: LawOptions = field(default_factory=LawOptions)
    parameters: tuple[Parameter, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Publish the law's parameters."""
        object.__setattr__(self, "parameters", tuple(p.published for p in self.law.parameters))

    def estimate(
        self, cycle: Cycle, options: LawOptions, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate the law's parameters from one cycle by output error.

        Parameters
        ----------
        cycle : Cycle
            One cycle of N samples.
        options : LawOptions
            The model's options.
        earlier : sequence of Estimate
            Not used: nothing is pooled.

        Returns
        -------
        tuple of Estimate
            One estimate; REFUSED with its reason where the cycle says nothing.
        """
        del earlier
        max_lag = options.max_lag
        record = take_record(cycle, max_lag=max_lag)
        refusal = _refusal(record, max_lag, options)
        fit = None if refusal else fit_free_run(self.law, record, max_lag=max_lag)
        values = [_value(p, i, fit, refusal) for i, p in enumerate(self.parameters)]
        judged = (EstimateStatus.REFUSED, refusal) if refusal else unexcited(values)
        evidence = Evidence(record.counts)
        if fit is not None:
            evidence = Evidence(record.counts, condition=fit.condition, lag=fit.lag)
        return (conclude(self.name, ESTIMATOR, cycle, values, judged, evidence),)

    def coefficients(
        self, values: Mapping[str, float], lag: int, period_s: float, options: LawOptions
    ) -> FloatArray:
        """Return the P parameters, lag and sampling time, as `ValveModel.coefficients` says."""
        del options
        known = [values.get(p.name, np.nan) for p in self.parameters]
        return np.array([*known, float(lag), period_s])

    def initial_state(self) -> FloatArray:
        """Return the state before the first sample."""
        return np.zeros(state_size(self.law.states, memory_size(len(self.inputs))))

    def kernel_of(self, coefficients: FloatArray) -> Callable[..., None]:
        """Return the prediction loop of the law."""
        del coefficients
        return self.law.predict

    def strangers(self) -> Mapping[str, Mapping[str, object]]:
        """Return valves that are read otherwise than the options say."""
        return READ_OTHERWISE if self.program else {}

    def simulation(self) -> SimulationConfig | None:
        """Return the default simulation: a new valve under its program."""
        if self.program is None:
            return None
        return simulation_of(self.name, self.inputs, self.law, self.program)


def _refusal(record: Record, max_lag: int, options: LawOptions) -> str:
    n = int(np.count_nonzero(record.used))
    wanted = max(options.min_samples, 2 * max_lag)
    if n < wanted:
        text = f"{n} usable samples without a gap, fewer than {wanted} (min_samples)"
        return Refusal(RefusalCode.FEW_SAMPLES, text)
    output = record.output[record.used]
    span, least = float(np.ptp(output)), options.min_motion
    if span < least or span == 0.0:
        text = f"the output moved by {span:.3g}, less than min_motion {least:g}"
        return Refusal(RefusalCode.NO_MOTION, text)
    if not np.ptp(record.inputs, axis=0).any():
        text = f"the inputs stayed at {record.inputs[0]}: the cycle excites nothing"
        return Refusal(RefusalCode.NOT_EXCITED, text)
    return ""


def _value(parameter: Parameter, i: int, fit: Fit | None, refusal: str) -> ParameterValue:
    name = parameter.name
    if fit is None:
        return ParameterValue(name, np.nan, ParameterStatus.REFUSED, refusal)
    value, error, half = float(fit.values[i]), float(fit.errors[i]), float(fit.half_widths[i])
    if fit.at_bound[i]:
        return at_bound(name, value)
    if not np.isfinite(error):
        return not_excited(name, "the cycle does not determine it")
    lower, upper = max(value - half, parameter.lower), min(value + half, parameter.upper)
    return ParameterValue(name, value, ParameterStatus.OK, "", error, lower, upper)
