# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One cycle laid out for the output error, and its best free run for a lag."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.scatter_kernel import sum_as_numpy
from valve_twin.core.valves.press_cartridge.estimation.excitation import GuardOptions
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    Stretch,
    fit_at_pole,
    search_pole,
)
from valve_twin.core.valves.press_cartridge.estimation.response.phases import (
    Limits,
    delayed,
    mark_phases,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.estimation.data.masks import Masks
    from valve_twin.core.types import BoolArray, FloatArray, Frames, IntArray

_LONG_GAP = 10
"""A gap above this many samples is not bridged: the run starts again after it."""

_LONGEST = 1e6  # step that is told [samples]

_NOISE_MARGIN = 4.0
"""A seat is as wide as this many standard deviations of the noise."""

SETTLE = 5
"""Samples after the last command that do not count as hold yet: the motion dies away."""

_TAKE_OFF = 0.003
"""How far a spool is beside its model once it has left a seat [1], assumed: a part of a sample of
motion. Noise above it leaves the level on the seat its weight."""


@dataclass(frozen=True, slots=True)
class OutputErrorOptions:
    """How the free run is fitted.

    Attributes
    ----------
    v_ref : float
        Command at which K_out is published [1].
    v_max : float
        Greatest command: gains are positive and flows rise up to it [1].
    lag : int
        Command to position lag [samples]; negative = search.
    max_lag : int
        Longest lag tried [samples].
    delay : float
        Command to position delay, parts of a sample included [samples]; negative = search.
    pole : float
        Pole [1]; negative = search.
    wander : float
        Variance that the level gains in each sample of motion, in units of the noise variance [1].
    lower_seat, upper_seat : float
        Positions of the seats [1].
    seat_margin : float
        Distance from a seat that counts as resting on it [1].
    offset_in, offset_out : float
        Commands below which the pilots stay shut [1].
    min_hold : int
        Fewest samples of hold off the seats from which a leak is estimated.
    guard : GuardOptions
        When a gain is refused.
    max_relative_error : float
        A gain whose standard error, from the residuals alone, is above this share of it is refused
        [1].
    """

    v_ref: float = 0.3
    v_max: float = 0.8
    lag: int = -1
    max_lag: int = 4
    delay: float = -1.0
    pole: float = -1.0
    wander: float = 0.03
    lower_seat: float = 0.0
    upper_seat: float = 1.0
    seat_margin: float = 0.01
    offset_in: float = 0.0
    offset_out: float = 0.0
    min_hold: int = 30
    guard: GuardOptions = field(default_factory=GuardOptions)
    max_relative_error: float = 0.3


@dataclass(frozen=True, slots=True)
class Run:
    """A cycle on a grid of N whole periods without holes.

    Attributes
    ----------
    position : (N,) array
        Measured position, the last known one where there is none [1].
    use : (N,) bool array
        The position has weight.
    stuck, broken : (N,) bool arrays
        The spool is stuck; a long gap lies before the sample.
    v_in, v_out : (N,) arrays
        Commands above their offsets [1].
    margin : float
        Width of a seat [1].
    period_s : float
        Sampling time [s].
    noise_sigma : float
        Standard deviation of the position at rest; NaN = not known [1].
    """

    position: FloatArray
    use: BoolArray
    stuck: BoolArray
    broken: BoolArray
    v_in: FloatArray
    v_out: FloatArray
    margin: float
    period_s: float
    noise_sigma: float


@dataclass(frozen=True, slots=True)
class Solution:
    """The best free run for a lag.

    Attributes
    ----------
    pole : float
        Pole [1].
    linear : (5,) array
        Linear parameters of `output_error_kernel`.
    gram : (7, 7) array
        Normal equations at the minimum.
    columns : (5,) bool array
        Which linear parameters were fitted.
    cost : float
        Sum of weighted squared residuals [1].
    rows : int
        How many.
    likelihood : float
        Minus twice the log likelihood a row, up to a constant; smaller is better.
    v_in_mean : float
        Displacement-weighted mean inflow command [1].
    """

    pole: float
    linear: FloatArray
    gram: FloatArray
    columns: BoolArray
    cost: float
    rows: int
    likelihood: float
    v_in_mean: float


def lay_out(
    frames: Frames, masks: Masks, period_s: float, noise_sigma: float, options: OutputErrorOptions
) -> Run:
    """Put the samples on a grid of whole periods; missing ones have no weight, commands hold.

    Parameters
    ----------
    frames, masks : Frames, Masks
        Samples of one cycle and their masks.
    period_s : float
        Sampling time [s].
    noise_sigma : float
        Standard deviation of the measured position; NaN = not known [1].
    options : OutputErrorOptions
        Offsets of the commands, width of a seat.
    """
    steps = np.empty(max(len(frames) - 1, 0), np.int64)
    whole = _fill_steps(np.ascontiguousarray(frames.stamp_ns), period_s * 1e9, steps)
    size = len(frames)
    source: slice | IntArray = slice(None)
    here, broken = np.ones(size, np.bool_), np.zeros(size, np.bool_)
    if not whole:  # periods are missing
        long = steps > _LONG_GAP
        steps[long] = options.max_lag + 1
        index = np.concatenate((np.zeros(1, np.int64), np.cumsum(steps)))
        size = int(index[-1]) + 1
        source = np.searchsorted(index, np.arange(size), side="right") - 1
        here, broken = np.zeros(size, np.bool_), np.zeros(size, np.bool_)
        here[index] = True
        broken[index[1:][long]] = True
    known = ~masks.bad & np.isfinite(frames.position)
    position = frames.position if known.all() else _held(frames.position, known)
    inputs, v_max = np.ascontiguousarray(frames.inputs), options.v_max
    v_in, v_out = np.empty((2, len(frames)))
    _limit(inputs, 0, options.offset_in, v_max, v_in)
    _limit(inputs, 1, options.offset_out, v_max, v_out)
    margin = options.seat_margin
    if np.isfinite(noise_sigma):
        margin = max(margin, _NOISE_MARGIN * noise_sigma)
    return Run(
        position=np.ascontiguousarray(position[source]),
        use=(known & ~masks.any)[source] & here,
        stuck=masks.stuck[source],
        broken=broken,
        v_in=v_in[source],
        v_out=v_out[source],
        margin=margin,
        period_s=period_s,
        noise_sigma=noise_sigma,
    )


@njit(cache=True)
def _fill_steps(stamp_ns: IntArray, period_ns: float, steps: IntArray) -> bool:
    """Fill the steps of N samples in periods, at least one; return whether all are one."""
    whole = True
    for n in range(len(steps)):
        step = np.rint((stamp_ns[n + 1] - stamp_ns[n]) / period_ns)
        steps[n] = int(min(max(step, 1.0), _LONGEST))
        whole &= steps[n] == 1
    return whole


@njit(cache=True)
def _limit(inputs: FloatArray, column: int, offset: float, v_max: float, out: FloatArray) -> None:
    """Fill what a command is above its offset; what is no number is none."""
    for n in range(len(out)):
        v = inputs[n, column] if np.isfinite(inputs[n, column]) else 0.0
        out[n] = min(max(v - offset, 0.0), v_max)


def _held(values: FloatArray, known: BoolArray) -> FloatArray:
    """Replace unknown values by the last known one, before the first by that."""
    if not known.any():
        return np.zeros(len(values))
    index = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(index < 0, int(np.argmax(known)), index)]


