# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The estimator `dimensions`: sizes from each cycle, and which has drifted since the first ones.

The means of the first cycles travel with the estimates, as the reference of the features does: so
what is said is a function of the cycle and of the estimates before it. After maintenance with a
new reference the first cycles are those from the event on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics.coenergy_tables import CoenergyTables
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import EstimateStatus, Guard, MaskCounts, ParameterValue
from valve_twin.core.valves.double_solenoid.dimensions.fit import UNFOLLOWED, fit_dimensions
from valve_twin.core.valves.double_solenoid.dimensions.judge import (
    NONE,
    REFERENCE_CYCLES,
    UNKNOWN,
    Drift,
    judge,
)
from valve_twin.core.valves.double_solenoid.dimensions.published import (
    COMPANIONS,
    CYCLE,
    DRIFT,
    ESTIMATOR,
    FIRST,
    FIRST_CYCLE,
    FORCE_GAIN,
    TOLD,
    UNITS,
    causes_of,
)
from valve_twin.core.valves.double_solenoid.dimensions.table import table_of
from valve_twin.core.valves.kit.outcome import Evidence, blank, conclude, not_excited

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import Cycle, Estimate, FloatArray
    from valve_twin.core.valves.double_solenoid.dimensions.fit import DimensionFit
    from valve_twin.core.valves.double_solenoid.motion import MotionFit
    from valve_twin.core.valves.double_solenoid.parameters import DoubleSolenoidOptions
    from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
    from valve_twin.core.valves.double_solenoid.record import Record

_MODEL = "double_solenoid"


def judge_cycle(
    cycle: Cycle,
    measured: tuple[Record, MotionFit | None],
    valve: DoubleSolenoidPlant,
    options: DoubleSolenoidOptions,
    earlier: Sequence[Estimate],
) -> tuple[Estimate, tuple[Guard, ...]]:
    """Return the dimensions of a cycle, and the check that they make of all its estimates.

    Parameters
    ----------
    cycle : Cycle
        The cycle.
    measured : tuple
        Its record and what `fit_motion` found.
    valve : DoubleSolenoidPlant
        The valve of the design.
    options : DoubleSolenoidOptions
        With the changes of its coenergy.
    earlier : sequence of Estimate
        Estimates of the cycles before, oldest first.
    """
    fit, names, refusal = _fit(*measured, valve, options)
    if fit is None:
        values = blank((f"{CYCLE}{n}" for n in (*COMPANIONS, *names)), refusal)
        judgement = EstimateStatus.REFUSED, refusal
        return conclude(_MODEL, ESTIMATOR, cycle, values, judgement, Evidence(MaskCounts(0))), ()
    values, drift, line = judged(fit, names, earlier, cycle)
    judgement = EstimateStatus.ACCEPTED, line
    evidence = Evidence(MaskCounts(len(measured[0].x)), fit.condition)
    told = conclude(_MODEL, ESTIMATOR, cycle, values, judgement, evidence)
    return told, (guard_of(drift, line),)


def _fit(
    record: Record,
    motion: MotionFit | None,
    valve: DoubleSolenoidPlant,
    options: DoubleSolenoidOptions,
) -> tuple[DimensionFit | None, tuple[str, ...], str]:
    """Return the fit of a cycle, the names of its dimensions, and why there is none."""
    try:
        table = table_of(options)
    except ValueError as error:
        return None, (), Refusal(RefusalCode.OPTIONS, str(error))
    if not isinstance(valve.tables(), CoenergyTables):
        text = "the estimator 'dimensions' needs a map of both coils (map_coenergy)"
        return None, table.names, Refusal(RefusalCode.OPTIONS, text)
    if not record.known.all():
        bad = int(np.count_nonzero(~record.known))
        text = f"{bad} samples cannot be used: the flux balance has no room for gaps"
        return None, table.names, Refusal(RefusalCode.NOT_EXCITED, text)
    if motion is None:
        text = f"{UNFOLLOWED}: too little of it is off the stops"
        return None, table.names, Refusal(RefusalCode.NOT_EXCITED, text)
    known = valve.valve(), valve.tables()
    fit = fit_dimensions(record, *known, table, motion.values)
    if isinstance(fit, Refusal):
        return None, table.names, fit
    return fit, table.names, ""


