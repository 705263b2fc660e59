# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The actuator's bench records: static forces, free oscillation, current steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.nonlinear import FitStatus
from valve_twin.core.valves.bench_fit import (
    BenchFit,
    BenchPlot,
    BenchResult,
    Column,
    Setting,
    check_time,
    fitted_value,
)
from valve_twin.core.valves.hybrid_actuator.magnetics import KERNELS
from valve_twin.core.valves.hybrid_actuator.ring_down import fit_ring_down, oscillation
from valve_twin.core.valves.hybrid_actuator.static_force import (
    ForceCurve,
    fit_static_force,
    fitted_forces,
)
from valve_twin.core.valves.hybrid_actuator.transient import StepRecord, fit_steps, step_current

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.estimation.solvers.nonlinear import CurveFit
    from valve_twin.core.types import FloatArray

_UNITS = {"beta": "N m^2/A^2", "kappa": "m", "saturation_flux": "Wb", "c1": "m/A", "c2": "m",
          "c3": "1/A", "force_offset": "N"}  # fmt: skip
_FEWEST_GAPS = 3


def _doubt(fit: CurveFit) -> str:
    return "" if fit.status in {FitStatus.OK, FitStatus.AT_BOUND} else fit.status.value


def _remark(fit: CurveFit) -> str:
    return f"{fit.status.value}; R^2 {fit.r_square:.6f}, {fit.freedom} degrees of freedom"


def static_force(
    columns: Mapping[str, FloatArray], settings: Mapping[str, float | str]
) -> BenchResult:
    """Fit the kernel of a solenoid to forces over gap at held currents.

    Parameters
    ----------
    columns : mapping
        gap [m], force [N], current [A], (N,) each; rows of one current make a curve.
    settings : mapping
        kernel: one of `KERNELS`.
    """
    kernel = str(settings["kernel"])
    gap, force, current = (columns[name] for name in ("gap", "force", "current"))
    levels = np.unique(current)
    curves = []
    for level in levels:
        at = np.flatnonzero(current == level)
        if len(at) < _FEWEST_GAPS:
            message = (
                f"current = {level:g} A: {len(at)} forces; a curve needs {_FEWEST_GAPS} or more "
                "at the same current"
            )
            raise ValueError(message)
        at = at[np.argsort(gap[at])]
        curves.append(ForceCurve(gap[at], force[at], float(level)))
    if kernel != KERNELS[0] and len(curves) < 2:
        message = f"one current, {levels[0]:g} A: a kernel that saturates needs two or more"
        raise ValueError(message)
    fit = fit_static_force(curves, kernel)
    values = tuple(
        fitted_value(fit, name, _UNITS[name], lambda p, k=k: float(p[k]))  # type: ignore[misc]
        for k, name in enumerate(fit.names)
    )
    fine = np.linspace(float(gap.min()), float(gap.max()), 200)
    plot = BenchPlot(
        "gap [mm]",
        "force [N]",
        tuple((1e3 * c.gap, c.force) for c in curves),
        tuple((1e3 * fine, fitted_forces(kernel, fit, fine, c.current)) for c in curves),
    )
    return BenchResult(values, (plot,), _remark(fit), _doubt(fit))


def ring_down(
    columns: Mapping[str, FloatArray], settings: Mapping[str, float | str]
) -> BenchResult:
    """Fit a decaying oscillation: damping ratio, frequency, mass and damping.

    Parameters
    ----------
    columns : mapping
        time [s], position [m], (N,) each.
    settings : mapping
        spring_rate [N/m].
    """
    time_s, position = columns["time"], columns["position"]
    check_time(time_s)
    rate = float(settings["spring_rate"])
    fit = fit_ring_down(time_s, position, rate).fit
    at = {name: k for k, name in enumerate(fit.names)}

    def natural(p: FloatArray) -> float:
        return float(np.hypot(p[at["decay"]], p[at["frequency"]]))

    values = (
        fitted_value(fit, "damping_ratio", "1", lambda p: float(p[at["decay"]]) / natural(p)),
        fitted_value(fit, "natural_frequency", "rad/s", natural),
        fitted_value(fit, "mass", "kg", lambda p: rate / natural(p) ** 2),
        fitted_value(
            fit, "damping", "N s/m", lambda p: 2.0 * float(p[at["decay"]]) * rate / natural(p) ** 2
        ),
    )
    since = time_s - time_s[0]
    shown = ((1e3 * since, 1e3 * oscillation(since, fit.values)),)
    plot = BenchPlot("time [ms]", "position [mm]", ((1e3 * since, 1e3 * position),), shown)
    return BenchResult(values, (plot,), _remark(fit), _doubt(fit))


def current_steps(
    columns: Mapping[str, FloatArray], settings: Mapping[str, float | str]
) -> BenchResult:
    """Fit resistance and inductance to voltage steps on a held armature.

    Parameters
    ----------
    columns : mapping
        time since the step [s], current [A], voltage of the step [V], (N,) each; a new step begins
        where the time goes back or the voltage changes.
    settings : mapping
        Not used.
    """
    del settings
    time_s, current, voltage = (columns[name] for name in ("time", "current", "voltage"))
    new = np.flatnonzero((np.diff(time_s) < 0.0) | (np.diff(voltage) != 0.0)) + 1
    records = []
    for part in np.split(np.arange(len(time_s)), new):
        check_time(time_s[part])
        records.append(StepRecord(time_s[part], current[part], float(voltage[part[0]])))
    fit = fit_steps(records)
    values = (
        fitted_value(fit, "resistance", "ohm", lambda p: float(p[0])),
        fitted_value(fit, "inductance", "H", lambda p: float(p[1])),
        fitted_value(fit, "time_constant", "s", lambda p: float(p[1] / p[0])),
    )
    plot = BenchPlot(
        "time since the step [ms]",
        "current [A]",
        tuple((1e3 * r.time_s, r.current) for r in records),
        tuple((1e3 * r.time_s, step_current(r.time_s, r.voltage, fit)) for r in records),
    )
    return BenchResult(values, (plot,), _remark(fit), _doubt(fit))


BENCH_FITS = (
    BenchFit(
        "static-force",
        "kernel of a solenoid from forces over the gap at held currents",
        (
            Column("gap", "length", "physical gap"),
            Column("force", "force", "measured force, the magnet's taken off"),
            Column("current", "current", "held current; equal values make a curve"),
        ),
        static_force,
        (Setting("kernel", "law of the solenoid", KERNELS[1], KERNELS),),
    ),
    BenchFit(
        "ring-down",
        "damping, frequency and mass from a free oscillation",
        (
            Column("time", "time", "increasing"),
            Column("position", "length", "of the armature, any origin"),
        ),
        ring_down,
        (Setting("spring_rate", "known spring rate [N/m]"),),
    ),
    BenchFit(
        "current",
        "resistance and inductance from voltage steps on a held armature",
        (
            Column("time", "time", "since the step"),
            Column("current", "current", "of the coil"),
            Column("voltage", "voltage", "of the step, the same in all its rows"),
        ),
        current_steps,
    ),
)
"""Bench records of the actuator of paper 001."""
