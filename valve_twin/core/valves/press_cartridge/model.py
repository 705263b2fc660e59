# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The press cartridge valve: what is identified from one cycle, and how it predicts.

What a process that predicts does without, estimators and simulation, is imported where it is used:
a twin estimates in a process of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.interface import Demonstration
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.moved import with_tolerances
from valve_twin.core.valves.press_cartridge.diagnosis import features
from valve_twin.core.valves.press_cartridge.estimation.constraints import THETA
from valve_twin.core.valves.press_cartridge.estimators import KALMAN, NAME, OUTPUT_ERROR
from valve_twin.core.valves.press_cartridge.law import AsLaw, delay_of
from valve_twin.core.valves.press_cartridge.parameters import PARAMETERS, PressCartridgeOptions
from valve_twin.core.valves.press_cartridge.predictor import (
    COEFFICIENTS,
    LAG,
    LOW_SEAT,
    STATE,
    predict_block,
    set_gains,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import (
        Cycle,
        Estimate,
        FloatArray,
        Parameter,
        ParameterValue,
    )
    from valve_twin.core.valves.interface import Approximation

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

    name: str = NAME
    inputs: tuple[str, ...] = ("v_in", "v_out")
    output: str = "spool_position"
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: PressCartridgeOptions = field(default_factory=PressCartridgeOptions)
    kernel = predict_block
    state_size = STATE
    trend_estimator: str = OUTPUT_ERROR
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
        from valve_twin.core.valves.press_cartridge.cycle_estimates import estimates_of

        of = (self.trend_estimator, KALMAN)
        return with_tolerances(
            options, lambda o: estimates_of(cycle, o, earlier), of, absolute=True
        )

    def features(self, cycle: Cycle, options: PressCartridgeOptions) -> tuple[ParameterValue, ...]:
        """Return what the cycle shows of faults, see `diagnosis.features`."""
        from valve_twin.core.valves.press_cartridge.cycle_estimates import shown_features

        return shown_features(cycle, options)

    def signatures(self) -> SignatureTable:
        """Return how faults change the features, derived by simulation."""
        from valve_twin.core.valves.press_cartridge.diagnosis.offset import with_command_offset
        from valve_twin.core.valves.press_cartridge.diagnosis.outflow import with_weak_outflow
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
        from valve_twin.core.valves.press_cartridge.estimation.response.signals import signal_fault

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
        from valve_twin.core.valves.press_cartridge.plant import STRANGERS

        return STRANGERS

    def simulation(self) -> SimulationConfig:
        """Return the default simulation."""
        from valve_twin.core.valves.press_cartridge.plant import default_simulation

        return default_simulation()

    def approximations(
        self, simulation: SimulationConfig, commands: FloatArray, values: Mapping[str, float]
    ) -> tuple[Approximation, ...]:
        """Return rows (g) to (k) of paper 002, Table 5, as `ValveModel.approximations` says."""
        from valve_twin.core.valves.press_cartridge.approximations import press_approximations
        from valve_twin.core.valves.press_cartridge.plant import PressCartridgePlant

        plant = simulation.plant
        assert isinstance(plant, PressCartridgePlant)
        return press_approximations(plant, commands, simulation.period_s, values)

    def truth(self, simulation: SimulationConfig, cycle: int) -> Mapping[str, float]:
        """Return the true gains, K_out at the default v_ref, and leak, as `ValveModel.truth` says.

        A gain is that of its command alone: the leak, which slows inflow and speeds outflow up,
        is a parameter of its own.
        """
        from valve_twin.core.simulation.valve import SimulatedValve
        from valve_twin.core.valves.press_cartridge.truth import cycle_truth

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


MODEL = PressCartridgeModel()
