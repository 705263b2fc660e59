# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The positioner model: what is estimated from one cycle and how it predicts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.plausibility import (
    LARGEST,
    follow_fault,
    known_rows,
    same_fault,
    unit_fault,
)
from valve_twin.core.valves.kit.compiled import CompiledModel
from valve_twin.core.valves.kit.intervals import block_errors
from valve_twin.core.valves.kit.law import Law, Lawful
from valve_twin.core.valves.kit.moved import with_tolerances
from valve_twin.core.valves.kit.prediction import state_size
from valve_twin.core.valves.positioner.check import doubted, rivals_of
from valve_twin.core.valves.positioner.curve import (
    line_through,
    pooled,
    settled,
    shows_several_levels,
)
from valve_twin.core.valves.positioner.extended import predict_extended
from valve_twin.core.valves.positioner.fit import FASTEST_RATE, bounds, fit_free_run, normal
from valve_twin.core.valves.positioner.fit_extended import fit_extended
from valve_twin.core.valves.positioner.kernels import MEMORY, RUNS, predict_block
from valve_twin.core.valves.positioner.law import EXTENDED, LAW
from valve_twin.core.valves.positioner.outcome import MIN_DRIVEN, Errors, accepted, refused
from valve_twin.core.valves.positioner.outcome_extended import Fitted, accepted_extended
from valve_twin.core.valves.positioner.parameters import ESTIMATOR, PARAMETERS, PositionerOptions
from valve_twin.core.valves.positioner.plant import STRANGERS, default_simulation
from valve_twin.core.valves.positioner.record import prepare
from valve_twin.core.valves.positioner.structure import extend

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.estimation.solvers.least_squares import Limits
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import BoolArray, Cycle, Estimate, FloatArray, Parameter
    from valve_twin.core.valves.positioner.fit import Record, Solution
    from valve_twin.core.valves.positioner.record import Prepared
    from valve_twin.core.valves.positioner.structure import Structure

N_PLAIN = 9
"""Coefficients of the plain law."""


