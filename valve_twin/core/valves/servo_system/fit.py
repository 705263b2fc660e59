# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Output error of the closed loop: parameters that make its simulation follow nine signals.

The loop is simulated from the desired position alone, which carries no noise, so that noise in the
signals does not bias the parameters. Sensitivities are ranked first: what the cycle does not show,
given all that it shows better, is held; while the residual is large, so is what else is held.
Where the piston starts and what the motor remembers from the cycle before are found with them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import (
    column_condition,
    damped_step,
    free_inside,
    unit_diagonal,
)
from valve_twin.core.physics.hysteresis import PLAYS
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.valves.servo_system import dynamics as dyn
from valve_twin.core.valves.servo_system import numbers as num
from valve_twin.core.valves.servo_system.integrate import rest, simulate
from valve_twin.core.valves.servo_system.numbers import PHYSICAL, derive
from valve_twin.core.valves.servo_system.parameters import INDEX, NAMES
from valve_twin.core.valves.servo_system.plant_kernel import Sensors, scaled
from valve_twin.core.valves.servo_system.record import SIGNALS
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray
    from valve_twin.core.valves.servo_system.record import Record

START, REMEMBERED, WARMED = len(NAMES), len(NAMES) + 1, len(NAMES) + 2
UNKNOWNS = len(NAMES) + 3
"""Estimated parameters over their starting values, start [stroke], remembered [reach], and what
the temperature of the oil has changed in its viscosity [1]."""

RTOL = 3e-5
"""Relative error of an integration step in the fit [1]."""

STEPS = np.array([0.02, 0.2, 0.04, 0.4, 0.15, 0.04, 0.04, 0.1, 0.15, 0.04, 0.01, 0.04, 2e-3, 0.3,
                  0.05])  # fmt: skip
"""Steps of the sensitivities, the larger the less an unknown does: what they change in the signals
is far above the integration's error."""

_LOWER = np.array([0.05] * len(NAMES) + [-0.2, -1.0, -0.8])
_UPPER = np.array([20.0] * len(NAMES) + [1.2, 1.0, 4.0])
_VISCOSITY = PHYSICAL.index("viscosity")
_MAX_STAGES, _MAX_ROUNDS = 8, 12
_MOST_RUNS = 150  # simulations after which no further step is begun [1]
_PROGRESS = 0.95  # residual over that of the stage before from which a stage was the last [1]
_ENOUGH = 0.02  # gain over what is above the noise that ends a stage [1]
_MOVED = 0.12  # change of an unknown after which sensitivities are renewed at the end [1]
_WORTH = 6.0  # promised gain below which a step that failed is not tried shorter [1]
_LEAST_GAIN = 20.0  # promised gain that is left to the whole steps at the end [1]
_POLISHES, _CLOSE = 4, 0.2  # whole steps at the end, and what is close [standard errors]
_HIDDEN = 50.0  # gain that the integration's error can hide [1]
_LONGEST = 0.5  # largest change of an unknown in a step [1]
_START_SIGMA, _MEMORY_SIGMA = 2e-3, 0.5
"""What start and memory are taken to scatter by beforehand [stroke], [reach]: a motor with a small
hysteresis does not show its memory."""

WARMING = 0.3
"""What the viscosity is taken to scatter by from cycle to cycle, 8 K of a mineral oil [1]."""
KNOWN = 1e-6  # the same where the viscosity is known exactly [1]
_COUPLED = [*range(START), WARMED]  # unknowns that change each other's sensitivities
_BESIDE = UNKNOWNS - START  # rows of the residual behind the samples

_ERROR_FLOOR = 1e-3
"""Relative error that a parameter is given at least: the integration's in simulation and fit."""

_SMALL = 0.02  # length of a step in standard errors that ends the search [1]
_DAMPING_UP, _DAMPING_DOWN, _DAMPING_MAX = 8.0, 0.2, 1e8
_RENEW = 0.8  # share of the promised gain below which sensitivities are renewed [1]


