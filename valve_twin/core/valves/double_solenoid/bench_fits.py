# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valve's bench records: linear dynamics between two signals, steps of the setpoint."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import difference_sigma
from valve_twin.core.estimation.solvers.nonlinear import FitStatus
from valve_twin.core.valves.bench_fit import (
    BenchFit,
    BenchPlot,
    BenchResult,
    BenchValue,
    Column,
    check_time,
    fitted_value,
)
from valve_twin.core.valves.double_solenoid.dynamics_fit import (
    filtered,
    fit_coarse_dynamics,
    refined,
    second_order_ms,
)
from valve_twin.core.valves.double_solenoid.plant_kernel import STEP_S
from valve_twin.core.valves.double_solenoid.step_response import judge_step

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray

_MOST_STEPS = 16  # of 12.5 us in a sample
_UNEXPLAINED = 0.1  # rms over the span beyond which it is no such dynamics [1], assumed
_MS = 1e-3


def dynamics(
    columns: Mapping[str, FloatArray], settings: Mapping[str, float | str]
) -> BenchResult:
    """Fit (1 + b1 s + b2 s^2)/(1 + a1 s + a2 s^2) from rest, gain 1 at rest.

    Parameters
    ----------
    columns : mapping
        time [s], sampled evenly at a multiple of 12.5 us; input and output in the same unit, (N,)
        each.
    settings : mapping
        Not used.
    """
    del settings
    time_s, source, answer = (columns[name] for name in ("time", "input", "output"))
    period = check_time(time_s, uniform=True)
    every = round(period / STEP_S)
    if not (1 <= every <= _MOST_STEPS and abs(every * STEP_S - period) < 0.01 * period):
        message = (
            f"sampled every {period:g} s: must be a multiple of {STEP_S:g} s up to "
            f"{_MOST_STEPS * STEP_S:g} s"
        )
        raise ValueError(message)
    if np.ptp(source) == 0.0:
        message = "the input stands still: it excites nothing"
        raise ValueError(message)
    fit = fit_coarse_dynamics(source, answer, every)
    names = ("b1", "b2", "a1", "a2")
    units = ("ms", "ms^2", "ms", "ms^2")
    values = (
        *(
            fitted_value(fit, name, unit, lambda p, k=k: float(p[k]))  # type: ignore[misc]
            for k, (name, unit) in enumerate(zip(names, units, strict=True))
        ),
        fitted_value(fit, "gain_at_high_frequency", "1", lambda p: float(p[1] / p[3])),
    )
    shown = filtered(second_order_ms(fit.values), refined(source, every))[::every]
    rms = float(np.sqrt(np.mean((shown - answer) ** 2)))
    doubt = "" if fit.status in {FitStatus.OK, FitStatus.AT_BOUND} else fit.status.value
    if rms > _UNEXPLAINED * float(np.ptp(answer)):
        doubt = (
            f"the fit leaves {rms:.3g} rms of a span of {np.ptp(answer):.3g}: gain at rest other "
            "than 1, not at rest in the first row, or no such dynamics"
        )
    ms = (time_s - time_s[0]) / _MS
    slowest = float(fit.value("a1"))
    if not doubt and slowest > ms[-1]:
        doubt = (
            f"a1 = {slowest:.3g} ms is longer than the record of {ms[-1]:.3g} ms: gain at rest "
            "other than 1, or no such dynamics"
        )
    plots = (
        BenchPlot("time [ms]", "output", ((ms, answer),), ((ms, shown),)),
        BenchPlot("time [ms]", "input", ((ms, source),)),
    )
    return BenchResult(values, plots, f"{fit.status.value}; leaves {rms:.3g} rms", doubt)


def steps(columns: Mapping[str, FloatArray], settings: Mapping[str, float | str]) -> BenchResult:
    """Return rise, overshoot and settling of every step of the setpoint.

    Parameters
    ----------
    columns : mapping
        time [s], sampled evenly; setpoint and position [m], (N,) each.
    settings : mapping
        Not used.
    """
    del settings
    time_s, setpoint, position = (columns[name] for name in ("time", "setpoint", "position"))
    period = check_time(time_s, uniform=True)
    starts = np.flatnonzero(np.diff(setpoint) != 0.0) + 1
    if not len(starts):
        message = "the setpoint stands still: there is no step"
        raise ValueError(message)
    noise = difference_sigma(np.diff(position, 2), 2)
    values, curves = [], []
    for number, (first, end) in enumerate(zip(starts, [*starts[1:], len(time_s)], strict=True), 1):
        size = float(setpoint[first] - setpoint[first - 1])
        begin = float(position[first - 1])
        way = float(setpoint[first]) - begin
        if end - first < 3 or abs(way) < 10.0 * noise:
            message = (
                f"step {number} at {time_s[first]:g} s: {end - first} samples, {1e6 * way:.3g} um "
                f"to go at a noise of {1e6 * noise:.2g} um: nothing can be told"
            )
            raise ValueError(message)
        share = (position[first:end] - begin) / way
        of = judge_step(time_s[first:end] - time_s[first], share)
        off = 2.0 * noise / abs(way)
        values += [
            BenchValue(f"step {number}", 1e3 * size, np.nan, np.nan, "mm"),
            _timed(f"rise {number}", of.rise_s, period),
            BenchValue(f"overshoot {number}", of.overshoot, max(of.overshoot - off, 0.0),
                       of.overshoot + off, "1"),
            _timed(f"settling {number}", of.settling_s, period),
        ]  # fmt: skip
        curves.append((1e3 * of.time_s, of.position))
    ms = (time_s - time_s[0]) / _MS
    plots = (
        BenchPlot("time [ms]", "setpoint (line), position [mm]", ((ms, 1e3 * position),),
                  ((ms, 1e3 * setpoint),)),
        BenchPlot("time since the step [ms]", "position over the step [1]", (), tuple(curves)),
    )  # fmt: skip
    remark = f"{len(starts)} steps, noise {1e6 * noise:.2g} um, settled within 2 % of the step"
    return BenchResult(tuple(values), plots, remark)


def _timed(name: str, value: float, period: float) -> BenchValue:
    """Return a time that is known to a sample."""
    return BenchValue(name, value, max(value - period, 0.0), value + period, "s")


BENCH_FITS = (
    BenchFit(
        "dynamics",
        "transfer function of second order, gain 1 at rest, between two signals",
        (
            Column("time", "time", "even steps of 12.5 us or a multiple up to 200 us"),
            Column("input", "any", "at rest in the first row"),
            Column("output", "any", "same unit as the input"),
        ),
        dynamics,
    ),
    BenchFit(
        "step",
        "rise, overshoot and settling of steps of the setpoint",
        (
            Column("time", "time", "even steps"),
            Column("setpoint", "length", "stands still between the steps"),
            Column("position", "length", "of the spool"),
        ),
        steps,
    ),
)
"""Bench records of the valve of paper 000."""
