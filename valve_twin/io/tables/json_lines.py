# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Results as lines of JSON: one object an estimate, then trends, verdict, advice, counters.

Strict JSON has neither NaN nor infinity: a number that is not known is null, an unbounded one the
word "Infinity", which most languages read as a number.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from enum import IntEnum
from functools import cache
from typing import TYPE_CHECKING, Any

from valve_twin.core.diagnosis.generic.reference import published
from valve_twin.core.faults.advice import advise
from valve_twin.core.quantity import listed
from valve_twin.core.records import columns, flat, once_a_record
from valve_twin.core.types import ParameterStatus
from valve_twin.core.valves.registry import get_model

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from valve_twin.core.aging.assess import Assessment
    from valve_twin.core.faults.advice import Advice
    from valve_twin.core.operation.counters import Counters
    from valve_twin.core.types import Estimate

_line = json.JSONEncoder(allow_nan=False).encode
"""One record as a line of JSON."""

FILES = 3
"""Files that are named where there are many; the others are counted [1]."""

_FIRST = (
    "kind", "valve", "model", "estimator", "cycle", "start_ns", "end_ns", "names", "units",
    "values", "standard_errors", "lower_95", "upper_95", "at_bound",
)  # fmt: skip
"""What a line of an estimate begins with; the other columns follow in their own order."""


def estimate_fields(estimate: Estimate, valve: str) -> dict[str, Any]:
    """Return an estimate as plain data under the names of Estimate.msg.

    A value that is not a number is null. `header`, `start` and `end` are integers of nanoseconds
    (`start_ns`, `end_ns`), statuses are words. `wall_time` and `stored` are left out, so that the
    same record gives the same lines.
    """
    units, parameters = _units(estimate.model), estimate.parameters
    fields: dict[str, Any] = {
        "kind": "estimate",
        "valve": valve,
        "units": [units[p.name] for p in parameters],
        "at_bound": [p.status is ParameterStatus.AT_BOUND for p in parameters],
        **_fields(estimate),
    }
    del fields["samples_masked_bad"]  # neither has the message
    return {name: fields.pop(name) for name in _FIRST} | fields


@cache
def _units(model: str) -> dict[str, str]:
    return {p.name: p.unit for p in published(get_model(model))}


def json_lines(
    estimates: list[Estimate],
    assessment: Assessment | None,
    valve: str,
    counters: Counters | None = None,
    files: Mapping[int, Sequence[str]] | None = None,
) -> Iterator[str]:
    """Yield one line of JSON an estimate, a trend, the verdict, what it asks for, the counters.

    Parameters
    ----------
    estimates : list of Estimate
        In their order.
    assessment : Assessment, optional
        Trends and verdict; None = neither.
    valve : str
        Name of the valve.
    counters : Counters, optional
        What the valve did in these cycles; None = not counted.
    files : mapping, optional
        By cycle, the imported files that it comes from, for `file` of an estimate.
    """
    for estimate in estimates:
        fields = estimate_fields(estimate, valve)
        if files:
            fields["file"] = listed(files.get(estimate.cycle, ()), FILES)
        yield _line(fields)
    if assessment is None:
        return
    for trend in assessment.trends:
        yield _line({"kind": "trend", "valve": valve, **_fields(trend)})
    verdict = {"kind": "verdict", "valve": valve, **_fields(assessment.verdict)}
    yield _line(verdict)
    advice = advise(assessment.verdict, assessment.trends)
    yield _line({"kind": "advice", "valve": valve, **advice_fields(advice)})
    if counters is not None:
        yield _line(counters_fields(valve, counters))


def counters_fields(valve: str, counters: Counters) -> dict[str, Any]:
    """Return the counters of a valve as plain data under the names of Counters.msg.

    Parameters
    ----------
    valve : str
        Name of the valve.
    counters : Counters
        What it has done.
    """
    hours, opened, closed, near = counters.hours
    return {
        "kind": "counters",
        "valve": valve,
        "cycle": counters.cycle,
        "since_ns": counters.since_ns,
        "end_ns": counters.end_ns,
        "cycles": counters.cycles,
        "movements": counters.movements,
        "reversals": counters.reversals,
        "travel": counters.travel,
        "strokes": _number(counters.strokes),
        "hours": hours,
        "starts": counters.starts,
        "hours_open": opened,
        "hours_closed": closed,
        "hours_near_closed": near,
        "span_edges": [_number(edge) for edge in counters.edges],
        "span_counts": list(counters.spans),
    }


def advice_fields(advice: Advice) -> dict[str, str]:
    """Return an advice as plain data, the state in words."""
    return asdict(advice) | {"ne107": advice.ne107.value}


def _fields(value: object) -> dict[str, Any]:
    found: dict[str, Any] = flat(value)
    for name, plain, many in _conversions(type(value)):
        found[name] = plain(found[name]) if many else plain((found[name],))[0]
    return found


@once_a_record
def _conversions(record: type) -> list[tuple[str, Callable[[Any], list[Any]], bool]]:
    """Return the columns whose values are not plain data already."""
    plain: dict[bool, Callable[[Any], list[Any]]] = {True: _numbers, False: _names}
    return [
        (c.name, plain[c.kind is float], c.many)
        for c in columns(record)
        if c.kind is float or issubclass(c.kind, IntEnum)
    ]


def _numbers(values: Sequence[float]) -> list[float | str | None]:
    finite = math.isfinite
    return [x if finite(x) else _number(x) for x in values]


def _names(values: Sequence[IntEnum]) -> list[str]:
    return [x.name for x in values]


def _number(value: float) -> float | str | None:
    if math.isfinite(value):
        return value
    return None if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