@dataclass(frozen=True, slots=True)
class PositionerModel(Lawful, CompiledModel):
    """Implements `ValveModel` for one command and one position."""

    name: str = "positioner"
    inputs: tuple[str, ...] = ("command",)
    output: str = "position"
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: PositionerOptions = field(default_factory=PositionerOptions)
    state_size = state_size(RUNS, MEMORY)
    trend_estimator: str = ESTIMATOR
    normalised: bool = True
    proposed_for: str = "followed"
    law: Law = LAW
    variants: tuple[Mapping[str, object], ...] = (
        {"second_order": True, "static_curve": True, "two_delays": True},
    )

    def estimate(
        self, cycle: Cycle, options: PositionerOptions, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate rates, slew limits, dead band and delay from one cycle by output error.

        Parameters
        ----------
        cycle : Cycle
            One cycle of N samples.
        options : PositionerOptions
            The model's options.
        earlier : sequence of Estimate
            Their settled levels are pooled into the dead command of a static curve; nothing else.

        Returns
        -------
        tuple of Estimate
            One estimate; REFUSED with its reason where the cycle says nothing.
        """
        return with_tolerances(
            options, lambda o: self._exact(cycle, o, earlier), (ESTIMATOR,), absolute=True
        )

    def _exact(
        self, cycle: Cycle, options: PositionerOptions, earlier: Sequence[Estimate]
    ) -> tuple[Estimate, ...]:
        """Estimate with constants that are known exactly."""
        prepared = prepare(cycle, options)
        if prepared.refusal:
            return (refused(self.name, cycle, prepared),)
        limits = bounds(
            cycle.period_s, min_slew=options.min_slew, max_dead_band=options.max_dead_band
        )
        if options.extended:
            found = _fit_extended(prepared, options, limits, earlier)
            return (accepted_extended(self.name, cycle, found, options.interval_blocks),)
        solution = fit_free_run(prepared.record, max_lag=prepared.max_lag, limits=limits)
        errors = _errors(prepared.record, solution, limits, options.interval_blocks)
        told = accepted(self.name, cycle, prepared, solution, limits, errors)
        if options.interval_blocks >= 2:  # what the law leaves of the cycle is in the blocks
            return (told,)
        rivals = rivals_of(prepared.record, solution, limits, prepared.max_lag)
        return (doubted(told, rivals, prepared.noise_sigma),)

    def input_fault(self, cycle: Cycle, options: PositionerOptions) -> str:
        """Return why the signals cannot be those of a positioner, empty where they can.

        Parameters
        ----------
        cycle : Cycle
            At least one sample.
        options : PositionerOptions
            The model's options.
        """
        known = known_rows(cycle.frames)
        if len(known) == 0:
            return ""
        names = (self.output, *self.inputs)
        position, command = known.position, known.inputs[:, 0]
        spare = LARGEST - 1.0
        lower = min(options.lower_stop, 0.0) - spare
        upper = max(options.upper_stop, 1.0) + spare
        faults = [
            unit_fault(name, values, lower, upper)
            for name, values in zip(names, (position, command), strict=True)
        ]
        faults.append(same_fault(names, (position, command)))
        max_lag = max(1, round(options.max_delay_s / cycle.period_s))
        faults.append(
            follow_fault(names, position, command, period_s=cycle.period_s, max_lag=max_lag)
        )
        return next((fault for fault in faults if fault), "")

    def also_followed(self, options: PositionerOptions) -> tuple[str, ...]:
        """Return dead command and gain of a static curve: what wears or clogs changes them.

        Parameters
        ----------
        options : PositionerOptions
            The model's options.
        """
        return ("dead_command", "static_gain") if options.static_curve else ()

    def merge(self, estimates: Sequence[Estimate]) -> Mapping[str, float]:
        """Return what several cycles together know: the newest value of every parameter.

        A slew limit that later cycles did not reach stays in force until one of them moves
        faster: a limit that the spool has been seen to pass is none. Cycles of a static curve,
        each at a command of its own, are pooled: see `curve.pooled`.

        Parameters
        ----------
        estimates : sequence of Estimate
            Of one estimator, oldest first, at least one, none refused.
        """
        values: dict[str, float] = {}
        for estimate in estimates:
            known = {p.name: p.value for p in estimate.parameters if np.isfinite(p.value)}
            for way in ("rising", "falling"):
                limit, speed = f"slew_{way}", known.get(f"speed_{way}", 0.0)
                if speed > values.get(limit, np.inf):
                    del values[limit]
            values.update(known)
        return {**values, **pooled(estimates)}

    def coefficients(
        self, values: Mapping[str, float], lag: int, period_s: float, options: PositionerOptions
    ) -> FloatArray:
        """Return the coefficients, parameters as `ValveModel.coefficients`.

        9 of the plain law, 17 of the extended one. What no cycle has shown does not limit the
        prediction: a rate known in one direction only serves both, an unknown slew limit is one
        stroke a sample.
        """
        plain = self._plain(values, lag, period_s, options)
        return extend(plain, values, options) if options.extended else plain

    def law_values(self, values: Mapping[str, float], period_s: float) -> Mapping[str, float]:
        """Return what the prediction takes for the parameters of the plain law.

        Parameters
        ----------
        values : mapping
            Known ones by name [unit of each].
        period_s : float
            Sampling time [s].

        Raises
        ------
        ValueError
            If they are those of the extended law.
        """
        more = sorted(EXTENDED & set(values))
        if more:
            msg = f"{more[0]} belongs to the extended law, of which there is no step of one sample"
            raise ValueError(msg)
        c = self._plain(values, 0, period_s, self.options)
        names = [p.name for p in self.law.parameters]
        return dict(zip(names, (*c[:5].tolist(), *c[7:].tolist()), strict=True))

    def _plain(
        self, values: Mapping[str, float], lag: int, period_s: float, options: PositionerOptions
    ) -> FloatArray:
        fastest = 1.0 / period_s
        rising = values.get("rate_rising", values.get("rate_falling", FASTEST_RATE / period_s))
        return np.array(
            [
                rising,
                values.get("rate_falling", rising),
                values.get("slew_rising", fastest),
                values.get("slew_falling", fastest),
                values.get("dead_band", 0.0),
                period_s,
                float(lag),
                options.lower_stop,
                options.upper_stop,
            ]
        )

    def strangers(self) -> Mapping[str, Mapping[str, object]]:
        """Return valves that are not as the options say."""
        return STRANGERS

    def simulation(self) -> SimulationConfig:
        """Return the default simulation."""
        return default_simulation()

    def kernel_of(self, coefficients: FloatArray) -> Callable[..., None]:
        """Return the prediction of the plain law for its coefficients, else of the extended."""
        return predict_block if len(coefficients) == N_PLAIN else predict_extended


def _fit_extended(
    prepared: Prepared, structure: Structure, limits: Limits, earlier: Sequence[Estimate]
) -> Fitted:
    """Fit the extended law; a dead command that a cycle does not show comes from those before."""
    several = structure.static_curve and shows_several_levels(prepared.record)
    line = line_through(*settled(earlier))
    known = None if several else (0.0 if line is None else line[0])
    fit = fit_extended(
        prepared.record, structure, max_lag=prepared.max_lag, limits=limits, dead_command=known
    )
    return Fitted(prepared, structure, fit, earlier)


def _errors(record: Record, solution: Solution, limits: Limits, blocks: int) -> Errors | None:
    """Return standard errors from blocks of the cycle, None where none are asked for."""
    p, free = solution.parameters, (solution.parameters > limits[0])
    free &= (p < limits[1]) & (solution.active >= MIN_DRIVEN)
    if blocks < 2:
        return None

    def normal_of(mask: BoolArray) -> tuple[FloatArray, FloatArray]:
        return normal(replace(record, used=mask), p, solution.lag)

    errors = block_errors(solution.hessian, normal_of, record.used, free, blocks)
    return Errors(errors, blocks - 1)


MODEL = PositionerModel()
