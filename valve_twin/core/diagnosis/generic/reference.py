# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Features of a cycle against the valve's own first model: what is stored beside the estimates.

The model of the first accepted cycles stays the measure: one that follows the valve would take up
a fault and show it no more. It travels with the features from cycle to cycle, so that they are a
function of the cycle and of the estimates before it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.diagnosis.generic import explained, programs, stands
from valve_twin.core.diagnosis.generic.features import (
    DEVIATION,
    FEATURES,
    MOVE_NOISE,
    RELATIVE,
    SPAN,
    Record,
    cycle_features,
    span_of,
)
from valve_twin.core.diagnosis.generic.motion import PARAMETERS, motion_of, numbers_of
from valve_twin.core.gaps import gap_ns
from valve_twin.core.prediction import restart_marks, run_model
from valve_twin.core.types import (
    Estimate,
    EstimateStatus,
    MaskCounts,
    Parameter,
    ParameterStatus,
    ParameterValue,
    Validity,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.past.columns import Rows
    from valve_twin.core.types import BoolArray, Cycle, FloatArray
    from valve_twin.core.valves.interface import Options, ValveModel

REFERENCE_CYCLES = 5
"""Accepted estimates that make the reference model, assumed."""

_PREFIX = "reference."


@dataclass(frozen=True, slots=True)
class Reference:
    """The model that a valve is held against.

    Attributes
    ----------
    values : Mapping
        Its parameters by name [unit of each].
    lag : int
        Its lag [samples].
    span : float
        What lengths are shares of; NaN = the span of each cycle [unit of the position].
    """

    values: Mapping[str, float]
    lag: int
    span: float = math.nan


def published(model: ValveModel) -> tuple[Parameter, ...]:
    """Return all that estimates of a model may hold: parameters, features and the reference.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    """
    if not model.feature_set.of_any_valve:
        return model.parameters
    deviation = Parameter(DEVIATION, "1", "feature: rms off the model, share of the span", 0.0)
    unit = "1" if model.normalised else ""  # else that of the signal, which no model knows
    span = Parameter(SPAN, unit, "feature: what lengths are shares of, as the position", 0.0)
    kept = (replace(p, name=f"{_PREFIX}{p.name}", trend=False) for p in model.parameters)
    return (
        *model.parameters,
        *FEATURES,
        deviation,
        span,
        *kept,
        *programs.published(model),
        *explained.PARAMETERS,
        *stands.PARAMETERS,
        *PARAMETERS,
    )


def has_reference(features: Rows) -> BoolArray:
    """Return which features were taken against a reference model, (N,)."""
    found = np.zeros(len(features), dtype=np.bool_)
    for name, columns in features.parameters.items():
        if name.startswith(_PREFIX):
            found |= columns.status >= 0
    return found


def has_noise_of_rest(features: Rows) -> BoolArray:
    """Return in which features the noise is that of rest alone, (N,).

    Those that were stored before had the noise of the whole cycle, and none of moves.
    """
    columns = features.parameters.get(MOVE_NOISE)
    return np.zeros(len(features), dtype=np.bool_) if columns is None else columns.status >= 0


def reference_of(model: ValveModel, earlier: Sequence[Estimate]) -> Reference | None:
    """Return what a valve is held against; None before there are enough estimates.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    earlier : sequence of Estimate
        Estimates of all estimators of the cycles before, oldest first.
    """
    for e in reversed(earlier):
        if e.estimator == ESTIMATOR:
            at = len(_PREFIX)
            kept = {p.name[at:]: p.value for p in e.parameters if p.name.startswith(_PREFIX)}
            if kept:
                spans = (p.value for p in e.parameters if p.name == SPAN)
                return Reference(kept, e.lag, next(spans, math.nan))
    first = [
        e
        for e in earlier
        if e.estimator == model.trend_estimator and e.status is not EstimateStatus.REFUSED
    ]
    if len(first) < REFERENCE_CYCLES:
        return None
    values = {n: v for n, v in model.merge(first).items() if np.isfinite(v)}
    return Reference(values, first[-1].lag)


def estimate_features(
    model: ValveModel, options: Options, cycle: Cycle, earlier: Sequence[Estimate]
) -> Estimate:
    """Return the features of a cycle as an estimate.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    options : dataclass
        Its options.
    cycle : Cycle
        With at least one sample.
    earlier : sequence of Estimate
        Estimates of all estimators of the cycles before, oldest first.

    Returns
    -------
    Estimate
        REFUSED where the cycle shows none.
    """
    reference = reference_of(model, earlier)
    if reference is not None:
        known = model.coefficients(reference.values, reference.lag, cycle.period_s, options)
        if not np.isfinite(known).all():
            reference = None  # it lacks a parameter that no cycle has shown yet
    record = record_of(model, None if reference is None else known, cycle)
    if reference is not None and not model.feature_set.by_model:
        record = replace(record, span=reference.span)
    values = [*features_of(model, record), *model.features(cycle, options)]
    values += programs.values(model, cycle)
    followed = model.feature_set.names
    shown = sum(p.usable for p in values if p.name in followed)
    status, reason = EstimateStatus.PARTIAL, f"{shown} of {len(followed)} features are shown"
    if shown == len(followed):
        status = EstimateStatus.ACCEPTED
    elif not shown:
        status = EstimateStatus.REFUSED
    if reference is None:
        reason += f"; no reference model before {REFERENCE_CYCLES} accepted cycles"
    else:
        values += [ParameterValue(f"{_PREFIX}{n}", v) for n, v in reference.values.items()]
        if shown and not model.feature_set.by_model:
            values += [*explained.values(record), *stands.values(record)]
        motion = None
        if shown and not any(map(numbers_of, earlier)):
            motion = motion_of(record, values)
        values += [ParameterValue(SPAN, x) for x in _span(model, record, earlier)]
        values += motion.values() if motion else []
    return Estimate(
        model=model.name,
        estimator=ESTIMATOR,
        cycle=cycle.number,
        start_ns=cycle.start_ns,
        end_ns=cycle.end_ns,
        parameters=tuple(values),
        status=status,
        reason=reason,
        lag=0 if reference is None else reference.lag,
        counts=MaskCounts(int(np.count_nonzero(cycle.frames.valid))),
        missed_cycles=cycle.missed_cycles,
        reproducible=cycle.reproducible,
    )


def _span(model: ValveModel, record: Record, earlier: Sequence[Estimate]) -> list[float]:
    """Return what lengths of a cycle are shares of: its own span where none is known.

    Features of an older version are shares of the span of each cycle and stay so.
    """
    if not math.isnan(record.span):
        return [record.span]
    own, shown = span_of(record), (p for e in earlier for p in e.parameters)
    is_old = any(p.name == DEVIATION and p.usable for p in shown)
    return [own] if own > 0.0 and (model.feature_set.by_model or not is_old) else []


def features_of(model: ValveModel, record: Record) -> list[ParameterValue]:
    """Return the features that every valve has, as far as a cycle shows them.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    record : Record
        Measured position and free run of the cycle.
    """
    followed = model.feature_set.names
    found = cycle_features(record)
    return [_value(n, v) for n, v in found.items() if n in followed or n == DEVIATION]


def record_against(
    model: ValveModel, options: Options, reference: Reference | None, cycle: Cycle
) -> Record:
    """Return measured position and free run of a cycle under a reference model.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    options : dataclass
        Its options.
    reference : Reference or None
        What the valve is held against; without it there is no free run.
    cycle : Cycle
        With at least one sample.
    """
    coefficients = None
    if reference is not None:
        coefficients = model.coefficients(reference.values, reference.lag, cycle.period_s, options)
        coefficients = coefficients if np.isfinite(coefficients).all() else None
    return record_of(model, coefficients, cycle)


def record_of(model: ValveModel, coefficients: FloatArray | None, cycle: Cycle) -> Record:
    """Return measured position and free run of a cycle.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    coefficients : (P,) array or None
        Of the reference model [unit of each]; None = there is none.
    cycle : Cycle
        With at least one sample.
    """
    frames = cycle.frames
    run = run_model(
        model,
        model.initial_state(),
        coefficients,
        frames,
        restart_marks(frames, cycle.period_s),
    )
    believed = frames.valid & (run.validity != Validity.BAD_INPUT)
    missing = float(np.mean(~frames.valid))
    steps = np.diff(frames.stamp_ns)
    if len(steps):
        missing += float(np.mean(steps > gap_ns(cycle.period_s)))
    return Record(
        position=np.where(believed, frames.position, np.nan),
        response=run.simulated,
        period_s=cycle.period_s,
        commands=frames.inputs if model.normalised else frames.inputs[:, :0],
        missing=missing,
    )


def _value(name: str, value: float) -> ParameterValue:
    if np.isfinite(value) and not (name in RELATIVE and value <= 0.0):
        return ParameterValue(name, float(value))
    return ParameterValue(
        name, float("nan"), ParameterStatus.NOT_EXCITED, "the cycle does not show this"
    )
