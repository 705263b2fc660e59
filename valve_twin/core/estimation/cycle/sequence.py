# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Estimation from cycle to cycle: what a model says of one cycle, judged by the cycles before.

`estimate_cycle` is a pure function of the cycle and of a memory, and the memory is a pure function
of the estimates of the last cycles. So a worker process, the offline command and a twin that was
restarted from its history all give the same bits.
"""

from __future__ import annotations

from dataclasses import replace
from math import isfinite, isnan, nan
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.diagnosis.features import NEXT_CYCLE
from valve_twin.core.diagnosis.generic.reference import estimate_features
from valve_twin.core.estimation.cycle.comparison import compare_estimators
from valve_twin.core.estimation.cycle.errors import model_errors
from valve_twin.core.estimation.cycle.memory import Memory, in_force_of
from valve_twin.core.estimation.cycle.movement import MOVES, TRAVEL, count_movement
from valve_twin.core.estimation.cycle.refused import coded, estimated, nothing_of, refused
from valve_twin.core.estimation.cycle.scatter import scatter_between_cycles
from valve_twin.core.estimation.data.masks import contiguous
from valve_twin.core.prediction import restart_marks, run_model
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import (
    CONDITIONS,
    Condition,
    Cycle,
    Estimate,
    EstimateStatus,
    FloatArray,
    Frames,
    Guard,
    Parameter,
    ParameterStatus,
    ParameterValue,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.valves.interface import ModelOptions, Options, ValveModel

_MIN_SAMPLES = 3
"""Fewest samples that give an error or a fit."""


def estimate_cycle(
    model: ValveModel, options: Options, cycle: Cycle, memory: Memory
) -> tuple[tuple[Estimate, ...], Memory]:
    """Estimate one cycle and judge the result by the cycles before.

    Adds to each estimate its errors and fits as test data for the model before and as training
    data for the new one, the intervals from the scatter between cycles (NaN before there are
    ten), and how far the other estimators lie apart, unless the model `judges` nothing with these
    options. Where the signals cannot be what is configured (`plausibility`) nothing is fitted, and
    the trend's estimator says so alone. Never raises for bad data; what the model's code raises
    refuses the cycle.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    options : mapping
        Its options, complete.
    cycle : Cycle
        The cycle.
    memory : Memory
        Estimates so far.

    Returns
    -------
    tuple of Estimate
        One an estimator.
    Memory
        The memory with them.
    """
    if len(cycle.frames) == 0:
        empty = cycle.reason or Refusal(RefusalCode.FEW_SAMPLES, "the cycle has no samples")
        nothing = (coded(nothing_of(model, cycle, empty)),)
        return nothing, memory.after(nothing)
    fault = model.input_fault(cycle, options) if cycle.accepted else ""
    if fault:  # nothing is fitted to signals that cannot be what is configured
        implausible = Refusal(RefusalCode.IMPLAUSIBLE, fault)
        results: tuple[Estimate, ...] = (nothing_of(model, cycle, implausible),)
    else:
        results = estimated(model, options, cycle, memory.estimates)
    if not cycle.accepted:
        results = tuple(refused(e, cycle.reason) for e in results)
    results = tuple(map(coded, results))
    if not model.judges(options):
        return results, memory
    conditions = cycle_conditions(cycle)
    results = tuple(replace(e, conditions=(*e.conditions, *conditions)) for e in results)
    done = tuple(_judged(model, options, cycle, memory, e) for e in results)
    if len(done) > 1:
        done = compare_estimators(
            done,
            memory.estimates,
            trend_estimator=model.trend_estimator,
            trended=[p.name for p in model.parameters if p.trend],
        )
    if cycle.accepted and not fault and _wants_features(model, options, done):
        shown = estimate_features(model, options, cycle, memory.estimates)
        done = (*done, replace(shown, conditions=conditions))
    return done, memory.after(done)


def _wants_features(model: ValveModel, options: ModelOptions, done: Sequence[Estimate]) -> bool:
    """Return whether features of any valve are asked for that the model did not give itself."""
    asked = FEATURES in options.estimators and model.feature_set.of_any_valve
    return asked and all(e.estimator != FEATURES for e in done)


def evaluate(
    model: ValveModel, coefficients: FloatArray, frames: Frames, period_s: float
) -> tuple[float, float]:
    """Return one-step mean squared error [1] and free-run fit [%] of a model on a cycle.

    The error is over the samples with a valid prediction; the fit is 100 (1 - |y - yhat|/|y -
    mean|) of the free run that starts from the first measured position.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    coefficients : (K,) array
        Of its `predict`.
    frames : Frames
        The cycle's N samples.
    period_s : float
        Sampling time [s].
    """
    restart = restart_marks(frames, period_s)
    run = run_model(model, model.initial_state(), coefficients, frames, restart)
    y = contiguous(frames.position)
    return model_errors(y, frames.valid, run.predicted, run.simulated, run.validity, _MIN_SAMPLES)


def _judged(
    model: ValveModel, options: Options, cycle: Cycle, memory: Memory, estimate: Estimate
) -> Estimate:
    """Add errors, fits and intervals to the estimate of one estimator."""
    before = memory.of(estimate.estimator)
    errors = [
        (float("nan"), float("nan"))
        if force is None
        else evaluate(model, force.coefficients, cycle.frames, cycle.period_s)
        for force in (
            in_force_of(model, before, cycle.period_s, options),
            in_force_of(model, _usable(before, estimate), cycle.period_s, options),
        )
    ]
    (mse_test, fit_test), (mse_train, fit_train) = errors
    if estimate.status is EstimateStatus.REFUSED:
        mse_train = fit_train = float("nan")
    elif fit_train < 0.0:
        text = (
            f"the free run of this estimate misses the position by more than its mean does "
            f"(fit {fit_train:.0f} %): scales, directions, model or cycles are wrong"
        )
        estimate = coded(refused(estimate, Refusal(RefusalCode.MISFIT, text)))
    elif estimate.estimator == model.trend_estimator and fit_test < 0.0:
        estimate = replace(estimate, guards=(*estimate.guards, _next_cycle(fit_test)))
    known = {p.name: p for p in model.parameters}
    series = _usable_series(before)
    return replace(
        estimate,
        parameters=tuple(
            _with_interval(p, known.get(p.name), series.get(p.name, ()))
            for p in estimate.parameters
        ),
        mse_test=mse_test,
        fit_test=fit_test,
        mse_train=mse_train,
        fit_train=fit_train,
        used_by_trend=estimate.estimator == model.trend_estimator,
    )


def _next_cycle(fit: float) -> Guard:
    """Return the check that the model of the cycles before does not stand: fit [%]."""
    reason = (
        f"the free run of the model of the cycles before misses this cycle's position by more "
        f"than its mean does (fit {fit:.0f} %): what was accepted tells nothing of other cycles"
    )
    return Guard(NEXT_CYCLE, passed=False, value=fit, limit=0.0, reason=reason)


def cycle_conditions(cycle: Cycle) -> tuple[Condition, ...]:
    """Return under what a cycle ran.

    Parameters
    ----------
    cycle : Cycle
        With at least one sample.

    Returns
    -------
    tuple of Condition
        `stroke`: from the 1 % to the 99 % quantile of the believed positions [unit of the
        position]; `moves` and `travel`: see `count_movement`. Of each mapped signal of
        `CONDITIONS` its mean while believed [unit as configured].
    """
    position = cycle.frames.position[cycle.frames.valid & np.isfinite(cycle.frames.position)]
    if not len(position):
        return tuple(_mean_conditions(cycle.frames))
    at = len(position) // 100, len(position) - 1 - len(position) // 100
    low, high = np.partition(position, at)[list(at)]
    moves, travel = count_movement(position)
    own = {"stroke": high - low, MOVES: moves, TRAVEL: travel}
    found = [Condition(name, float(value)) for name, value in own.items()]
    return (*found, *_mean_conditions(cycle.frames))


def _mean_conditions(frames: Frames) -> list[Condition]:
    if frames.conditions is None:
        return []
    found = []
    for name, values in zip(CONDITIONS, frames.conditions.T, strict=True):
        known = values[np.isfinite(values)]
        if len(known):
            found.append(Condition(name, float(known.mean())))
    return found


def _usable_series(before: Sequence[Estimate]) -> dict[str, list[float]]:
    """Return the usable values of each parameter, oldest first."""
    found: dict[str, list[float]] = {}
    ok = ParameterStatus.OK  # to look it up takes as long as the rest of the loop
    for estimate in before:
        for p in estimate.parameters:
            if p.status is ok:
                if p.name in found:
                    found[p.name].append(p.value)
                else:
                    found[p.name] = [p.value]
    return found


def _with_interval(
    value: ParameterValue, parameter: Parameter | None, series: Sequence[float]
) -> ParameterValue:
    """Add scatter and interval, from earlier cycles, inside the physical bounds.

    `standard_error` is the repeatability: how far one cycle scatters. The limits are the accuracy:
    scatter, and what is wrong in every cycle alike, which the model gives as the limits of a value
    without a standard error; infinite ones stay unknown. An estimator that gives an honest error
    of its own keeps it.
    """
    if not value.usable or isfinite(value.standard_error):
        return value
    scatter = scatter_between_cycles(np.array(series))
    lower, upper = (
        (parameter.lower, parameter.upper) if parameter is not None else (-np.inf, np.inf)
    )
    alike = value.upper_95 - value.value if not isnan(value.upper_95) else 0.0
    half = float(np.hypot(scatter.half_width_95, alike))
    return ParameterValue(  # `replace` takes four times as long, and there are ten a cycle
        value.name,
        value.value,
        value.status,
        value.reason,
        standard_error=scatter.sigma,
        lower_95=max(value.value - half, lower) if isfinite(half) else nan,
        upper_95=min(value.value + half, upper) if isfinite(half) else nan,
    )


def _usable(before: tuple[Estimate, ...], estimate: Estimate) -> tuple[Estimate, ...]:
    return before if estimate.status is EstimateStatus.REFUSED else (*before, estimate)
