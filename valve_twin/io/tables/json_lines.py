# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Results as lines of JSON: one object an estimate, then the trends, then the verdict.

Strict JSON has neither NaN nor infinity: a number that is not known is null, an unbounded one the
word "Infinity", which most languages read as a number.
"""

from __future__ import annotations

import dataclasses
import json
import math
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING, Any

from valve_twin.core.valves.registry import get_model

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.aging import Assessment
    from valve_twin.core.types import Estimate


def estimate_fields(estimate: Estimate, valve: str) -> dict[str, Any]:
    """Return an estimate as plain data under the names of Estimate.msg.

    A value that is not a number is null. `header`, `start` and `end` are integers of nanoseconds
    (`start_ns`, `end_ns`), statuses are words. `wall_time` and `stored` are left out, so that the
    same record gives the same lines.
    """
    parameters = estimate.parameters
    units = _units(estimate.model)
    return {
        "kind": "estimate",
        "valve": valve,
        "model": estimate.model,
        "estimator": estimate.estimator,
        "cycle": estimate.cycle,
        "start_ns": estimate.start_ns,
        "end_ns": estimate.end_ns,
        "names": [p.name for p in parameters],
        "units": [units[p.name] for p in parameters],
        "values": [_plain(p.value) for p in parameters],
        "standard_errors": [_plain(p.standard_error) for p in parameters],
        "lower_95": [_plain(p.lower_95) for p in parameters],
        "upper_95": [_plain(p.upper_95) for p in parameters],
        "at_bound": [p.status.name == "AT_BOUND" for p in parameters],
        "parameter_status": [p.status.name for p in parameters],
        "parameter_reason": [p.reason for p in parameters],
        "status": estimate.status.name,
        "reason": estimate.reason,
        "mse_test": _plain(estimate.mse_test),
        "mse_train": _plain(estimate.mse_train),
        "fit_test": _plain(estimate.fit_test),
        "fit_train": _plain(estimate.fit_train),
        "condition_number": _plain(estimate.condition_number),
        "lag": estimate.lag,
        "noise_sigma": _plain(estimate.noise_sigma),
        "samples_used": estimate.counts.used,
        "samples_masked_seat": estimate.counts.seat,
        "samples_masked_stuck": estimate.counts.stuck,
        "samples_masked_stale": estimate.counts.stale,
        "missed_cycles": estimate.missed_cycles,
        "used_by_trend": estimate.used_by_trend,
        "trend_reason": estimate.trend_reason,
        "disagreement_estimator": [d.estimator for d in estimate.disagreements],
        "disagreement_parameter": [d.parameter for d in estimate.disagreements],
        "disagreement": [_plain(d.difference) for d in estimate.disagreements],
        "disagreement_errors": [_plain(d.standard_errors) for d in estimate.disagreements],
        "guard_names": [g.name for g in estimate.guards],
        "guard_passed": [g.passed for g in estimate.guards],
        "guard_values": [_plain(g.value) for g in estimate.guards],
        "guard_limits": [_plain(g.limit) for g in estimate.guards],
        "guard_reasons": [g.reason for g in estimate.guards],
        "condition_names": [c.name for c in estimate.conditions],
        "condition_values": [_plain(c.value) for c in estimate.conditions],
        "reproducible": estimate.reproducible,
    }


@cache
def _units(model: str) -> dict[str, str]:
    return {p.name: p.unit for p in get_model(model).parameters}


def json_lines(
    estimates: list[Estimate], assessment: Assessment | None, valve: str
) -> Iterator[str]:
    """Yield one line of JSON an estimate, a trend and the verdict."""
    for estimate in estimates:
        yield json.dumps(estimate_fields(estimate, valve), allow_nan=False)
    if assessment is None:
        return
    for trend in assessment.trends:
        yield json.dumps({"kind": "trend", "valve": valve, **_fields(trend)}, allow_nan=False)
    verdict = _fields(assessment.verdict)
    yield json.dumps({"kind": "verdict", "valve": valve, **verdict}, allow_nan=False)


def _fields(value: Any) -> dict[str, Any]:  # noqa: ANN401  any of our result types
    return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}


def _plain(value: Any) -> Any:  # noqa: ANN401  any field of our result types
    if isinstance(value, float):  # first: most are
        if math.isfinite(value):
            return value
        return None if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _fields(value)
    return value
