# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Core values to messages and back."""

from __future__ import annotations

import struct
from array import array
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from builtin_interfaces.msg import Time
from valve_twin_msgs import msg

from valve_twin.core.gaps import gap_ns
from valve_twin.core.types import (
    Condition,
    Cycle,
    Disagreement,
    Estimate,
    EstimateStatus,
    Guard,
    Maintenance,
    MaskCounts,
    Parameter,
    ParameterStatus,
    ParameterValue,
    Prediction,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

SECOND_NS = 1_000_000_000
_MAX_NS = (2**31 - 1) * SECOND_NS
_PREDICTION = struct.Struct("<4siII4xQdddddB")
_LITTLE = b"\x00\x01\x00\x00"
_SERIES = struct.Struct("<4siII4xdQI4x")
_COUNT = struct.Struct("<I4x")
_SERIES_END = struct.Struct("<dI")


def to_time(stamp_ns: int) -> Time:
    """Return a stamp as a message; what a header cannot hold becomes its nearest end."""
    sec, nanosec = divmod(min(max(int(stamp_ns), 0), _MAX_NS), SECOND_NS)
    return Time(sec=sec, nanosec=nanosec)


def from_time(time: Time) -> int:
    """Return a stamp in nanoseconds."""
    return int(time.sec) * SECOND_NS + int(time.nanosec)


def prediction_bytes(prediction: Prediction) -> Iterator[bytes]:
    """Yield one serialized Prediction a sample, in the layout of the message."""
    sigma, cycle, pack = float(prediction.residual_sigma), prediction.cycle, _PREDICTION.pack
    columns = zip(
        prediction.stamp_ns.tolist(),
        prediction.measured.tolist(),
        prediction.predicted.tolist(),
        prediction.simulated.tolist(),
        prediction.residual.tolist(),
        prediction.validity.tolist(),
        strict=True,
    )
    for stamp, measured, predicted, simulated, residual, validity in columns:
        sec, nanosec = divmod(stamp, SECOND_NS)
        yield pack(
            _LITTLE,
            sec,
            nanosec,
            1,
            cycle,
            measured,
            predicted,
            simulated,
            residual,
            sigma,
            validity,
        )


def series_bytes(prediction: Prediction, period_s: float) -> Iterator[bytes]:
    """Yield the block as one serialized PredictionSeries a gap-free run of samples."""
    gaps = np.flatnonzero(np.diff(prediction.stamp_ns) > gap_ns(period_s)) + 1
    edges = [0, *gaps.tolist(), len(prediction.stamp_ns)]
    for first, end in pairwise(edges):
        count = end - first
        if count == 0:
            continue
        run, number = slice(first, end), _COUNT.pack(count)
        sec, nanosec = divmod(int(prediction.stamp_ns[first]), SECOND_NS)
        yield b"".join(
            (
                _SERIES.pack(_LITTLE, sec, nanosec, 1, period_s, prediction.cycle, count),
                prediction.measured[run].tobytes(),
                number,
                prediction.predicted[run].tobytes(),
                number,
                prediction.simulated[run].tobytes(),
                number,
                prediction.residual[run].tobytes(),
                _SERIES_END.pack(float(prediction.residual_sigma), count),
                prediction.validity[run].tobytes(),
            )
        )


def cycle_message(valve: str, cycle: Cycle) -> msg.CycleSummary:
    """Return what is told about a closed cycle."""
    out = msg.CycleSummary(
        valve=valve,
        cycle=cycle.number,
        start=to_time(cycle.start_ns),
        end=to_time(cycle.end_ns),
        samples=len(cycle.frames),
        lost=cycle.lost,
        missed_cycles=cycle.missed_cycles,
        accepted=cycle.accepted,
        reason=cycle.reason,
    )
    out.header.stamp = out.end
    return out


def estimate_message(
    valve: str,
    estimate: Estimate,
    units: dict[str, str],
    *,
    stored: bool,
    wall_s: float = 0.0,
) -> msg.Estimate:
    """Return an estimate as a message; `units` by parameter name."""
    values = estimate.parameters
    out = msg.Estimate(
        valve=valve,
        model=estimate.model,
        estimator=estimate.estimator,
        cycle=estimate.cycle,
        start=to_time(estimate.start_ns),
        end=to_time(estimate.end_ns),
        names=[p.name for p in values],
        units=[units.get(p.name, "1") for p in values],
        values=array("d", [p.value for p in values]),
        standard_errors=array("d", [p.standard_error for p in values]),
        lower_95=array("d", [p.lower_95 for p in values]),
        upper_95=array("d", [p.upper_95 for p in values]),
        at_bound=[p.status is ParameterStatus.AT_BOUND for p in values],
        parameter_status=array("B", [int(p.status) for p in values]),
        parameter_reason=[p.reason for p in values],
        status=int(estimate.status),
        reason=estimate.reason,
        mse_test=float(estimate.mse_test),
        mse_train=float(estimate.mse_train),
        fit_test=float(estimate.fit_test),
        fit_train=float(estimate.fit_train),
        condition_number=float(estimate.condition_number),
        lag=int(estimate.lag),
        noise_sigma=float(estimate.noise_sigma),
        samples_used=estimate.counts.used,
        samples_masked_seat=estimate.counts.seat,
        samples_masked_stuck=estimate.counts.stuck,
        samples_masked_stale=estimate.counts.stale,
        used_by_trend=estimate.used_by_trend,
        trend_reason=estimate.trend_reason,
        disagreement_estimator=[d.estimator for d in estimate.disagreements],
        disagreement_parameter=[d.parameter for d in estimate.disagreements],
        disagreement=array("d", [d.difference for d in estimate.disagreements]),
        disagreement_errors=array("d", [d.standard_errors for d in estimate.disagreements]),
        guard_names=[g.name for g in estimate.guards],
        guard_passed=[g.passed for g in estimate.guards],
        guard_values=array("d", [g.value for g in estimate.guards]),
        guard_limits=array("d", [g.limit for g in estimate.guards]),
        guard_reasons=[g.reason for g in estimate.guards],
        condition_names=[c.name for c in estimate.conditions],
        condition_values=array("d", [c.value for c in estimate.conditions]),
        reproducible=estimate.reproducible,
        stored=stored,
        wall_time=wall_s,
    )
    out.header.stamp = out.end
    return out


def estimate_value(message: msg.Estimate, missed_cycles: int = 0) -> Estimate:
    """Return the estimate that a message tells of."""
    columns = zip(
        message.names,
        message.values,
        message.parameter_status,
        message.parameter_reason,
        message.standard_errors,
        message.lower_95,
        message.upper_95,
        strict=True,
    )
    return Estimate(
        model=message.model,
        estimator=message.estimator,
        cycle=int(message.cycle),
        start_ns=from_time(message.start),
        end_ns=from_time(message.end),
        parameters=tuple(
            ParameterValue(
                name, float(value), ParameterStatus(int(status)), reason, error, low, high
            )
            for name, value, status, reason, error, low, high in columns
        ),
        status=EstimateStatus(int(message.status)),
        reason=message.reason,
        mse_test=message.mse_test,
        mse_train=message.mse_train,
        fit_test=message.fit_test,
        fit_train=message.fit_train,
        condition_number=message.condition_number,
        lag=int(message.lag),
        noise_sigma=message.noise_sigma,
        counts=MaskCounts(
            int(message.samples_used),
            int(message.samples_masked_seat),
            int(message.samples_masked_stuck),
            int(message.samples_masked_stale),
        ),
        missed_cycles=missed_cycles,
        used_by_trend=bool(message.used_by_trend),
        reproducible=bool(message.reproducible),
        trend_reason=message.trend_reason,
        disagreements=tuple(
            Disagreement(other, name, float(apart), float(errors))
            for other, name, apart, errors in zip(
                message.disagreement_estimator,
                message.disagreement_parameter,
                message.disagreement,
                message.disagreement_errors,
                strict=True,
            )
        ),
        guards=tuple(
            Guard(name, bool(passed), float(value), float(limit), reason)
            for name, passed, value, limit, reason in zip(
                message.guard_names,
                message.guard_passed,
                message.guard_values,
                message.guard_limits,
                message.guard_reasons,
                strict=True,
            )
        ),
        conditions=tuple(
            Condition(name, float(value))
            for name, value in zip(message.condition_names, message.condition_values, strict=True)
        ),
    )


def units_of(parameters: tuple[Parameter, ...]) -> dict[str, str]:
    """Return the unit of every parameter of a model by name."""
    return {p.name: p.unit for p in parameters}


def maintenance_message(event: Maintenance) -> msg.Maintenance:
    """Return a maintenance event as a message."""
    return msg.Maintenance(
        stamp=to_time(event.stamp_ns),
        cycle=event.cycle,
        note=event.note,
        new_reference=event.new_reference,
    )


def maintenance_value(message: msg.Maintenance) -> Maintenance:
    """Return the maintenance event that a message tells of."""
    return Maintenance(
        from_time(message.stamp), int(message.cycle), message.note, bool(message.new_reference)
    )


def filled(message: Any, value: Any, stamp_ns: int, *, skip: tuple[str, ...] = ()) -> Any:
    """Fill a message from a value whose fields carry the same names.

    Parameters
    ----------
    message : message
        What to fill; its header gets the stamp.
    value : dataclass
        Where the fields come from; `<field>_ns` fills a time.
    stamp_ns : int
        Stamp of the header [ns].
    skip : tuple of str
        Fields left alone.
    """
    for name, kind in message.get_fields_and_field_types().items():
        if name == "header" or name in skip:
            continue
        if kind == "builtin_interfaces/Time":
            setattr(message, name, to_time(getattr(value, f"{name}_ns")))
        else:
            setattr(message, name, _CASTS.get(kind, _same)(getattr(value, name)))
    message.header.stamp = to_time(stamp_ns)
    return message


def _same(value: Any) -> Any:
    return value


_CASTS = {
    "double": float,
    "boolean": bool,
    "string": str,
    "uint8": int,
    "uint32": int,
    "uint64": int,
    "int64": int,
    "int32": int,
}
