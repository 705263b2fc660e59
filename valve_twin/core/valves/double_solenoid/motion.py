# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Force gain, friction and preload from the motion of a cycle, with measured currents.

The force by the curves is computed once from position and the currents that magnetise
(`record.py`); in windows of 10 ms the spool then obeys

    m v' = g F(t) + spring_1 - spring_2 - F_h/(1 + exp(-alpha v)) + F_h/2 - beta v

All windows are fitted together by output error: g, F_h and the preload of spring 1 are shared,
position and speed at the start of each window are its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import column_condition, damped_step
from valve_twin.core.physics.curves import force_of
from valve_twin.core.valves.double_solenoid.plant_kernel import (
    Valve,
    friction_force,
    spring_force,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.physics.curves import Curves
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.double_solenoid.record import Record

SUB = 8
"""Steps of the integration in a sample of 0.1 ms."""

WINDOW = 100
"""Samples of a window, assumed."""

_SETTLING = 40  # samples at the start of a cycle until the force filter has forgotten, assumed
_ROUNDS = 12
_CONVERGED = 1e-7
_STOP_MARGIN = 1e-5  # nearer to an end stop a window is left out [m], assumed
_SPEED_STEP = 1e-4  # for derivatives [m/s]
_FEWEST_WINDOWS = 3
_HALF = 6  # samples on either side of a local parabola, assumed


@dataclass(frozen=True, slots=True)
class MotionFit:
    """Fitted force gain [1], friction [N], preload of spring 1 [N] and what is known about them.

    Attributes
    ----------
    values : (3,) array
        In that order.
    rms : float
        What the fit leaves of the position [m].
    condition : float
        Of the column-scaled sensitivities, windows' own values removed [1].
    used : int
        Samples used.
    travel : float
        Largest distance between two fitted positions [m].
    moved : (3, K) array
        What each of the K variations changes in the values.
    """

    values: FloatArray
    rms: float
    condition: float
    used: int
    travel: float
    moved: FloatArray


@njit(cache=True)
def force_record(
    v: Valve,
    m: Curves,
    x: FloatArray,
    current_a: FloatArray,
    current_b: FloatArray,
    period: float,
    out: FloatArray,
) -> None:
    """Write the force of the curves behind G_F, in every step between the samples.

    Parameters
    ----------
    v, m : Valve, Curves
        Numbers of the valve, curves of a coil.
    x, current_a, current_b : (N,) arrays
        As in `Record`.
    period : float
        Sampling time [s].
    out : (N, SUB) array
        Overwritten: row n holds the steps that lead to sample n [N].
    """
    g = v.force
    h = period / SUB
    f1 = force_of(m, current_a[0], current_b[0], x[0])
    f2 = 0.0
    for n in range(len(x)):
        middle = 0.5 * (x[n] + x[max(n - 1, 0)])
        static = force_of(m, current_a[n], current_b[n], middle)
        for k in range(SUB):
            out[n, k] = g.out_1 * f1 + g.out_2 * f2 + g.direct * static
            f1, f2 = f1 + h * f2, f2 + h * (g.rate_1 * (static - f1) - g.rate_2 * f2)


@njit(cache=True)
def follow(
    v: Valve,
    force: FloatArray,
    x: FloatArray,
    start: tuple[float, float],
    period: float,
    out: FloatArray,
) -> None:
    """Follow the spool through N samples from given position and speed.

    Parameters
    ----------
    v : Valve
        Numbers of the valve.
    force : (N, SUB) array
        See `force_record`; the first row is not used [N].
    x : (N,) array
        Measured position, for the springs [m].
    start : tuple of float
        Position [m] and speed [m/s] at the first sample.
    period : float
        Sampling time [s].
    out : (N,) array
        Overwritten: position [m].
    """
    h = period / SUB
    place, speed = start
    out[0] = place
    for n in range(1, len(x)):
        springs = spring_force(v, 0.5 * (x[n - 1] + x[n]))
        for k in range(SUB):
            total = v.force_gain * force[n, k] + springs - friction_force(v, speed)
            place += h * speed
            speed += h * total / v.mass
        out[n] = place


@njit(cache=True)
def shift_all(
    v: Valve,
    force: FloatArray,
    x: FloatArray,
    firsts: FloatArray,
    starts: FloatArray,
    speed_step: float,
    period: float,
    window: int,
    out: FloatArray,
) -> None:
    """Follow all windows, with speeds at their starts raised by `speed_step`.

    Parameters
    ----------
    v, force, x, period : Valve, (N, SUB) array, (N,) array, float
        As in `follow`.
    firsts : (W,) array
        First sample of each window, counted from 0 [samples].
    starts : (W, 2) array
        Position [m] and speed [m/s] at each start.
    speed_step : float
        Added to every speed [m/s].
    window : int
        Samples of a window.
    out : (W, window) array
        Overwritten: positions [m].
    """
    for j in range(len(firsts)):
        a = int(firsts[j])
        start = (starts[j, 0], starts[j, 1] + speed_step)
        follow(v, force[a : a + window], x[a : a + window], start, period, out[j])


def usable_windows(record: Record, stop: float) -> FloatArray:
    """Return the first samples (W,) of the windows without bad samples and away from the stops.

    Parameters
    ----------
    record : Record
        What was measured.
    stop : float
        Distance of the end stops from the middle [m].
    """
    good = record.known & (np.abs(record.x) < stop - _STOP_MARGIN)
    firsts = np.arange(_SETTLING, len(good) - WINDOW + 1, WINDOW)
    kept = [a for a in firsts if good[a : a + WINDOW].all()]
    return np.array(kept, dtype=np.float64)


def derivatives(x: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return speed [m/s] and acceleration [m/s^2] (N,) by local parabolas over 13 samples.

    Parameters
    ----------
    x : (N,) array
        Position [m].
    period_s : float
        Sampling time [s].
    """
    k = np.arange(-_HALF, _HALF + 1) * period_s
    rows = np.linalg.pinv(np.column_stack([np.ones(len(k)), k, k**2]))
    padded = np.pad(x, _HALF, mode="edge")
    speed = np.convolve(padded, rows[1][::-1], mode="valid")
    return speed, 2.0 * np.convolve(padded, rows[2][::-1], mode="valid")


def reconstruct_force(x: FloatArray, v: Valve, period_s: float) -> FloatArray:
    """Return the magnetic force (N,) that moved the spool as measured, by inverse mechanics [N].

    Paper 000, section 3.2: the force cannot be measured, the motion can.

    Parameters
    ----------
    x : (N,) array
        Position [m].
    v : Valve
        Numbers of the mechanics.
    period_s : float
        Sampling time [s].
    """
    speed, acceleration = derivatives(x, period_s)
    upper = np.maximum(v.preload_1 - v.spring_1 * x, 0.0)
    lower = np.maximum(v.preload_2 + v.spring_2 * x, 0.0)
    rubbing = 0.5 * v.friction * np.tanh(0.5 * v.alpha * speed) + v.beta * speed
    force: FloatArray = v.mass * acceleration - upper + lower + rubbing
    return force


def first_guess(record: Record, v: Valve, force: FloatArray, firsts: FloatArray) -> FloatArray:
    """Return force gain, friction and preload of spring 1 (3,) from the reconstructed force.

    Parameters
    ----------
    record, v : Record, Valve
        As in `fit_motion`.
    force : (N, SUB) array
        See `force_record` [N].
    firsts : (W,) array
        First samples of the windows, counted from 0 [samples].
    """
    places = (firsts.astype(np.int64)[:, None] + np.arange(WINDOW)).ravel()
    speed, _ = derivatives(record.x, record.period_s)
    free = reconstruct_force(record.x, v._replace(friction=0.0), record.period_s)
    rows = np.column_stack(
        [force[:, -1], -0.5 * np.tanh(0.5 * v.alpha * speed), np.ones(len(free))]
    )
    found = np.linalg.lstsq(rows[places], free[places], rcond=None)[0]
    guess = np.array([found[0], found[1], v.preload_1 + found[2]])
    guess[0] = max(guess[0], 0.05)
    guess[1:] = np.maximum(guess[1:], 0.0)
    return guess


def fit_motion(
    record: Record,
    v: Valve,
    m: Curves,
    variations: Sequence[tuple[Record, Valve, Curves]] = (),
) -> MotionFit | None:
    """Fit force gain, friction and preload of spring 1; None with too few usable windows.

    Parameters
    ----------
    record : Record
        What was measured.
    v, m : Valve, Curves
        The valve of the data sheet: its force gain, friction and preload are where the search
        starts.
    variations : sequence
        The same with another constant each.
    """
    firsts = usable_windows(record, v.stop)
    if len(firsts) < _FEWEST_WINDOWS:
        return None
    force = np.empty((len(record.x), SUB))
    force_record(v, m, record.x, record.current_a, record.current_b, record.period_s, force)
    places = firsts.astype(np.int64)[:, None] + np.arange(WINDOW)
    measured = record.x[places]
    slope = np.polyfit(np.arange(8) * record.period_s, measured[:, :8].T, 1)
    starts = np.ascontiguousarray(np.stack([slope[1], slope[0]], axis=1))
    values = first_guess(record, v, force, firsts)
    steps = np.array([1e-4, 1e-3, 1e-3])
    if not (np.isfinite(force).all() and np.isfinite(values).all()):
        return None
    problem = _Problem(record, v, force, firsts, measured)
    residual, jacobian, own = problem.linearise(values, starts, steps)
    cost = float(np.sum(residual**2))
    damping = 0.0
    for _ in range(_ROUNDS):
        change, shifts = _solve(residual, jacobian, own, damping)
        tried = values + change
        tried[1] = max(tried[1], 0.0)
        moved = starts + shifts
        after = problem.residual(tried, moved)
        better = float(np.sum(after**2))
        if not better <= cost:
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e6:
                break
            continue
        small = cost - better <= _CONVERGED * cost
        values, starts, cost, damping = tried, moved, better, 0.1 * damping
        residual, jacobian, own = problem.linearise(values, starts, steps)
        if small:
            break
    freedom = max(residual.size - 2 * len(firsts) - 3, 1)
    moved = _moved(problem, values, starts, (residual, jacobian, own), variations)
    return MotionFit(
        values=values,
        rms=float(np.sqrt(cost / freedom)),
        condition=column_condition(_reduced(jacobian, own)),
        used=residual.size,
        travel=float(np.ptp(measured)),
        moved=moved,
    )


def _moved(
    problem: _Problem,
    values: FloatArray,
    starts: FloatArray,
    found: tuple[FloatArray, FloatArray, FloatArray],
    variations: Sequence[tuple[Record, Valve, Curves]],
) -> FloatArray:
    """Return what variations change in the shared values (3, K), to first order."""
    residual, jacobian, own = found
    basis, places = _project(own), problem.firsts.astype(np.int64)[:, None] + np.arange(WINDOW)
    matrix = _reduced(jacobian, own)
    changes = np.empty((3, len(variations)))
    for k, (record, v, m) in enumerate(variations):
        force = np.empty((len(record.x), SUB))
        force_record(v, m, record.x, record.current_a, record.current_b, record.period_s, force)
        aside = _Problem(record, v, force, problem.firsts, record.x[places])
        off = aside.residual(values, starts) - residual
        off -= (basis @ (basis.transpose(0, 2, 1) @ off[:, :, None]))[:, :, 0]
        changes[:, k] = np.linalg.lstsq(matrix, off.reshape(-1), rcond=None)[0]
    return changes


@dataclass(frozen=True, slots=True)
class _Problem:
    """Residuals of all windows and their derivatives."""

    record: Record
    valve: Valve
    force: FloatArray
    firsts: FloatArray
    measured: FloatArray

    def _positions(self, values: FloatArray, starts: FloatArray, speed: float) -> FloatArray:
        v = self.valve._replace(
            force_gain=float(values[0]), friction=float(values[1]), preload_1=float(values[2])
        )
        out = np.empty_like(self.measured)
        shift_all(
            v,
            self.force,
            self.record.x,
            self.firsts,
            starts,
            speed,
            self.record.period_s,
            WINDOW,
            out,
        )
        return out

    def residual(self, values: FloatArray, starts: FloatArray) -> FloatArray:
        """Return measured minus followed positions (W, WINDOW) [m]."""
        return self.measured - self._positions(values, starts, 0.0)

    def linearise(
        self, values: FloatArray, starts: FloatArray, steps: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return residuals (W, N), shared (W, N, 3) and own (W, N, 2) sensitivities."""
        here = self._positions(values, starts, 0.0)
        shared = np.empty((*here.shape, 3))
        for j in range(3):
            moved = values.copy()
            moved[j] += steps[j]
            shared[:, :, j] = (self._positions(moved, starts, 0.0) - here) / steps[j]
        own = np.ones((*here.shape, 2))
        own[:, :, 1] = (self._positions(values, starts, _SPEED_STEP) - here) / _SPEED_STEP
        return self.measured - here, shared, own


def _project(own: FloatArray) -> FloatArray:
    """Return orthonormal bases (W, N, 2) of the windows' own sensitivities."""
    return np.linalg.qr(own)[0]


def _reduced(shared: FloatArray, own: FloatArray) -> FloatArray:
    """Return the shared sensitivities (W N, 3) that the windows' own values leave."""
    basis = _project(own)
    left = shared - basis @ (basis.transpose(0, 2, 1) @ shared)
    return left.reshape(-1, shared.shape[2])


def _solve(
    residual: FloatArray, shared: FloatArray, own: FloatArray, damping: float
) -> tuple[FloatArray, FloatArray]:
    """Return the changes of the shared (3,) and of the windows' own values (W, 2)."""
    basis = _project(own)
    left = residual - (basis @ (basis.transpose(0, 2, 1) @ residual[:, :, None]))[:, :, 0]
    matrix = _reduced(shared, own)
    change = damped_step(matrix.T @ matrix, matrix.T @ left.reshape(-1), damping + 1e-14)
    rest = residual - shared @ change
    normal = own.transpose(0, 2, 1) @ own
    shifts = np.linalg.solve(normal, own.transpose(0, 2, 1) @ rest[:, :, None])[:, :, 0]
    return change, np.asarray(shifts)