@dataclass(frozen=True, slots=True)
class LoopFit:
    """What the fit found.

    Attributes
    ----------
    values : (12,) array
        Parameters in the order of `NAMES` [their units].
    errors : (12,) array
        Their standard errors; of what was held, the error that it would have.
    estimated : (12,) bool array
        Which were estimated; the others kept their values.
    at_bound : (12,) bool array
        Which rest on a bound.
    misfit : float
        Residual over the noise, root mean square [1].
    worst : str
        The signal that is followed worst.
    worst_misfit : float
        Its residual over its noise [1].
    condition : float
        Condition number of the column-scaled sensitivities [1].
    unknowns : (UNKNOWNS,) array
        Where the search ended.
    warmed : tuple
        Viscosity over that of the numbers, less 1, and its standard error [1].
    failed : str
        Why nothing was found, empty if something was.
    """

    values: FloatArray
    errors: FloatArray
    estimated: BoolArray
    at_bound: BoolArray
    misfit: float
    worst: str
    worst_misfit: float
    condition: float
    unknowns: FloatArray
    warmed: tuple[float, float] = (0.0, 0.0)
    failed: str = ""


@njit(cache=True)
def run_loop(
    p: FloatArray,
    sensors: Sensors,
    wanted: FloatArray,
    start: float,
    remembered: float,
    period: float,
    rtol: float,
    out: FloatArray,
) -> int:
    """Simulate the loop from rest and write its signals (N, 9); return the samples reached.

    Parameters
    ----------
    p : (COUNT,) array
        Numbers, see `numbers`, derived ones renewed.
    sensors : Sensors
        Full scales.
    wanted : (N,) array
        Desired position [1].
    start, remembered : float
        Position of the piston at the first sample [1]; what the plays of the motor stand at,
        in parts of their largest reach [1].
    period, rtol : float
        Sampling time [s] and relative error of a step [1].
    out : (N, 9) array
        Overwritten [1].
    """
    count = len(wanted)
    y, memory = np.zeros(dyn.STATES), np.full(PLAYS, remembered * p[num.REACH])
    place = (start - 0.5) * p[num.STROKE]
    out[:, :] = np.nan
    if not rest(place, p, y, memory):
        return 0
    y[dyn.TH] += np.arcsin(min(max(place / p[num.ARM], -1.0), 1.0))
    y[dyn.TH] -= np.arcsin(min(max(y[dyn.XP] / p[num.ARM], -1.0), 1.0))
    y[dyn.XP] = place
    states = np.empty((count, dyn.STATES))
    metres = (wanted - 0.5) * p[num.STROKE]
    reached = simulate(y, memory, p, metres, period, rtol, states)
    for n in range(reached):
        out[n, 0] = states[n, dyn.XP] / p[num.STROKE] + 0.5
        scaled(states[n], p, sensors, out[n, 1:])
    return reached


class LoopProblem:
    """The weighted residual of a record and its sensitivities, by forward differences."""

    def __init__(
        self, record: Record, p: FloatArray, sensors: Sensors, warming: float = WARMING
    ) -> None:
        self.record, self.sensors, self.p, self.warming = record, sensors, p, warming
        self.base = p[INDEX].copy()
        self.start = _first_position(record)
        self.lower, self.upper = _LOWER, _UPPER
        self.runs = 0

    def residual(self, x: FloatArray) -> FloatArray | None:
        """Return measured minus simulated over the noise, flat, and what is known of the rest.

        None where the integration fails.

        Parameters
        ----------
        x : (UNKNOWNS,) array
            Unknowns [1].
        """
        self.runs += 1
        p = self.p.copy()
        p[INDEX] = self.base * x[: len(NAMES)]
        p[_VISCOSITY] *= 1.0 + x[WARMED]
        derive(p)
        record = self.record
        out = np.empty(record.measured.shape)
        reached = run_loop(
            p,
            self.sensors,
            record.wanted,
            float(x[START]),
            float(x[REMEMBERED]),
            record.period_s,
            RTOL,
            out,
        )
        if reached < len(out) or not np.isfinite(out).all():
            return None
        weighted = ((record.measured - out) * record.weight).ravel()
        away = (x[START] - self.start) / _START_SIGMA
        known = [away, x[REMEMBERED] / _MEMORY_SIGMA, x[WARMED] / self.warming]
        return np.concatenate((weighted, known))

    def sensitivities(self, x: FloatArray, r: FloatArray) -> FloatArray | None:
        """Return d residual / d x, (N * 9 + 3, UNKNOWNS); None where integration fails.

        Parameters
        ----------
        x : (UNKNOWNS,) array
            Unknowns [1].
        r : (N * 9 + 3,) array
            The residual there [1].
        """
        jacobian = np.empty((len(r), UNKNOWNS))
        for j in range(UNKNOWNS):
            step = STEPS[j] * (x[j] if j < len(NAMES) else 1.0)
            if x[j] + step > _UPPER[j]:
                step = -step
            aside = x.copy()
            aside[j] += step
            other = self.residual(aside)
            if other is None:
                return None
            jacobian[:, j] = (other - r) / step
        return jacobian


