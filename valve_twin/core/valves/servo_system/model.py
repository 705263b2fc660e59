# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The model of the servosystem: what is estimated from one cycle and how it predicts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import NORMAL_975
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import (
    Estimate,
    EstimateStatus,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.core.valves.interface import Demonstration, Scale
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.outcome import (
    Evidence,
    at_bound,
    conclude,
    not_excited,
    refuse,
    withheld,
)
from valve_twin.core.valves.kit.tolerances import tolerated
from valve_twin.core.valves.servo_system.bench_fits import BENCH_FITS
from valve_twin.core.valves.servo_system.constants import (
    HOPELESS,
    VISCOSITY,
    Known,
    open_constants,
    recall,
    with_constants,
)
from valve_twin.core.valves.servo_system.fit import KNOWN, WARMING, LoopFit, fit_loop
from valve_twin.core.valves.servo_system.parameters import (
    CONSTANTS,
    ESTIMATOR,
    NAMES,
    PARAMETERS,
    ServoSystemOptions,
    numbers,
    refusal_of,
    sensors,
)
from valve_twin.core.valves.servo_system.plant import STRANGERS, default_simulation
from valve_twin.core.valves.servo_system.plant_kernel import INPUTS
from valve_twin.core.valves.servo_system.predictor import N_COEFFICIENTS, STATE_SIZE, predict_block
from valve_twin.core.valves.servo_system.record import Record, excitation_of, take_record

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import Cycle, FloatArray, Parameter
    from valve_twin.core.valves.bench_fit import BenchFit


_SHOWN = Demonstration(cycles=24, rate=2.0, counter=True)  # an estimation takes 1.2 s


@dataclass(frozen=True, slots=True)
class ServoSystemModel(CompiledModel):
    """Implements `ValveModel` for the servosystem of paper 003."""

    name: str = "servo_system"
    inputs: tuple[str, ...] = INPUTS
    output: str = "piston_position"
    driven_by: tuple[str, ...] = INPUTS[:1]  # what is wanted: the loop is the model's own
    parameters: tuple[Parameter, ...] = (*PARAMETERS, *CONSTANTS)
    options: ServoSystemOptions = field(default_factory=ServoSystemOptions)
    kernel = predict_block
    state_size = STATE_SIZE
    follows = "desired_position"
    reach_s = 0.1
    trend_estimator: str = ESTIMATOR
    normalised: bool = True
    demonstration: Demonstration = _SHOWN

    def estimate(
        self, cycle: Cycle, options: ServoSystemOptions, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate what one cycle shows of the parameters.

        Parameters
        ----------
        cycle : Cycle
            One cycle of moves that begins at rest, sampled every 2 ms or faster.
        options : ServoSystemOptions
            The model's options.
        earlier : sequence of Estimate
            The search begins at the last of them: it ends where the cycle says.

        Returns
        -------
        tuple of Estimate
            One estimate; REFUSED with its reason where the cycle says nothing.
        """
        refusal = refusal_of(options)
        record = None
        if not refusal:
            record, refusal = take_record(cycle)
        if record is not None:
            refusal = excitation_of(record, options)
        if record is None or refusal:
            return (_refused(cycle, refusal),)
        kept = recall(earlier, tolerated(options), options)
        told, fit = _fitted(record, options, kept, _guess(earlier))
        refusal = fit.failed or _misfit(fit, options) or told.contradiction
        if refusal:
            return (_refused(cycle, refusal, fit),)
        return (_accepted(cycle, record, fit, told, options.max_error),)

    def scales(self, options: ServoSystemOptions) -> dict[str, Scale]:
        """Return units of measured signals, as `ValveModel.scales`."""
        stroke = 1e3 * options.stroke
        place = Scale("mm", stroke, 0.0, f"0 = piston in, {stroke:g} = out")
        pressure = Scale("MPa", 1e-6 * options.pressure_scale)
        return {
            self.output: place,
            "desired_position": place,
            "load_position": place,
            "current": Scale("mA", 1e3 * options.current_scale),
            "valve_position": Scale("µm", 1e6 * options.valve_scale, 0.0, "0 = centre"),
            "supply_line_pressure": pressure,
            "pressure_1": pressure,
            "pressure_2": pressure,
            "return_line_pressure": Scale("MPa", 1e-6 * options.return_scale),
            "load_speed": Scale("m/s", options.speed_scale),
        }

    def bench_fits(self) -> tuple[BenchFit, ...]:
        """Return the kinds of bench records, as `ValveModel.bench_fits`."""
        return BENCH_FITS

    def coefficients(
        self, values: Mapping[str, float], lag: int, period_s: float, options: ServoSystemOptions
    ) -> FloatArray:
        """Return the coefficients, parameters as `ValveModel.coefficients`.

        What is not estimated comes from the options.
        """
        del lag
        if refusal_of(options):
            return np.full(N_COEFFICIENTS, np.nan)
        return np.append(numbers(options, values), period_s)

    def strangers(self) -> Mapping[str, Mapping[str, object]]:
        """Return valves that are not as the options say."""
        return STRANGERS

    def simulation(self) -> SimulationConfig:
        """Return the default simulation."""
        return default_simulation()


def _guess(earlier: Sequence[Estimate]) -> FloatArray | None:
    """Return the parameters of the last cycle that was not refused, (12,), NaN where unknown."""
    for estimate in reversed(earlier):
        if estimate.estimator == ESTIMATOR and estimate.status is not EstimateStatus.REFUSED:
            return np.array([estimate.value(name) for name in NAMES])
    return None


def _fitted(
    record: Record, options: ServoSystemOptions, kept: Known, guess: FloatArray | None
) -> tuple[Known, LoopFit]:
    """Return what is known of the constants, and the fit with it.

    They are found anew where no cycle has shown them, or has shown all that this one tells.
    """
    start, limit = (numbers(options, {}), sensors(options)), options.max_error
    warming = WARMING if VISCOSITY in kept.constants.names else KNOWN
    known = with_constants(*start, kept.constants, kept.found)
    fit = fit_loop(record, *known, max_error=limit, guess=guess, warming=warming)
    settled = not kept.missing(fit.estimated) or not fit.misfit < HOPELESS
    if fit.failed or settled:
        return kept, fit
    opened = open_constants(record, start, kept, fit, limit)
    if opened is None:
        text = "no interval: the simulation fails in the search of the constants with a tolerance"
        return replace(kept, contradiction=Refusal(RefusalCode.NO_CONVERGENCE, text)), fit
    known = with_constants(*start, opened.constants, opened.found)
    fit = fit_loop(record, *known, max_error=limit, guess=opened.parameters, warming=warming)
    return opened.beyond(fit.errors / fit.values), fit


def _misfit(fit: LoopFit, options: ServoSystemOptions) -> str:
    limit = options.max_misfit
    if fit.misfit <= limit:
        return ""
    text = (
        f"the loop leaves {fit.misfit:.2g} times the noise of the signals, more than max_misfit "
        f"{limit:g}, most in {fit.worst} ({fit.worst_misfit:.2g}): the cycle does not begin at "
        "rest, an option is wrong beyond its tolerance or a fault is not in the equations"
    )
    return Refusal(RefusalCode.MISFIT, text)


def _value(fit: LoopFit, known: Known, i: int, max_error: float) -> ParameterValue:
    name, value, error = NAMES[i], float(fit.values[i]), float(fit.errors[i])
    if not fit.estimated[i] or error > max_error * value:
        share = f"{100.0 * error / value:.0f} %" if np.isfinite(error) and value > 0.0 else "none"
        reason = f"not told by this cycle: standard error {share} of {value:.3g}"
        return not_excited(name, reason)
    if fit.at_bound[i]:
        return at_bound(name, value)
    half = NORMAL_975 * float(np.hypot(error, known.alike[i] * value))
    low, high = max(value - half, PARAMETERS[i].lower), min(value + half, PARAMETERS[i].upper)
    return ParameterValue(name, value, ParameterStatus.OK, known.limits[i], error, low, high)


def _accepted(
    cycle: Cycle, record: Record, fit: LoopFit, known: Known, max_error: float
) -> Estimate:
    values = [_value(fit, known, i, max_error) for i in range(len(NAMES))]
    counts = MaskCounts(len(record.wanted) - record.bad, bad=record.bad)
    evidence = Evidence(counts, fit.condition, float(record.sigma[0]))
    judged = withheld(values, "not told")
    values += known.published(fit.warmed)
    return conclude("servo_system", ESTIMATOR, cycle, values, judged, evidence)


def _refused(cycle: Cycle, reason: str, fit: LoopFit | None = None) -> Estimate:
    condition = np.nan if fit is None else fit.condition
    evidence = Evidence(MaskCounts(0, bad=len(cycle.frames)), condition)
    return refuse("servo_system", ESTIMATOR, cycle, NAMES, reason, evidence)


MODEL = ServoSystemModel()
