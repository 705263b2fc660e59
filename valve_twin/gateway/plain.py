# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve as plain data, for JSON and the faces that carry values."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

from valve_twin.core.aging.verdict import outlook

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.aging.verdict import Trend
    from valve_twin.gateway.view import NodeFault, View
    from valve_twin.io.history.fleet import FleetRow


def plain_valve(view: View, row: FleetRow) -> dict[str, object]:
    """Return a valve as plain data: a number that is not known or unbounded is null.

    Parameters
    ----------
    view : View
        What the history holds.
    row : FleetRow
        The valve's row in it.
    """
    trends = view.trends.get(row.valve, ())
    found: dict[str, object] = {**asdict(row), "verdict": row.verdict.text}
    plate = dict(view.nameplates.get(row.valve, {}))
    parameters = [_plain_trend(t) for t in trends]
    return {**_known(found), "nameplate": plate, "parameters": parameters}


def plain_words(view: View, row: FleetRow) -> dict[str, object]:
    """Return as plain data what running nodes say of a valve beside its verdict.

    And whether all of it is stale: the history cannot be read, and no node tells it.

    Parameters
    ----------
    view : View
        What is shown.
    row : FleetRow
        The valve's row in it.
    """
    last = view.last.get(row.valve)
    faults = plain_faults(view.faults_of(row.valve))
    return {
        "last": None if last is None else asdict(last),
        "faults": faults,
        "stale": view.is_stale(row.valve),
    }


def plain_faults(faults: Sequence[NodeFault]) -> list[dict[str, object]]:
    """Return faults of nodes as plain data.

    Parameters
    ----------
    faults : sequence of NodeFault
        Worst first.
    """
    plain = [asdict(fault) | {"ne107": fault.ne107.value} for fault in faults]
    return [{key: v for key, v in one.items() if key != "told"} for one in plain]


_OF_TREND = {
    "parameter": "parameter",
    "unit": "unit",
    "level": "level",
    "lower_95": "mean_lower_95",
    "upper_95": "mean_upper_95",
    "reference": "reference",
    "threshold": "threshold",
    "warning": "warning",
    "drift": "drift_reference",
    "drift_lower_95": "drift_reference_lower_95",
    "drift_upper_95": "drift_reference_upper_95",
    "remaining_low": "remaining_low",
    "remaining": "remaining_median",
    "remaining_high": "remaining_high",
    "axis": "axis",
    "reason": "reason",
}
"""Keys of a parameter in JSON by the fields of its trend."""


def _plain_trend(trend: Trend) -> dict[str, object]:
    """Return a parameter as plain data; what remains is null where no forecast is told."""
    said = outlook(trend)
    found = {key: getattr(trend, name) for key, name in _OF_TREND.items()}
    if not said.says_when:
        found["remaining"] = math.inf
    return {**_known(found), "outlook": said.value, "limit_state": trend.limit_state.text}


def _known(values: Mapping[str, object]) -> dict[str, object]:
    return {
        name: None if isinstance(v, float) and not math.isfinite(v) else v
        for name, v in values.items()
    }
