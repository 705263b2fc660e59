# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Core values to messages and back."""

from __future__ import annotations

import struct
from array import array
from enum import IntEnum
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from std_msgs.msg import Header
from valve_twin_msgs import msg

from valve_twin.core.aging.verdict import Trend, Verdict
from valve_twin.core.gaps import gap_ns
from valve_twin.core.operation.events import Event
from valve_twin.core.operation.step_metrics import METRICS
from valve_twin.core.records import Column, build, columns, flat
from valve_twin.core.types import (
    Cycle,
    Estimate,
    Maintenance,
    Parameter,
    ParameterStatus,
    Prediction,
)
from valve_twin.nodes.runtime.stamps import SECOND_NS, from_time, to_time

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from valve_twin.core.operation.counters import Counters
    from valve_twin.core.operation.step_metrics import StepMetrics

T = TypeVar("T")

_PREDICTION = struct.Struct("<4siII4xQdddddB?")
_LITTLE = b"\x00\x01\x00\x00"
_SERIES = struct.Struct("<4siII4xdQI4x")
_COUNT = struct.Struct("<I4x")
_SERIES_END = struct.Struct("<dI")


def prediction_bytes(prediction: Prediction) -> Iterator[bytes]:
    """Yield one serialized Prediction a sample, in the layout of the message."""
    sigma, cycle, pack = float(prediction.residual_sigma), prediction.cycle, _PREDICTION.pack
    reproducible = prediction.reproducible
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
            reproducible,
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
                bytes([prediction.reproducible]),
            )
        )


def cycle_message(valve: str, cycle: Cycle) -> msg.CycleSummary:
    """Return the summary of a closed cycle."""
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


def counters_message(valve: str, counters: Counters) -> msg.Counters:
    """Return the counters of a valve as a message."""
    hours, opened, closed, near = counters.hours
    out = msg.Counters(
        valve=valve,
        cycle=counters.cycle,
        since=to_time(counters.since_ns),
        cycles=counters.cycles,
        movements=counters.movements,
        reversals=counters.reversals,
        travel=counters.travel,
        strokes=counters.strokes,
        hours=hours,
        starts=counters.starts,
        hours_open=opened,
        hours_closed=closed,
        hours_near_closed=near,
        span_edges=counters.edges,
        span_counts=counters.spans,
    )
    out.header.stamp = to_time(counters.end_ns)
    return out


def step_message(valve: str, step: StepMetrics) -> msg.StepMetrics:
    """Return the metrics of one step as a message."""
    found = step.metrics
    out = msg.StepMetrics(
        valve=valve,
        cycle=step.cycle,
        step=step.step,
        command=step.command,
        size=step.size,
        names=[m.name for m in found],
        units=[METRICS[m.name] for m in found],
        values=[m.value for m in found],
        lower_95=[m.lower_95 for m in found],
        upper_95=[m.upper_95 for m in found],
        reasons=[m.reason for m in found],
    )
    out.header.stamp = to_time(step.stamp_ns)
    return out


def estimate_message(
    valve: str,
    estimate: Estimate,
    units: dict[str, str],
    *,
    stored: bool,
    wall_s: float = 0.0,
) -> msg.Estimate:
    """Return an estimate as a message.

    Parameters
    ----------
    valve : str
        Its name.
    estimate : Estimate
        The estimate.
    units : dict
        Unit by name of the parameter; "1" where one is not named.
    stored : bool
        Whether it is committed to the history.
    wall_s : float
        Computing time [s].
    """
    out = to_message(estimate)
    out.header.stamp = out.end
    out.valve, out.stored, out.wall_time = valve, stored, wall_s
    out.units = [units.get(p.name, "1") for p in estimate.parameters]
    out.at_bound = [p.status is ParameterStatus.AT_BOUND for p in estimate.parameters]
    return out


def estimate_value(message: msg.Estimate, missed_cycles: int = 0) -> Estimate:
    """Return the estimate that a message tells of; what stands beside it is the second."""
    return to_value(Estimate, message, missed_cycles=missed_cycles)


def units_of(parameters: tuple[Parameter, ...]) -> dict[str, str]:
    """Return the unit of every parameter of a model by name."""
    return {p.name: p.unit for p in parameters}


def to_message(value: Any) -> Any:
    """Return a record (`Estimate`, `Trend`, `Verdict`, `Maintenance`) as its message."""
    message, fields = _FORMATS[type(value)]
    out, found = message(), flat(value)
    for column, name, encode, _ in fields:
        setattr(out, name, encode(found[column.name]))
    return out


