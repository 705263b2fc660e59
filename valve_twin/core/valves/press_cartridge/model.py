# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The press cartridge valve: what is identified from one cycle, and how it predicts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.diagnosis.features import FeatureSet
from valve_twin.core.estimation.data.masks import Masks, find_masks
from valve_twin.core.estimation.data.noise import rest_noise
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.types import (
    Cycle,
    Estimate,
    EstimateStatus,
    FloatArray,
    Guard,
    MaskCounts,
    Parameter,
    ParameterValue,
)
from valve_twin.core.valves.interface import Demonstration
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.moved import with_tolerances
from valve_twin.core.valves.press_cartridge.approximations import press_approximations
from valve_twin.core.valves.press_cartridge.diagnosis import features
from valve_twin.core.valves.press_cartridge.diagnosis.offset import with_command_offset
from valve_twin.core.valves.press_cartridge.diagnosis.outflow import with_weak_outflow
from valve_twin.core.valves.press_cartridge.estimation import kalman, output_error
from valve_twin.core.valves.press_cartridge.estimation.constraints import THETA
from valve_twin.core.valves.press_cartridge.estimation.equation_error import (
    ESTIMATORS as EQUATION_ERROR,
)
from valve_twin.core.valves.press_cartridge.estimation.equation_error import fit_equation_error
from valve_twin.core.valves.press_cartridge.estimation.guards import check_gap
from valve_twin.core.valves.press_cartridge.estimation.kalman import fit_kalman, pool_ratios
from valve_twin.core.valves.press_cartridge.estimation.lag import LagScan, scan_lag
from valve_twin.core.valves.press_cartridge.estimation.output_error import fit_output_error
from valve_twin.core.valves.press_cartridge.estimation.response.accuracy import scatter_halves
from valve_twin.core.valves.press_cartridge.estimation.response.signals import signal_fault
from valve_twin.core.valves.press_cartridge.estimation.response.timing import (
    Timing,
    pool_timing,
    timings_alone,
)
from valve_twin.core.valves.press_cartridge.estimator_options import (
    equation_error_options,
    feature_options,
    guard_options,
    mask_options,
    output_error_options,
)
from valve_twin.core.valves.press_cartridge.law import AsLaw, delay_of
from valve_twin.core.valves.press_cartridge.parameters import PARAMETERS, PressCartridgeOptions
from valve_twin.core.valves.press_cartridge.plant import (
    STRANGERS,
    PressCartridgePlant,
    default_simulation,
)
from valve_twin.core.valves.press_cartridge.predictor import (
    COEFFICIENTS,
    LAG,
    LOW_SEAT,
    STATE,
    predict_block,
    set_gains,
)
from valve_twin.core.valves.press_cartridge.truth import cycle_truth

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.valves.interface import Approximation

_PUSH = (1.0, -1.0)

_SHARP = 0.005
"""Least relative rise of the one-step error at any other lag that settles the lag, assumed.

Below it the one-step error cannot decide and the free run decides. The free run alone prefers one
sample less with a slow pole in a fifth of the cycles that begin with the command (noise 1e-3),
which moves K_out by 4 %.
"""


_SHOWN = Demonstration(
    namespace="/press/valve_1",
    label="press",
    followed="K_in",
    aging_rate=-0.002,
    cycles=70,
    rate=20.0,
    batched=False,
)