def acting_command(command: FloatArray, delay: float) -> FloatArray:
    """Return the command `delay` samples old; the first one where there is none so old.

    Between two samples it is interpolated: the logger sees one of several commands that a
    controller gives in its period, and a pilot follows within a sample.

    Parameters
    ----------
    command : (N,) array
        Command of every sample [1].
    delay : float
        Not negative [samples].
    """
    return np.asarray(delayed(command, float(delay)))


@dataclass(frozen=True, slots=True)
class Phases:
    """What the spool does at each of the N samples of a run, for one lag.

    Attributes
    ----------
    v_in, v_out : (N,) arrays
        Commands that act at the sample, lag included [1].
    seated, free, moving, leaving : (N,) bool arrays
        It rests on a seat; it is off the seats; a command acts or has just acted; it leaves a
        seat.
    anchor : (N,) array
        By how much its level is less known, see `Stretch` [1].
    """

    v_in: FloatArray
    v_out: FloatArray
    seated: BoolArray
    free: BoolArray
    anchor: FloatArray
    moving: BoolArray
    leaving: BoolArray

    def stretch(self, position: FloatArray, use: BoolArray) -> Stretch:
        """Return what the kernels take, with position [1] and samples that have weight, (N,)."""
        counts = use & ~self.leaving
        return Stretch(
            position, counts, self.free, self.anchor, self.moving, self.v_in, self.v_out
        )


