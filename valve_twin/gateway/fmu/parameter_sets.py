# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameter sets of an FMU as SSV (SSP 1.0): the valve at a later date, and draws of its doubt."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from math import isfinite, nan
from typing import TYPE_CHECKING

import numpy as np

from valve_twin import __version__
from valve_twin.core.aging.verdict import TrendStatus
from valve_twin.core.estimation.data.robust import NORMAL_975
from valve_twin.core.types import ParameterStatus
from valve_twin.gateway.fmu.description import base_units, xml_bytes
from valve_twin.io.errors import FmuError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime

    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.types import Estimate
    from valve_twin.core.valves.kit import Law
    from valve_twin.gateway.fmu.valve import FmuValve

_VALUES = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
_COMMON = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_NS = 1e-9


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """Values for the parameters of an FMU.

    Attributes
    ----------
    name, text : str
        Name of the set, and where its values come from in one line.
    values : mapping
        By name [unit of each].
    """

    name: str
    text: str
    values: Mapping[str, float]


def aged_set(
    valve: FmuValve, law: Law, trends: Sequence[Trend], date: datetime
) -> tuple[ParameterSet, tuple[str, ...]]:
    """Return the valve as its trends say that it will be at a date.

    A parameter that drifts moves on along its line at the recent rate of cycles; any other keeps
    the value of the FMU. Nothing leaves the bounds of the law.

    Parameters
    ----------
    valve : FmuValve
        The valve.
    law : Law
        Its law, for the bounds.
    trends : sequence of Trend
        Trends of its parameters.
    date : datetime
        With its time zone; not before the last cycle.

    Returns
    -------
    tuple
        The set, and one line for each parameter that was moved or kept, and why.

    Raises
    ------
    FmuError
        If the date lies before the newest cycle of a trend; one line.
    """
    known = {t.parameter: t for t in trends}
    values, lines = {}, []
    for p, q in zip(law.parameters, valve.parameters, strict=True):
        trend = known.get(p.name)
        values[p.name], why = _aged(trend, q.start, date)
        limited = min(max(values[p.name], p.published.lower), p.published.upper)
        if limited != values[p.name]:
            values[p.name], why = limited, f"{why}; kept inside the law's bounds"
        lines.append(f"{p.name} = {limited:.6g} {p.published.unit}: {why}")
    day = f"{date:%Y-%m-%d}"
    text = f"aged to {day} by its trends ({'; '.join(lines)}); {valve.text}"
    return ParameterSet(f"aged_{day}", text, values), tuple(lines)


def _aged(trend: Trend | None, start: float, date: datetime) -> tuple[float, str]:
    if trend is None:
        return start, "not followed, as in the FMU"
    if trend.status not in (TrendStatus.DRIFTING, TrendStatus.BEYOND_THRESHOLD):
        word = trend.status.name.lower().replace("_", " ")
        return start, f"{word}, as in the FMU"
    ahead_s = date.timestamp() - trend.stamp_ns * _NS
    if ahead_s < 0.0:
        msg = f"{date:%Y-%m-%d}: lies before the last cycle of the history; give a later date"
        raise FmuError(msg)
    moved = trend.slope * trend.cycle_rate * ahead_s
    if not isfinite(moved):
        return start, "drifts, but the rate of cycles is not known; as in the FMU"
    return trend.level + moved, f"{trend.level:.6g} at the last cycle, {moved:+.3g} by its trend"


def draw_sets(
    valve: FmuValve, law: Law, estimate: Estimate, count: int, seed: int
) -> list[ParameterSet]:
    """Return draws of the parameters from their 95 % intervals, normal and independent (assumed).

    The history keeps no covariances, so none can be drawn. A parameter on its bound, or without
    an interval, stays as it is; nothing leaves the bounds of the law.

    Parameters
    ----------
    valve : FmuValve
        The valve.
    law : Law
        Its law, for the bounds.
    estimate : Estimate
        The estimate that the valve was made from.
    count : int
        How many.
    seed : int
        Of the random numbers: the same one gives the same sets.
    """
    random = np.random.default_rng(seed)
    found = {p.name: p for p in estimate.parameters}
    sets = []
    for k in range(1, count + 1):
        values = {}
        for p, q in zip(law.parameters, valve.parameters, strict=True):
            one = found.get(p.name)
            sigma = 0.5 * (one.upper_95 - one.lower_95) / NORMAL_975 if one else nan
            known = one and one.status is ParameterStatus.OK and isfinite(sigma + one.value)
            value = q.start + (sigma * float(random.standard_normal()) if known else 0.0)
            values[p.name] = min(max(value, p.published.lower), p.published.upper)
        text = f"draw {k} of {count}, seed {seed}, from the 95 % intervals of {valve.text}"
        sets.append(ParameterSet(f"draw_{k:02d}", text, values))
    return sets


def ssv(valve: FmuValve, values: ParameterSet) -> bytes:
    """Return a set as an SSV file.

    Parameters
    ----------
    valve : FmuValve
        The valve, for the units.
    values : ParameterSet
        The set.
    """
    ET.register_namespace("ssv", _VALUES)
    ET.register_namespace("ssc", _COMMON)
    root = ET.Element(
        f"{{{_VALUES}}}ParameterSet",
        {
            "version": "1.0",
            "name": values.name,
            "description": values.text,
            "generationTool": f"valve_twin {__version__}",
        },
    )
    section = ET.SubElement(root, f"{{{_VALUES}}}Parameters")
    units: dict[str, dict[str, int]] = {}
    for q in valve.parameters:
        one = ET.SubElement(section, f"{{{_VALUES}}}Parameter", {"name": q.name})
        number = {"value": repr(values.values[q.name])}
        base = base_units(q.unit) if q.unit else None
        if base is not None:  # every unit of an SSV has to say what it is made of
            number["unit"] = q.unit
            units[q.unit] = base
        ET.SubElement(one, f"{{{_VALUES}}}Real", number)
    if units:
        section = ET.SubElement(root, f"{{{_VALUES}}}Units")
    for unit, base in units.items():
        one = ET.SubElement(section, f"{{{_COMMON}}}Unit", {"name": unit})
        ET.SubElement(one, f"{{{_COMMON}}}BaseUnit", {k: str(n) for k, n in base.items()})
    return xml_bytes(root)