@dataclass(frozen=True, slots=True)
class PressCartridgeModel(AsLaw, CompiledModel):
    """Implements `ValveModel` for the two-stage cartridge valve of paper 002."""

    name: str = "press_cartridge"
    inputs: tuple[str, ...] = ("v_in", "v_out")
    output: str = "spool_position"
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: PressCartridgeOptions = field(default_factory=PressCartridgeOptions)
    kernel = predict_block
    state_size = STATE
    trend_estimator: str = output_error.ESTIMATOR
    normalised: bool = True
    budget_estimator: str = "equation_error_qp4"  # that of the paper
    approximation_rows: int = 5
    proposed_for: str = "driven"
    demonstration: Demonstration = _SHOWN
    feature_set: FeatureSet = features.FEATURE_SET

    def estimate(
        self, cycle: Cycle, options: PressCartridgeOptions, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate the cycle with every configured estimator, the output error unless it is off.

        Parameters
        ----------
        cycle : Cycle
            One cycle of N samples (N > 0).
        options : PressCartridgeOptions
            The model's options.
        earlier : sequence of Estimate
            Those of the cycles before, oldest first; their noise ratios are pooled.

        Returns
        -------
        tuple of Estimate
            One an estimator; REFUSED with its reason where the cycle says nothing.
        """
        of = (self.trend_estimator, kalman.ESTIMATOR)
        return with_tolerances(
            options, lambda o: self._exact(cycle, o, earlier), of, absolute=True
        )

    def _exact(
        self, cycle: Cycle, options: PressCartridgeOptions, earlier: Sequence[Estimate]
    ) -> tuple[Estimate, ...]:
        """Estimate with constants that are known exactly."""
        frames = cycle.frames
        masks = find_masks(frames, cycle.period_s, push=_PUSH, options=mask_options(options))
        sigma = rest_noise(frames, masks, active_command=options.active_command).sigma
        scan = _scan(cycle, masks, options)
        always = (self.trend_estimator,) if options.output_error else ()
        names = dict.fromkeys((*always, *options.estimators))
        results: list[Estimate] = []
        for name in names:
            if name == FEATURES:
                results.append(self._features(cycle, masks, sigma, options))
            elif name in EQUATION_ERROR:
                results.append(self._equation_error(name, cycle, masks, sigma, scan, options))
            else:
                timing = _timing_of(results)
                results.append(
                    self._gains(name, cycle, masks, sigma, scan, options, earlier, timing)
                )
        return _with_gap(results, options)

    def features(self, cycle: Cycle, options: PressCartridgeOptions) -> tuple[ParameterValue, ...]:
        """Return what the cycle shows of faults, see `diagnosis.features`."""
        mask = mask_options(options)
        masks = find_masks(cycle.frames, cycle.period_s, push=_PUSH, options=mask)
        return features.cycle_features(
            cycle.frames, masks, cycle.period_s, feature_options(options)
        )

    def signatures(self) -> SignatureTable:
        """Return how faults change the features, derived by simulation."""
        from valve_twin.core.valves.press_cartridge.diagnosis.signatures import TABLE

        return with_weak_outflow(with_command_offset(TABLE))

    def judges(self, options: PressCartridgeOptions) -> bool:
        """Tell whether estimates are judged by the cycles before: not without the output error."""
        return options.output_error

    def input_fault(self, cycle: Cycle, options: PressCartridgeOptions) -> str:
        """Return why the signals cannot be those of a press valve, empty where they can.

        Parameters
        ----------
        cycle : Cycle
            At least one sample.
        options : PressCartridgeOptions
            The model's options.
        """
        return signal_fault(self.output, self.inputs, cycle, options)

    def coefficients(
        self,
        values: Mapping[str, float],
        lag: int,
        period_s: float,
        options: PressCartridgeOptions,
    ) -> FloatArray:
        """Return the (16,) coefficients, parameters as `ValveModel.coefficients`.

        They come from gains or from theta; NaN stands where a gain that the prediction needs has
        never been estimated.
        """
        c = np.zeros(COEFFICIENTS)
        if "theta_1" in values:
            c[:8] = [values.get(name, 0.0) for name in THETA]
        else:
            set_gains(c, values, period_s, options.v_ref)
        c[LAG] = delay_of(values, lag)
        c[LOW_SEAT:] = [
            options.lower_seat,
            options.upper_seat,
            options.seat_margin,
            options.v_offset_in,
            options.v_offset_out,
            options.active_command,
        ]
        return c

    def strangers(self) -> Mapping[str, Mapping[str, object]]:
        """Return valves that are not as the options say."""
        return STRANGERS

    def simulation(self) -> SimulationConfig:
        """Return the default simulation."""
        return default_simulation()

    def approximations(
        self, simulation: SimulationConfig, commands: FloatArray, values: Mapping[str, float]
    ) -> tuple[Approximation, ...]:
        """Return rows (g) to (k) of paper 002, Table 5, as `ValveModel.approximations` says."""
        plant = simulation.plant
        assert isinstance(plant, PressCartridgePlant)
        return press_approximations(plant, commands, simulation.period_s, values)

    def truth(self, simulation: SimulationConfig, cycle: int) -> Mapping[str, float]:
        """Return the true gains, K_out at the default v_ref, and leak, as `ValveModel.truth` says.

        A gain is that of its command alone: the leak, which slows inflow and speeds outflow up,
        is a parameter of its own.
        """
        known, v_ref = cycle_truth(simulation, cycle), self.options.v_ref
        valve = SimulatedValve(simulation)
        out = valve.steady_gain(cycle, v_ref, input_index=1)
        leak = abs(valve.aged_plant(cycle).steady_rate(np.zeros(len(self.inputs))))
        lost = leak * simulation.period_s
        return {
            "K_in": float(known.gains[0] + lost / known.commands[0]),
            "K_out": out - lost / v_ref,
            "leak": leak,
        }

    def _gains(
        self,
        name: str,
        cycle: Cycle,
        masks: Masks,
        sigma: float,
        scan: LagScan,
        options: PressCartridgeOptions,
        earlier: Sequence[Estimate],
        timing: Timing | None,
    ) -> Estimate:
        settled = scan.lag >= 0 and scan.sharpness >= _SHARP
        chosen = output_error_options(options, scan.lag if settled else -1)
        data = (cycle.frames, masks, cycle.period_s)
        before = [e for e in earlier if e.estimator == name]
        if name == kalman.ESTIMATOR:
            ratios = pool_ratios(np.array([e.value("noise_ratio") for e in before]))
            fit = fit_kalman(
                *data,
                noise_sigma=sigma,
                pooled=ratios,
                timing=timing,
                scatter=scatter_halves(before),
                options=chosen,
            )
        else:
            pooled = pool_timing(timings_alone(before))
            fit = fit_output_error(*data, noise_sigma=sigma, pooled=pooled, options=chosen)
        return self._estimate(
            name,
            cycle,
            fit.parameters,
            (fit.status, fit.reason),
            fit.condition_number,
            fit.lag,
            sigma,
            fit.counts,
            fit.guards,
        )

    def _features(
        self, cycle: Cycle, masks: Masks, sigma: float, options: PressCartridgeOptions
    ) -> Estimate:
        shown = features.cycle_features(
            cycle.frames, masks, cycle.period_s, feature_options(options)
        )
        count = sum(p.usable for p in shown)
        whole = count == len(shown)
        status = EstimateStatus.ACCEPTED if whole else EstimateStatus.PARTIAL
        reason = f"{count} of {len(shown)} features of faults are shown"
        counts = MaskCounts(
            int(np.count_nonzero(~masks.any)),
            seat=int(np.count_nonzero(masks.seat)),
            stuck=int(np.count_nonzero(masks.stuck)),
            stale=int(np.count_nonzero(masks.stale)),
            bad=int(np.count_nonzero(masks.bad)),
        )
        return self._estimate(FEATURES, cycle, shown, (status, reason), np.nan, 0, sigma, counts)

    def _equation_error(
        self,
        name: str,
        cycle: Cycle,
        masks: Masks,
        sigma: float,
        scan: LagScan,
        options: PressCartridgeOptions,
    ) -> Estimate:
        fit = fit_equation_error(
            cycle.frames,
            masks,
            name,
            lag=scan.lag,
            noise_sigma=sigma,
            options=equation_error_options(options),
        )
        return self._estimate(
            name,
            cycle,
            fit.parameters,
            (fit.status, fit.reason),
            fit.condition_number,
            max(fit.lag, 0),
            sigma,
            fit.counts,
        )

    def _estimate(
        self,
        estimator: str,
        cycle: Cycle,
        parameters: tuple[ParameterValue, ...],
        verdict: tuple[EstimateStatus, str],
        condition_number: float,
        lag: int,
        sigma: float,
        counts: MaskCounts,
        guards: tuple[Guard, ...] = (),
    ) -> Estimate:
        return Estimate(
            model=self.name,
            estimator=estimator,
            parameters=parameters,
            status=verdict[0],
            reason=verdict[1],
            condition_number=condition_number,
            lag=lag,
            noise_sigma=sigma,
            counts=counts,
            used_by_trend=estimator == self.trend_estimator,
            guards=guards,
            **cycle.origin,
        )


def _timing_of(results: Sequence[Estimate]) -> Timing | None:
    """Return delay and pole that the output error found of the same cycle."""
    found = next((e for e in results if e.estimator == output_error.ESTIMATOR), None)
    if found is None or not np.isfinite(found.value("delay") + found.value("pole")):
        return None
    delay = found.value("delay")
    return Timing(delay, found.value("pole"), pooled=delay != found.value("delay_alone"))


def _with_gap(
    estimates: Sequence[Estimate], options: PressCartridgeOptions
) -> tuple[Estimate, ...]:
    """Hold the gains against those of the equation error, where that was run."""
    paper = next((e for e in estimates if e.estimator in EQUATION_ERROR), None)
    if paper is None or not any(e.guards for e in estimates):
        return tuple(estimates)
    theta = {p.name: p.value for p in paper.parameters}
    v_ref, guard = options.v_ref, guard_options(options)
    return tuple(
        replace(
            e,
            guards=(
                *e.guards,
                *check_gap({p.name: p.value for p in e.parameters}, theta, v_ref, guard),
            ),
        )
        if e.guards
        else e
        for e in estimates
    )


def _scan(cycle: Cycle, masks: Masks, options: PressCartridgeOptions) -> LagScan:
    """Find the lag, or take the configured one as settled."""
    lag, max_lag = options.lag, options.max_lag
    if lag >= 0:
        return LagScan(lag, np.full(max_lag + 1, np.nan), np.inf)
    return scan_lag(cycle.frames, masks, max_lag=max_lag)


MODEL = PressCartridgeModel()