def find_phases(
    run: Run, delay: float, options: OutputErrorOptions, *, settle: int = SETTLE
) -> Phases:
    """Distinguish rest on a seat, hold and motion.

    Samples in which the spool leaves a seat do not count, and its level is less known then: before
    it moves the chamber has to be filled or drained, which takes a time that no pole of the speed
    knows. With that time taken for lag, K_out was 1 to 5 % too small.

    Parameters
    ----------
    run : Run
        The cycle.
    delay : float
        Command to position delay, parts of a sample included [samples].
    options : OutputErrorOptions
        Where the seats are, and which command acts.
    settle : int
        Samples after the last command that count as motion.
    """
    v_in, v_out = acting_command(run.v_in, delay), acting_command(run.v_out, delay)
    known = run.noise_sigma > 0.0
    limits = Limits(
        float(options.lower_seat + run.margin),
        float(options.upper_seat - run.margin),
        float(run.margin),
        float(options.guard.active_command),
        (_TAKE_OFF / run.noise_sigma) ** 2 if known else np.inf,
        settle,
    )
    seated, free, moving, leaving, anchor = mark_phases(
        run.position, run.stuck, run.broken, v_in, v_out, limits
    )
    return Phases(v_in, v_out, seated, free, anchor, moving, leaving)


def fit_lag(
    run: Run,
    phases: Phases,
    columns: BoolArray,
    options: OutputErrorOptions,
    linear: FloatArray | None = None,
) -> Solution:
    """Fit for one delay.

    Parameters
    ----------
    run : Run
        The cycle.
    phases : Phases
        What the spool does at each sample, by that delay.
    columns : (5,) bool array
        Parameters that are fitted.
    options : OutputErrorOptions
        How the free run is fitted.
    linear : (5,) array, optional
        The linear parameters at its pole, where they are known [1].
    """
    data, limits = phases.stretch(run.position, run.use), (options.v_max, options.wander, columns)
    pole, gram = options.pole, np.zeros((N_COLUMNS, N_COLUMNS))
    if linear is None:
        p = np.zeros(N_LINEAR)
        pole, cost, log_determinant, rows = search_pole(data, *limits, pole, p, gram)
    else:
        p = linear.copy()
        cost, log_determinant, rows = fit_at_pole(data, *limits, pole, p, gram)
    rows = max(rows, 1)
    likelihood = float(np.log(max(cost, 1e-300) / rows) + log_determinant / rows)
    active = options.guard.active_command
    mean = mean_command(run.position, phases.v_in, phases.free, active)
    return Solution(pole, p, gram, columns, cost, rows, likelihood, mean)


def mean_command(position: FloatArray, v_in: FloatArray, free: BoolArray, active: float) -> float:
    """Return the inflow command, averaged with the displacement during it as weight [1].

    The noise of the increments stays in the sum: it has mean zero there, but not in its positive
    part.

    Parameters
    ----------
    position : (N,) array
        Measured position [1].
    v_in : (N,) array
        Inflow command that acts at the sample [1].
    free : (N,) bool array
        Whether the spool is off the seats.
    active : float
        Only commands above it count: an offset or noise of the logged command is no inflow, and
        would take the return stroke for one [1].
    """
    return float(_mean_command(position, v_in, free, active))


@njit(cache=True)
def _mean_command(position: FloatArray, v_in: FloatArray, free: BoolArray, active: float) -> float:
    moved, weighted = np.empty(len(position)), np.empty(len(position))
    count = 0
    for n in range(len(position)):
        if free[n] and v_in[n] > active:
            moved[count] = position[n] - position[n - 1] if n else 0.0
            weighted[count] = moved[count] * v_in[n]
            count += 1
    total = sum_as_numpy(moved[:count])
    return sum_as_numpy(weighted[:count]) / total if total > 0.0 else np.nan


def find_lag(run: Run, columns: BoolArray, options: OutputErrorOptions) -> int:
    """Return the lag of greatest likelihood; the smallest of equal ones.

    Parameters
    ----------
    run, columns, options : Run, (5,) bool array, OutputErrorOptions
        Same as `fit_lag` takes.
    """
    phases = (find_phases(run, lag, options) for lag in range(options.max_lag + 1))
    fits = [fit_lag(run, each, columns, options) for each in phases]
    return int(np.argmin([f.likelihood for f in fits]))


def hold_samples(run: Run, phases: Phases) -> int:
    """Count usable samples at rest off the seats.

    Parameters
    ----------
    run, phases : Run, Phases
        The cycle, and what the spool does at each sample.
    """
    rest = ~phases.moving & phases.free & run.use
    return int(np.count_nonzero(rest))