def to_value(record: type[T], message: Any, **beside: object) -> T:
    """Return the record that a message tells of.

    Parameters
    ----------
    record : type
        Class of the record.
    message : message
        Of that record.
    **beside : object
        Fields that stand beside the message.
    """
    for column, name, _, decode in _FORMATS[record][1]:
        found = getattr(message, name)
        beside[column.name] = found if decode is None else decode(found)
    return build(record, beside)


def message_fields(
    record: type, message: Any, *, beside: Collection[str] = (), own: Collection[str] = ()
) -> tuple[_Field, ...]:
    """Return how the columns of a record are written into the fields of a message and read back.

    A column `<name>_ns` is the time `<name>`, `stamp_ns` the stamp of the header if there is one.

    Parameters
    ----------
    record : type
        Class of the record (`core.records`).
    message : type
        Class of the message.
    beside : collection of str
        Columns that do not travel in the message.
    own : collection of str
        Fields that only the message has.

    Raises
    ------
    TypeError
        If message and record do not fit together: which field of which, and what to do.
    """
    kinds = dict(message.get_fields_and_field_types())
    where, fields = f"{message.__name__}.msg", []
    for column in columns(record):
        if column.name in beside:
            continue
        name = column.name.removesuffix("_ns")
        name = "header" if name == "stamp" and "header" in kinds else name
        kind = kinds.pop(name, "missing")
        if kind not in _FORMS[column.many, _base(column)]:
            wanted = " or ".join(_FORMS[column.many, _base(column)])
            text = (
                f"{where}: field '{name}' is {kind}, but '{column.path}' of {record.__name__}"
                f" needs {wanted}: write it in msg_defs/msg/{where} and build the messages anew"
            )
            raise TypeError(text)
        fields.append(_Field(column, name, _encoder(kind), _decoder(kind, column.kind)))
    left = sorted(set(kinds) - set(own))
    if left:
        text = f"{where}: {record.__name__} has no field for '{left[0]}': add it to the class"
        raise TypeError(text)
    return tuple(fields)


class _Field(NamedTuple):
    """A column of a record in a message."""

    column: Column
    name: str
    encode: Callable[[Any], Any]
    decode: Callable[[Any], Any] | None


TIME: type = Time  # untyped without the built messages
_INTEGERS = ("uint8", "int32", "int64", "uint32", "uint64")
_FORMS = {
    (False, float): ("double",),
    (False, int): _INTEGERS,
    (False, bool): ("boolean",),
    (False, str): ("string",),
    (False, IntEnum): ("uint8",),
    (False, TIME): ("builtin_interfaces/Time", "std_msgs/Header"),
    (True, float): ("sequence<double>",),
    (True, bool): ("sequence<boolean>",),
    (True, str): ("sequence<string>",),
    (True, IntEnum): ("sequence<uint8>",),
    (True, int): tuple(f"sequence<{name}>" for name in _INTEGERS),
}
"""Types that a column may have in a message: of one value and of a list."""


def _base(column: Column) -> type:
    kind: type = IntEnum if issubclass(column.kind, IntEnum) else column.kind
    return TIME if column.name.endswith("_ns") else kind


def _same(value: Any) -> Any:
    return value


def _encoder(kind: str) -> Callable[[Any], Any]:
    if kind == "std_msgs/Header":
        return lambda stamp_ns: Header(stamp=to_time(stamp_ns))
    casts: dict[str, Callable[[Any], Any]] = {
        "builtin_interfaces/Time": to_time,
        "double": float,
        "boolean": bool,
        "string": _same,
    }
    arrays = {"sequence<double>": "d", "sequence<uint8>": "B"}
    if kind in arrays:
        return partial(array, arrays[kind])
    return _same if kind.startswith("sequence") else casts.get(kind, int)


def _decoder(kind: str, of: type) -> Callable[[Any], Any] | None:
    """Return how the value of a field is read; None where it is what the record holds."""
    if kind == "std_msgs/Header":
        return lambda header: from_time(header.stamp)
    if kind == "builtin_interfaces/Time":
        return from_time
    if not issubclass(of, IntEnum):
        return None
    return (lambda values: map(of, values)) if kind.startswith("sequence") else of


_ESTIMATE_OWN = ("header", "valve", "units", "at_bound", "stored", "wall_time")
_ESTIMATE_BESIDE = ("missed_cycles", "samples_masked_bad")
_FORMATS: dict[type, tuple[Any, tuple[_Field, ...]]] = {
    Estimate: (
        msg.Estimate,
        message_fields(Estimate, msg.Estimate, beside=_ESTIMATE_BESIDE, own=_ESTIMATE_OWN),
    ),
    **{
        record: (message, message_fields(record, message))
        for record, message in (
            (Trend, msg.Trend),
            (Verdict, msg.Verdict),
            (Maintenance, msg.Maintenance),
            (Event, msg.Event),
        )
    },
}