def fit_loop(
    record: Record,
    p: FloatArray,
    sensors: Sensors,
    *,
    max_error: float,
    guess: FloatArray | None = None,
    warming: float = WARMING,
) -> LoopFit:
    """Fit the parameters of `NAMES` to a record that begins at rest.

    Parameters
    ----------
    record : Record
        N samples of nine signals.
    p : (COUNT,) array
        Numbers to start from and to keep, see `numbers`.
    sensors : Sensors
        Full scales.
    max_error : float
        Relative standard error above which a parameter is held [1].
    guess : (12,) array, optional
        Values to search from, NaN = those of `p` [their units].
    warming : float
        What the viscosity may scatter by, a standard deviation [1].
    """
    problem = LoopProblem(record, p, sensors, warming)
    x = np.ones(UNKNOWNS)
    x[START:] = problem.start, 0.0, 0.0
    if guess is not None:
        known = np.isfinite(guess)
        x[:START][known] = np.clip(guess[known] / problem.base[known], 0.5, 2.0)
    r = problem.residual(x)
    jacobian = None if r is None else problem.sensitivities(x, r)
    if r is None or jacobian is None:
        return _failure(problem, "the simulation of the cycle fails: an option is wrong")
    free, before = np.zeros(UNKNOWNS, dtype=np.bool_), np.inf
    for _ in range(_MAX_STAGES):
        ranked = rank(jacobian, x, max_error / max(_misfit(r), 1.0))
        settled = _misfit(r) > _PROGRESS * before
        if ((ranked == free).all() and settled) or problem.runs > _MOST_RUNS:
            break
        before = _misfit(r)
        x[:START][free[:START] & ~ranked[:START]] = 1.0
        moved = problem.residual(x)
        free, r = ranked, r if moved is None else moved
        x, r, jacobian = _descend(problem, x, r, jacobian, free)
    x, r = _polish(problem, x, r, jacobian, free)
    return _result(problem, x, r, jacobian, free)


def _misfit(r: FloatArray) -> float:
    """Return the residual over the noise, root mean square [1]."""
    return float(np.sqrt(np.mean(r * r)))


def rank(jacobian: FloatArray, x: FloatArray, max_error: float) -> BoolArray:
    """Return which unknowns the record determines, (UNKNOWNS,), taken most sensitive first.

    An unknown is taken if its standard error, given all unknowns taken before it, stays below
    `max_error`; start, memory and viscosity always are.

    Parameters
    ----------
    jacobian : (M, UNKNOWNS) array
        Sensitivities of the weighted residual [1].
    x : (UNKNOWNS,) array
        Where they were taken, parameters in parts of the values started from [1].
    max_error : float
        Largest relative standard error [1].
    """
    gram = jacobian.T @ jacobian
    left = list(range(START))
    taken = [START, REMEMBERED, WARMED]
    while left:
        known = gram[np.ix_(taken, taken)] + 1e-12 * np.diag(np.diag(gram)[taken] + 1e-300)
        cross = gram[np.ix_(taken, left)]
        rest_ = np.diag(gram)[left] - np.sum(cross * np.linalg.solve(known, cross), axis=0)
        error = 1.0 / (np.sqrt(np.maximum(rest_, 1e-300)) * x[left])
        best = int(np.argmin(error))
        if error[best] > max_error:
            break
        taken.append(left.pop(best))
    free = np.zeros(UNKNOWNS, dtype=np.bool_)
    free[taken] = True
    return free


