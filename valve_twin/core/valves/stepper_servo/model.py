# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The stepper valve's model: what is estimated from one cycle and how it predicts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.generic.features import feature_set
from valve_twin.core.estimation.recursive.estimator import Adaptation, Structure, project_stable
from valve_twin.core.estimation.solvers.least_squares import gram_condition
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import Estimate, EstimateStatus, MaskCounts
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.moved import with_tolerances
from valve_twin.core.valves.kit.outcome import Evidence, conclude, refuse, unexcited, withheld
from valve_twin.core.valves.stepper_servo.fit import end_offset
from valve_twin.core.valves.stepper_servo.law import AsLaw, delay_of
from valve_twin.core.valves.stepper_servo.outcome import Settings, mechanics, wiener
from valve_twin.core.valves.stepper_servo.parameters import (
    FITS,
    FLOW,
    MECHANICS,
    PARAMETERS,
    THETA,
    THREAD,
    WIENER,
    StepperServoOptions,
)
from valve_twin.core.valves.stepper_servo.plant import (
    STRANGERS,
    StepperServoPlant,
    check_period,
    default_simulation,
)
from valve_twin.core.valves.stepper_servo.predictor import (
    COEFFICIENTS,
    MAX_LAG,
    STATE_SIZE,
    predict_block,
)
from valve_twin.core.valves.stepper_servo.record import (
    longest_delay,
    misfit,
    refusal_of,
    rest_noise,
    take_record,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import Cycle, FloatArray, Parameter

_NAMES = {MECHANICS: (*THREAD, *FLOW), WIENER: (*THETA, THREAD[3], *FITS)}


_STEP = StepperServoOptions().step_size
FEATURE_SET = feature_set(
    exclude=("saturated",),  # no input is a command with an end
    least={
        "level_zero": _STEP,
        "level_gain": _STEP,
        "level_bend": 0.5 * _STEP,
        "gain_up": 2.0 * _STEP,
        "gain_down": 4.0 * _STEP,
        "lag_up": 1.5e-3,
        "lag_down": 1.5e-3,
        "slow_up": 6e-3,
        "slow_down": 6e-3,
        "short_up": _STEP,
        "short_down": _STEP,
        "stick": 0.5 * _STEP,
        "rough_rest": 0.8,
        "rough_move": 0.8,
    },
)
"""Features of any valve. As the backlash grows, the motor stops a step earlier from some cycle on,
or goes a step beyond and back: where the spool rests, how far and how late it moves changes by
about a step then, and no wear is sudden (seeds 73000 to 73009)."""


@dataclass(frozen=True, slots=True)
class StepperServoModel(AsLaw, CompiledModel):
    """Implements `ValveModel` for the stepper-driven servo-valve of paper 004."""

    name: str = "stepper_servo"
    inputs: tuple[str, ...] = ("motor_position", "flow")
    output: str = "spool_position"
    driven_by: tuple[str, ...] = ("motor_position",)
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: StepperServoOptions = field(default_factory=StepperServoOptions)
    kernel = predict_block
    state_size = STATE_SIZE
    follows = "motor_position"
    reach_s = 0.2
    trend_estimator: str = MECHANICS
    normalised: bool = True
    feature_set: FeatureSet = FEATURE_SET

    def estimate(
        self, cycle: Cycle, options: StepperServoOptions, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate backlash, dead band, lost steps and the Hammerstein-Wiener model of a cycle.

        Parameters
        ----------
        cycle : Cycle
            One cycle of N samples.
        options : StepperServoOptions
            The model's options.
        earlier : sequence of Estimate
            Those of the cycles before: the recursive model goes on from its last parameters.

        Returns
        -------
        tuple of Estimate
            One an estimator; REFUSED with its reason where the cycle says nothing.
        """

        def known(changed: StepperServoOptions) -> tuple[Estimate, ...]:
            share = changed.step_size / options.step_size
            return self._exact(_counted(cycle, share), changed, earlier)

        return with_tolerances(options, known, (MECHANICS,))

    def _exact(
        self, cycle: Cycle, options: StepperServoOptions, earlier: Sequence[Estimate]
    ) -> tuple[Estimate, ...]:
        """Estimate with constants that are known exactly."""
        record, lost, bad = take_record(cycle)
        names = [MECHANICS, *(n for n in (WIENER,) if n in options.estimators)]
        counts = MaskCounts(int(record.used.sum()), bad=bad + lost)
        slow = check_period(cycle.period_s)
        refusal = Refusal(RefusalCode.WRONG_PERIOD, slow) if slow else refusal_of(record, options)
        if refusal:
            return _refused(cycle, refusal, names, counts.bad)
        values, thread = mechanics(
            record,
            cycle.period_s,
            step=options.step_size,
            max_backlash=options.max_backlash,
            max_delay=longest_delay(options, cycle.period_s),
        )
        refusal = misfit(record, thread, options)
        if refusal:
            return _refused(cycle, refusal, names, counts.bad)
        condition = gram_condition(thread.hessian)
        lag = max(1, round(float(thread.parameters[3])))
        sigma = rest_noise(record, lag)
        evidence = Evidence(counts, condition, sigma, lag)
        done = [conclude(self.name, MECHANICS, cycle, values, withheld(values), evidence)]
        if WIENER in names:
            lag = options.nk or lag
            structure = _structure(options, lag)
            settings = Settings(options.centre, end_offset(thread), _adaptation(options))
            learned, got = wiener(record, structure, _carried(earlier, structure), settings)
            evidence = Evidence(counts, gram_condition(got.state.gain), sigma, lag)
            judged = unexcited(learned)
            done.append(conclude(self.name, WIENER, cycle, learned, judged, evidence))
        return tuple(done)

    def coefficients(
        self, values: Mapping[str, float], lag: int, period_s: float, options: StepperServoOptions
    ) -> FloatArray:
        """Return the (14,) coefficients, parameters as `ValveModel.coefficients`.

        NaN stands where the backlash was never seen. The Hammerstein-Wiener model is projected to
        a
        stable one: its free run would diverge.
        """
        c = np.zeros(COEFFICIENTS)
        c[12] = options.centre
        if "a_1" in values and "backlash" not in values:
            structure = Structure(3, 3, nk=min(max(lag, 1), MAX_LAG), nl=3)
            theta = np.array([values.get(name, 0.0) for name in THETA])
            c[0], c[11] = 1.0, structure.nk
            c[1:11] = project_stable(theta, structure)
            c[13] = values.get("offset", 0.0)
            return c
        c[1] = values.get("backlash", np.nan)
        c[2] = values.get("offset", np.nan)
        c[3] = delay_of(values, period_s)
        return c

    def strangers(self) -> Mapping[str, Mapping[str, object]]:
        """Return valves that are not as the options say."""
        return STRANGERS

    def simulation(self) -> SimulationConfig:
        """Return the default simulation."""
        return default_simulation()

    def truth(self, simulation: SimulationConfig, cycle: int) -> Mapping[str, float]:
        """Return the true thread and flow edges over the stroke, as `ValveModel.truth` says."""
        plant = simulation.aged_plant(cycle)
        assert isinstance(plant, StepperServoPlant)
        return {
            "backlash": plant.backlash / plant.stroke,
            "band_lower": plant.band_lower / plant.stroke,
            "band_upper": plant.band_upper / plant.stroke,
            "flow_full": plant.flow_full,
        }


def _counted(cycle: Cycle, share: float) -> Cycle:
    """Return the cycle with counted steps that are longer by a share [1]."""
    if share == 1.0:
        return cycle
    inputs = cycle.frames.inputs.copy()
    inputs[:, 0] *= share
    return replace(cycle, frames=replace(cycle.frames, inputs=inputs))


def _structure(options: StepperServoOptions, lag: int) -> Structure:
    return Structure(options.na, options.nb, min(lag, MAX_LAG), options.nl)


def _adaptation(options: StepperServoOptions) -> Adaptation:
    """Return a careful adaptation: a thread with play is no Hammerstein-Wiener system."""
    return Adaptation(forgetting=options.forgetting, start_gain=0.01, early_forgetting=1.0)


def _carried(earlier: Sequence[Estimate], structure: Structure) -> FloatArray | None:
    """Return the last parameters of the recursive model, where it had this structure's delay."""
    for estimate in reversed(earlier):
        usable = estimate.status is not EstimateStatus.REFUSED
        if estimate.estimator == WIENER and usable:
            theta = np.array([estimate.value(name) for name in structure.names])
            same = estimate.lag == structure.nk and bool(np.isfinite(theta).all())
            return theta if same else None
    return None


def _refused(
    cycle: Cycle, refusal: str, estimators: Iterable[str], bad: int
) -> tuple[Estimate, ...]:
    evidence = Evidence(MaskCounts(0, bad=bad))
    return tuple(
        refuse(MODEL.name, estimator, cycle, _NAMES[estimator], refusal, evidence)
        for estimator in estimators
    )


MODEL = StepperServoModel()
