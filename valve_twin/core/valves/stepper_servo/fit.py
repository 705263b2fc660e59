# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fits of the stepper valve: the thread by output error of its play, the flow curve by its meter.

Both are bounded Levenberg-Marquardt with few parameters; the thread starts from several delays
because its cost has a minimum a delay.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import minimise
from valve_twin.core.valves.stepper_servo.kernels import (
    DELAY,
    LOST,
    N_PARAMETERS,
    OFFSET,
    normal_equations,
    run_flow,
    run_play,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.estimation.solvers.least_squares import Limits, Minimum
    from valve_twin.core.types import BoolArray, FloatArray

    Simulation: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

_MAX_ITERATIONS = 40
_DIFFERENCE = 1e-5  # of the flow parameters: far below the step, far above rounding
_DELAYS = 9  # starts over the delays tried
_FLOW_LAGS = (1.0, 8.0)  # time constants that the flow fit starts from [samples]


@dataclass(frozen=True, slots=True)
class Record:
    """What is fitted, (N,) each: sensed position, counted motor position, flow [1], usable."""

    position: FloatArray
    motor: FloatArray
    flow: FloatArray
    used: BoolArray


@dataclass(frozen=True, slots=True)
class ThreadFit:
    """The thread: parameters (4,), cost, J^T J, samples pushed either way, way upwards [1]."""

    parameters: FloatArray
    cost: float
    hessian: FloatArray
    pushed_up: int
    pushed_down: int
    up: float


@dataclass(frozen=True, slots=True)
class FlowFit:
    """The flow curve: parameters (6,) of `run_flow`, cost, samples on either slope."""

    parameters: FloatArray
    cost: float
    on_lower: int
    on_upper: int


def fit_thread(record: Record, *, max_backlash: float, max_delay: float) -> ThreadFit:
    """Find backlash, offset, lost share and delay that make the play follow the position.

    Parameters
    ----------
    record : Record
        N samples without a gap.
    max_backlash : float
        Upper bound [1].
    max_delay : float
        Longest delay tried [samples].
    """
    lower = np.array([0.0, -np.inf, -0.9, 0.0])
    upper = np.array([max_backlash, np.inf, 0.9, max_delay])
    simulated, jacobian = np.empty(len(record.motor)), np.empty((len(record.motor), N_PARAMETERS))
    first = float(np.median(record.position[record.used][:5]))

    def simulate(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        run_play(p, record.motor, first, simulated, jacobian)
        return simulated, jacobian

    away = (record.position - record.motor)[record.used]
    low, high = np.quantile(away, [0.1, 0.9])
    found = [
        _descend(
            simulate,
            np.array([min(high - low, max_backlash), 0.5 * (low + high), 0.0, delay]),
            (lower, upper),
            record.position,
            record.used,
        )
        for delay in np.linspace(0.0, max_delay, _DELAYS)
    ]
    best, cost, hessian = min(found, key=lambda f: f.cost)
    up, down, way = run_play(best, record.motor, first, simulated, jacobian)
    return ThreadFit(best, cost, hessian, up, down, way)


def thread_residual(record: Record, thread: ThreadFit) -> FloatArray:
    """Return measured minus simulated positions of a fitted thread (N,) [1]."""
    simulated, jacobian = np.empty(len(record.motor)), np.empty((len(record.motor), N_PARAMETERS))
    first = float(np.median(record.position[record.used][:5]))
    run_play(thread.parameters, record.motor, first, simulated, jacobian)
    return record.position - simulated


def flow_residual(record: Record, spool: FloatArray, flow: FlowFit) -> FloatArray:
    """Return measured minus simulated flow (N,) [1].

    Parameters
    ----------
    record : Record
        N samples.
    spool : (N,) array
        Spool position [1].
    flow : FlowFit
        The fitted flow curve.
    """
    metered = np.empty(len(spool))
    run_flow(flow.parameters, spool, float(record.flow[0]), metered)
    return record.flow - metered


def spool_position(record: Record, thread: ThreadFit) -> FloatArray:
    """Return where the fitted thread holds the spool (N,), without the delay of the sensor [1]."""
    prompt = thread.parameters.copy()
    prompt[DELAY] = 0.0
    simulated, jacobian = np.empty(len(record.motor)), np.empty((len(record.motor), N_PARAMETERS))
    first = float(np.median(record.position[record.used][:5]))
    run_play(prompt, record.motor, first, simulated, jacobian)
    return simulated


def fit_flow(record: Record, spool: FloatArray, *, max_lag: float) -> FlowFit:
    """Find the edges of the dead band, the slopes, the full flow and the meter's time constant.

    Parameters
    ----------
    record : Record
        Its flow is fitted.
    spool : (N,) array
        Spool position [1].
    max_lag : float
        Longest time constant tried [samples].
    """
    full = max(float(np.quantile(record.flow, 0.98)), 1e-9)
    low, high = _first_edges(record.flow, spool, full)
    lower = np.array([-1.0, -1.0, 1e-3, 1e-3, 0.1 * full, 1e-2])
    upper = np.array([2.0, 2.0, 1.0, 1.0, 10.0 * full, max_lag])
    metered = np.empty(len(spool))

    def run(q: FloatArray) -> FloatArray:
        run_flow(q, spool, float(record.flow[0]), metered)
        return metered.copy()

    def simulate(q: FloatArray) -> tuple[FloatArray, FloatArray]:
        here = run(q)
        columns = []
        for j in range(len(q)):
            aside = q.copy()
            aside[j] += _DIFFERENCE * max(abs(q[j]), 0.01)
            columns.append((run(aside) - here) / (aside[j] - q[j]))
        return here, np.column_stack(columns)

    found = [
        _descend(
            simulate,
            np.array([low, high, width, width, full, lag]),
            (lower, upper),
            record.flow,
            record.used,
        )
        for lag in _FLOW_LAGS
        for width in (0.03, 0.12)
    ]
    best, cost, _ = min(found, key=lambda f: f.cost)
    return FlowFit(
        best,
        cost,
        int(np.sum((spool < best[0]) & (spool > best[0] - best[2]))),
        int(np.sum((spool > best[1]) & (spool < best[1] + best[3]))),
    )


def _first_edges(flow: FloatArray, spool: FloatArray, full: float) -> tuple[float, float]:
    """Guess the edges: between them hardly anything flows."""
    shut = spool[flow < 0.02 * full]
    if not len(shut):
        return float(np.median(spool)) - 0.01, float(np.median(spool)) + 0.01
    return float(shut.min()), float(shut.max())


def _descend(
    simulate: Simulation, start: FloatArray, limits: Limits, measured: FloatArray, used: BoolArray
) -> Minimum:
    size = len(start)

    def evaluate(p: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        gradient, gram = np.empty(size), np.empty((size, size))
        simulated, jacobian = simulate(p)
        cost = normal_equations(measured - simulated, used, jacobian, gradient, gram)
        return float(cost), gradient, gram

    return minimise(evaluate, start, limits, iterations=_MAX_ITERATIONS)


def end_offset(thread: ThreadFit) -> float:
    """Return spool minus counted motor position at the end of the record [1]."""
    return float(thread.parameters[OFFSET] - thread.parameters[LOST] * thread.up)