def _descend(
    problem: LoopProblem, x: FloatArray, r: FloatArray, jacobian: FloatArray, free: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Levenberg-Marquardt inside the bounds; sensitivities are renewed where they mislead."""
    damping, cost, fresh, taken_at = 1e-6, float(r @ r), True, x
    for _ in range(_MAX_ROUNDS):
        step, promised, change = _step(jacobian, r, x, free, damping)
        if problem.runs > _MOST_RUNS or change < _SMALL or promised < _LEAST_GAIN:
            break
        trial = np.clip(x + step, _LOWER, _UPPER)
        there = problem.residual(trial)
        gained = cost - float(there @ there) if there is not None else -np.inf
        if there is not None and gained > 0.0:
            x, r, cost = trial, there, cost - gained
            damping *= _DAMPING_DOWN
            fresh = False
            if gained < max(_LEAST_GAIN, _ENOUGH * (cost - len(r))):
                break
        elif fresh and promised < _WORTH:
            break
        else:
            damping = max(damping, 1e-4) * _DAMPING_UP
        if not fresh and gained < _RENEW * promised:
            renewed = problem.sensitivities(x, r)
            if renewed is None:
                break
            jacobian, fresh, taken_at = renewed, True, x
        if damping > _DAMPING_MAX:
            break
    if np.abs(x - taken_at)[_COUPLED].max() > _MOVED:
        renewed = problem.sensitivities(x, r)
        jacobian = jacobian if renewed is None else renewed
    return x, r, jacobian


def _polish(
    problem: LoopProblem, x: FloatArray, r: FloatArray, jacobian: FloatArray, free: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Go on with whole steps to where the gradient vanishes.

    Close to the minimum the integration's error hides what a step gains, and a search that must
    gain would stay near where it began.
    """
    for _ in range(_POLISHES):
        step, _, length = _step(jacobian, r, x, free, 0.0)
        if length < _CLOSE:
            break
        trial = np.clip(x + step, _LOWER, _UPPER)
        there = problem.residual(trial)
        if there is None or float(there @ there) > float(r @ r) + _HIDDEN:
            break
        x, r = trial, there
    return x, r


def _step(
    jacobian: FloatArray, r: FloatArray, x: FloatArray, free: BoolArray, damping: float
) -> tuple[FloatArray, float, float]:
    """Return the step, the gain it promises and its length in standard errors."""
    gradient = -(jacobian.T @ r)
    on = free & free_inside(x, gradient, (_LOWER, _UPPER))
    gram = jacobian[:, on].T @ jacobian[:, on]
    part = damped_step(gram, gradient[on], damping)
    step = np.zeros(UNKNOWNS)
    step[on] = part
    length = float(np.sqrt(max(float(part @ gram @ part), 0.0)))
    share = min(1.0, _LONGEST / max(float(np.abs(step[_COUPLED]).max()), 1e-300))
    promised = 2.0 * share * float(part @ gradient[on]) - (share * length) ** 2
    return share * step, promised, length


def _first_position(record: Record) -> float:
    """Return the measured position before the piston can have moved [1]."""
    known = np.flatnonzero(record.weight[:, 0] > 0.0)[:3]
    return float(np.mean(record.measured[known, 0]))


def _result(
    problem: LoopProblem, x: FloatArray, r: FloatArray, jacobian: FloatArray, free: BoolArray
) -> LoopFit:
    names = len(NAMES)
    used = problem.record.weight > 0.0
    misfit = float(np.sqrt(r @ r / max(int(used.sum()) - int(free.sum()), 1)))
    each = np.sqrt(
        np.sum(r[:-_BESIDE].reshape(used.shape) ** 2, axis=0) / np.maximum(used.sum(axis=0), 1)
    )
    gram = jacobian.T @ jacobian
    errors = np.full(UNKNOWNS, np.inf)
    for j in _COUPLED:
        on = np.flatnonzero(free | (np.arange(UNKNOWNS) == j))
        scaled, scale = unit_diagonal(gram[np.ix_(on, on)])
        inverse = np.linalg.pinv(scaled)
        place = int(np.flatnonzero(on == j)[0])
        errors[j] = np.sqrt(max(inverse[place, place], 0.0)) / scale[place]
    errors *= max(misfit, 1.0)
    at_bound = (x <= _LOWER * (1 + 1e-9)) | (x >= _UPPER * (1 - 1e-9))
    return LoopFit(
        values=problem.base * x[:names],
        errors=problem.base * np.hypot(errors[:names], _ERROR_FLOOR * x[:names]),
        estimated=free[:names],
        at_bound=at_bound[:names],
        misfit=misfit,
        worst=SIGNALS[int(np.argmax(each))],
        worst_misfit=float(each.max()),
        condition=column_condition(jacobian[:, free]),
        unknowns=x,
        warmed=(float(x[WARMED]), float(errors[WARMED])),
    )


def _failure(problem: LoopProblem, reason: str) -> LoopFit:
    nothing = np.full(len(NAMES), np.nan)
    none = np.zeros(len(NAMES), dtype=np.bool_)
    nan = float("nan")
    failed = Refusal(RefusalCode.NO_CONVERGENCE, reason)
    nowhere = np.full(UNKNOWNS, np.nan)
    return LoopFit(nothing, nothing, none, none, nan, "", nan, nan, nowhere, failed=failed)
