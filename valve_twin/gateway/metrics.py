# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valves of a history as metrics of Prometheus."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.faults.ne107 import Ne107

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.aging.verdict import Trend
    from valve_twin.gateway.view import View
    from valve_twin.io.history.fleet import FleetRow

TYPE = "text/plain; version=0.0.4; charset=utf-8"

_NUMBERS: tuple[tuple[str, str, tuple[str, ...], Callable[[FleetRow], float]], ...] = (
    ("valve_twin_cycle", "Last stored cycle [1].", (), lambda r: r.cycle),
    (
        "valve_twin_end_seconds",
        "Last stamp of it on the data's clock [s].",
        (),
        lambda r: r.end_ns * 1e-9,
    ),
    (
        "valve_twin_drift_percent",
        "Change of the worst parameter [%].",
        ("parameter",),
        lambda r: r.drift,
    ),
    (
        "valve_twin_way_ratio",
        "Share of the way to its limit that is surely covered [1].",
        ("parameter",),
        lambda r: r.way,
    ),
    (
        "valve_twin_remaining",
        "Remaining life, median [unit of the label axis].",
        ("parameter", "axis"),
        lambda r: r.remaining,
    ),
    (
        "valve_twin_residual",
        "One-step residual of the newest cycles, RMS [1].",
        (),
        lambda r: r.residual,
    ),
    (
        "valve_twin_confidence_ratio",
        "Share of the newest estimates that are trusted [1].",
        (),
        lambda r: r.confidence,
    ),
    ("valve_twin_cycles", "Production cycles counted [1].", (), lambda r: r.cycles),
    ("valve_twin_movements", "Movements beyond the noise [1].", (), lambda r: r.movements),
    ("valve_twin_reversals", "Changes of direction [1].", (), lambda r: r.reversals),
    ("valve_twin_starts", "Movements out of a rest [1].", (), lambda r: r.starts),
    ("valve_twin_travel", "Way of the position [its unit].", (), lambda r: r.travel),
    ("valve_twin_strokes", "Travel by the stroke [1].", (), lambda r: r.strokes),
    ("valve_twin_hours", "Time in cycles [h].", (), lambda r: r.hours),
    ("valve_twin_hours_open", "Time open [h].", (), lambda r: r.hours_open),
    ("valve_twin_hours_closed", "Time closed [h].", (), lambda r: r.hours_closed),
    (
        "valve_twin_hours_near_closed",
        "Time open by less than a tenth of the stroke [h].",
        (),
        lambda r: r.hours_near_closed,
    ),
    (
        "valve_twin_open_events",
        "Entries of the event log that nobody has acknowledged [1].",
        (),
        lambda r: r.open_events,
    ),
)
"""Name, text, labels beside the valve and value: one number a valve."""

_OF_PARAMETERS: tuple[tuple[str, str, Callable[[Trend], float]], ...] = (
    ("valve_twin_parameter", "Level of a parameter [unit].", lambda t: t.level),
    (
        "valve_twin_parameter_lower_95",
        "Lower end of its 95 % interval [unit].",
        lambda t: t.mean_lower_95,
    ),
    (
        "valve_twin_parameter_upper_95",
        "Upper end of its 95 % interval [unit].",
        lambda t: t.mean_upper_95,
    ),
    ("valve_twin_parameter_limit", "Its service limit [unit].", lambda t: t.threshold),
    ("valve_twin_parameter_warning", "Its warning limit [unit].", lambda t: t.warning),
    (
        "valve_twin_parameter_limit_state",
        "Where it stands: 0 not known, 1 within, 2 warning, 3 alarm.",
        lambda t: float(t.limit_state),
    ),
)
"""Name, text and value: one number a followed parameter."""


def exposition(view: View) -> bytes:
    """Return the metrics of all valves in the text format; what is not known is left out.

    So is a valve that is yet to be assessed; `valve_twin_history_whole` is 0 then. And so is one
    that is stale: the history cannot be read, `valve_twin_history_up` is 0, and no node tells it.

    Parameters
    ----------
    view : View
        What the history holds.
    """
    from prometheus_client import CollectorRegistry, Gauge, generate_latest

    registry = CollectorRegistry()
    up = Gauge("valve_twin_history_up", "1 where the history could be read.", registry=registry)
    up.set(not view.failure)
    whole = Gauge(
        "valve_twin_history_whole",
        "1 where every valve was assessed, 0 during a first reading.",
        registry=registry,
    )
    whole.set(view.whole)
    read = Gauge(
        "valve_twin_history_read_seconds",
        "When it was read last [s since 1970]; 0 = never.",
        registry=registry,
    )
    read.set(view.read_ns * 1e-9)
    rows = [
        row
        for row in view.rows
        if (view.whole or row.valve in view.trends) and not view.is_stale(row.valve)
    ]
    states = Gauge(
        "valve_twin_ne107",
        "1 for the state of NAMUR NE 107.",
        ["valve", "state"],
        registry=registry,
    )
    verdicts = Gauge(
        "valve_twin_verdict", "1 for the verdict.", ["valve", "verdict"], registry=registry
    )
    for row in rows:
        for state in Ne107:
            states.labels(row.valve, state.value).set(row.ne107 == state.value)
        for kind in VerdictKind:
            verdicts.labels(row.valve, kind.text).set(row.verdict is kind)
    for name, text, labels, value in _NUMBERS:
        gauge = Gauge(name, text, ["valve", *labels], registry=registry)
        for row in rows:
            if not math.isnan(value(row)):
                of_row = (str(getattr(row, label)) for label in labels)
                gauge.labels(row.valve, *of_row).set(value(row))
    for name, text, number in _OF_PARAMETERS:
        gauge = Gauge(name, text, ["valve", "parameter", "unit"], registry=registry)
        for row in rows:
            for trend in view.trends.get(row.valve, ()):
                if math.isfinite(number(trend)):
                    gauge.labels(row.valve, trend.parameter, trend.unit).set(number(trend))
    found: bytes = generate_latest(registry)
    return found
