# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameter sets of an FMU as SSV (SSP 1.0): the valve at a later date, and draws of its doubt."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from math import isfinite, nan
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import rankdata

from valve_twin import __version__
from valve_twin.core.aging.verdict import TrendStatus
from valve_twin.core.estimation.data.robust import NORMAL_975, robust_sigmas
from valve_twin.gateway.fmu.description import base_units, xml_bytes
from valve_twin.io.errors import FmuError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime

    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.types import Estimate, FloatArray, ParameterValue
    from valve_twin.core.valves.kit import Law
    from valve_twin.gateway.fmu.valve import FmuValve

_VALUES = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
_COMMON = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_NS = 1e-9

LEAST_PAIRS = 30
"""Pairs of cycles from which a correlation is taken at least [1], assumed."""

JUMP = 5.0
"""Changes beyond so many standard deviations, by the median, are no errors [1], assumed."""

PAST = 200
"""Estimates up to the exported cycle that a correlation is taken from [1], assumed."""


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
    valve: FmuValve,
    law: Law,
    estimate: Estimate,
    count: int,
    seed: int,
    past: Sequence[Estimate] = (),
) -> list[ParameterSet]:
    """Return draws of the parameters from their 95 % intervals, normal (assumed).

    What was wrong with two parameters together is taken from estimates before (`correlation`);
    where they are too few, parameters are drawn independently. One on its bound, or without an
    interval, stays as it is; nothing leaves the bounds of the law.

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
    past : sequence of Estimate
        Estimates of the same estimator by cycle, for the correlation.
    """
    random = np.random.default_rng(seed)
    sigmas = {p.name: _sigma(p) for p in estimate.parameters if p.usable}
    names = [p.name for p in law.parameters if isfinite(sigmas.get(p.name, nan))]
    found = correlation(past, names)
    root = np.eye(len(names)) if found is None else _root(found.matrix)
    beside = (
        f"independent: fewer than {LEAST_PAIRS} pairs of cycles tell what goes together"
        if found is None
        else f"correlated as the estimates of {found.pairs} pairs of cycles up to it"
    )
    sets = []
    for k in range(1, count + 1):
        drawn = dict(zip(names, root @ random.standard_normal(len(names)), strict=True))
        values = {}
        for p, q in zip(law.parameters, valve.parameters, strict=True):
            value = q.start + (sigmas[p.name] * float(drawn[p.name]) if p.name in drawn else 0.0)
            values[p.name] = min(max(value, p.published.lower), p.published.upper)
        text = f"draw {k} of {count}, seed {seed}, from the 95 % intervals, {beside}; {valve.text}"
        sets.append(ParameterSet(f"draw_{k:02d}", text, values))
    return sets


def _sigma(p: ParameterValue) -> float:
    """Return the standard deviation of an estimate by its interval; NaN where there is none."""
    sigma = 0.5 * (p.upper_95 - p.lower_95) / NORMAL_975
    return sigma if isfinite(p.value) else nan


@dataclass(frozen=True, slots=True)
class Correlation:
    """How the errors of estimates go together.

    Attributes
    ----------
    matrix : (P, P) array
        Correlation [1].
    pairs : int
        Pairs of cycles that it was taken from [1].
    """

    matrix: FloatArray
    pairs: int


def correlation(past: Sequence[Estimate], names: Sequence[str]) -> Correlation | None:
    """Return how the errors of estimates go together, from the changes between two cycles.

    No estimate carries a covariance. What changes from one cycle to the next is error but for
    what the valve itself did, so its correlation is that of the errors (assumed). By ranks and
    without jumps, as maintenance and bad cycles make changes that are no errors; two parameters
    whose correlation cannot be told from none have none.

    Parameters
    ----------
    past : sequence of Estimate
        Of one estimator, by cycle; what is not usable is passed over.
    names : sequence of str
        The P parameters.

    Returns
    -------
    Correlation or None
        None where fewer than `LEAST_PAIRS` pairs know all parameters, or fewer than two are asked.
    """
    rows = []
    for estimate in past:
        known = {p.name: p.value for p in estimate.parameters if p.usable}
        rows.append([known.get(name, nan) for name in names])
    changes = np.diff(np.array(rows), axis=0) if len(rows) > 1 else np.empty((0, len(names)))
    changes = changes[np.isfinite(changes).all(axis=1)]
    if len(changes):
        apart = np.abs(changes - np.median(changes, axis=0))
        changes = changes[(apart <= JUMP * robust_sigmas(apart)).all(axis=1)]
    pairs = len(changes)
    if pairs < LEAST_PAIRS or len(names) < 2:
        return None
    ranks = np.apply_along_axis(rankdata, 0, changes)
    with np.errstate(invalid="ignore"):  # of a parameter that never changed
        by_ranks = np.nan_to_num(np.atleast_2d(np.corrcoef(ranks, rowvar=False)))
    matrix = 2.0 * np.sin(np.pi / 6.0 * by_ranks)  # of two normal ones by their ranks
    # a change has the error of the cycle between in common with the next one: 3/2 of the variance
    matrix[np.abs(matrix) < NORMAL_975 * np.sqrt(1.5 / pairs)] = 0.0
    np.fill_diagonal(matrix, 1.0)
    return Correlation(matrix, pairs)


def _root(matrix: FloatArray) -> FloatArray:
    """Return a (P, P) root of the nearest correlation matrix that has no negative variance."""
    values, vectors = np.linalg.eigh(matrix)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(root / np.linalg.norm(root, axis=1)[:, None], dtype=float)


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