def judged(
    fit: DimensionFit, names: Sequence[str], earlier: Sequence[Estimate], cycle: Cycle
) -> tuple[tuple[ParameterValue, ...], Drift, str]:
    """Return all parameters of a cycle, its verdict, and that in one line.

    Parameters
    ----------
    fit : DimensionFit
        Of this cycle.
    names : sequence of str
        Its dimensions.
    earlier : sequence of Estimate
        Estimates of the cycles before, oldest first.
    cycle : Cycle
        Its number, and since when it is compared.
    """
    fitted = (*COMPANIONS, *names)
    past = [e for e in earlier
            if e.estimator == ESTIMATOR and e.status is not EstimateStatus.REFUSED
            and e.cycle >= cycle.since]  # fmt: skip
    known = [(e.cycle, _row(e, CYCLE, fitted)) for e in past]
    known = [(n, row) for n, row in known if np.isfinite(row).all()] + [(cycle.number, fit.values)]
    rows = [row for _, row in known]
    kept = _row(past[-1], "", (FIRST_CYCLE, *(f"{FIRST}{n}" for n in fitted))) if past else None
    begun, first = (np.nan, np.full(len(fitted), np.nan)) if kept is None else (kept[0], kept[1:])
    if not (begun >= cycle.since and np.isfinite(first).all()):  # none yet, or before the event
        begun, first = known[0][0], np.full(len(fitted), np.nan)
        if len(rows) >= REFERENCE_CYCLES:
            first = np.mean(rows[:REFERENCE_CYCLES], axis=0)
    values = [ParameterValue(f"{CYCLE}{n}", float(v))
              for n, v in zip(fitted, fit.values, strict=True)]  # fmt: skip
    causes = causes_of(names)
    if not np.isfinite(first).all():
        return tuple(values), Drift(NONE), f"no reference before {REFERENCE_CYCLES} cycles"
    values += [ParameterValue(f"{FIRST}{n}", float(v)) for n, v in zip(fitted, first, strict=True)]
    values.append(ParameterValue(FIRST_CYCLE, float(begun)))
    drift = Drift(NONE)
    if len(rows) >= REFERENCE_CYCLES:
        newest = np.array(rows[-REFERENCE_CYCLES:])
        drift = judge(first, newest, fit.covariance, causes)
    for cause in causes:
        name = f"{DRIFT}{cause.name}"
        if cause.name == drift.name:
            half = drift.upper - drift.size
            values.append(ParameterValue(
                name, drift.size, standard_error=half / 2.0, lower_95=drift.lower,
                upper_95=drift.upper))  # fmt: skip
        else:
            also = cause.name in drift.rivals
            why = f"fits as well as {drift.name}" if also else "the cycles do not name it"
            values.append(not_excited(name, why))
    return tuple(values), drift, said(drift)


def said(drift: Drift) -> str:
    """Return a verdict in one line."""
    if drift.name == NONE:
        return "no dimension has drifted"
    if drift.name == UNKNOWN:
        return (
            f"something has drifted that no single dimension explains: the best leaves "
            f"{100.0 * drift.left:.0f} %"
        )
    unit, factor = ("N", 1.0) if UNITS.get(drift.name) == "N" else ("%", 100.0)
    size, low, high = (factor * v for v in (drift.size, drift.lower, drift.upper))
    also = f"; the data fit as well: {', '.join(drift.rivals)}" if drift.rivals else ""
    return (
        f"{drift.name} has drifted by {size:.3g} {unit} ({low:.3g} to {high:.3g} {unit}): "
        f"{TOLD[drift.name]}{also}"
    )


def guard_of(drift: Drift, line: str) -> Guard:
    """Return the check that a verdict stands for, beside the estimates that feed the trends."""
    passed = drift.name in {NONE, FORCE_GAIN}
    return Guard(f"dimension: {drift.name}", passed, drift.size, float("nan"), line)


def _row(of: Estimate, prefix: str, names: Sequence[str]) -> FloatArray:
    known = {p.name: p.value for p in of.parameters if p.name.startswith(prefix)}
    return np.array([known.get(f"{prefix}{n}", np.nan) for n in names])
