# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Output error of one cycle: pole, gains and leak of the valve from its free run.

The free run of the model is compared with the whole measured cycle, so position noise does not bias it as it biases
the equation error (equations.md 2.6). What the method rests on:

- the lag and the pole are searched, the rest is an exact bounded least squares (`output_error_kernel`);
- the leak acts off the seats only, and the level of the run is unknown anew after each seat contact;
- repeated, stuck and bad samples have no weight: they are missing;
- both gains may fall with the command (pilot saturation); without that freedom the drift of the gain is biased by what
  the aging does to the commands;
- in motion the level may wander a little, so that a disturbance early in the cycle does not spoil all that follows.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.guards import Excitation, GuardOptions, assess_input
from valve_twin.core.estimation.masks import held_recently
from valve_twin.core.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    POLE_MAX,
    search_pole,
)
from valve_twin.core.estimation.regression import usable_rows
from valve_twin.core.types import (
    BoolArray,
    EstimateStatus,
    FloatArray,
    Frames,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)

if TYPE_CHECKING:
    from valve_twin.core.estimation.masks import Masks

ESTIMATOR = "output_error"

NAMES = ("pole", "K_in", "K_in_slope", "v_in_mean", "K_out", "K_out_slope", "leak")
"""Parameters in the order in which they are published."""

_LONG_GAP = 10
"""A gap above this many samples is not bridged: the run starts anew behind it."""

_NOISE_MARGIN = 4.0
"""A seat is as wide as this many standard deviations of the noise."""

_SETTLE = 5
"""Samples after the last command that do not count as hold yet."""


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
        Fewest samples of hold off the seats that tell a leak.
    guard : GuardOptions
        When a gain is refused.
    max_relative_error : float
        A gain whose standard error, from the residuals alone, is above this share of it is refused [1].
    """

    v_ref: float = 0.3
    v_max: float = 0.8
    lag: int = -1
    max_lag: int = 4
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
class OutputErrorFit:
    """What the output error says about a cycle.

    Attributes
    ----------
    parameters : tuple of ParameterValue
        In the order of `NAMES`; gains [1/sample of stroke per unit command], leak [1/s].
    status, reason : EstimateStatus, str
        Whether it may be used, and why in one line.
    lag : int
        Command to position lag [samples].
    mse : float
        Mean squared weighted residual of the free run [1]: the noise variance where the model holds.
    condition_number : float
        Of the column-scaled sensitivities of what was fitted [1].
    counts : MaskCounts
        Samples used and masked.
    """

    parameters: tuple[ParameterValue, ...]
    status: EstimateStatus
    reason: str
    lag: int
    mse: float
    condition_number: float
    counts: MaskCounts


def fit_output_error(
    frames: Frames,
    masks: Masks,
    period_s: float,
    *,
    noise_sigma: float = float("nan"),
    options: OutputErrorOptions | None = None,
) -> OutputErrorFit:
    """Fit pole, K_in, K_out(v) and leak to one cycle.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle, inputs (inflow, outflow).
    masks : Masks
        Its masks.
    period_s : float
        Sampling time [s].
    noise_sigma : float
        Position noise at rest [1]; NaN = unknown.
    options : OutputErrorOptions, optional
        Limits and constraints.

    Returns
    -------
    OutputErrorFit
        A cycle that cannot be used is a value with its reason, never an exception.
    """
    options = options or OutputErrorOptions()
    run = _lay_out(frames, masks, period_s, noise_sigma, options)
    reason = _unusable(run, options)
    if reason:
        return _refused(reason, masks)
    columns = np.ones(N_LINEAR, np.bool_)
    lag = options.lag if options.lag >= 0 else _find_lag(run, columns, options)
    rows = usable_rows(frames, masks, lag, keep_stale=True)
    inflow, outflow = (
        assess_input(frames, rows, lag, k, noise_sigma=noise_sigma, options=options.guard)
        for k in (0, 1)
    )
    if not (inflow.excited or outflow.excited):
        return _refused(f"inflow: {inflow.reason}; outflow: {outflow.reason}", masks)
    hold = _hold_samples(run, lag, options)
    columns = np.array(
        [inflow.excited, inflow.graded, outflow.excited, outflow.graded, hold >= options.min_hold]
    )
    solution = _search(run, lag, columns, options, refine=True)
    return _publish(run, solution, lag, inflow, outflow, hold, masks, options)


@dataclass(frozen=True, slots=True)
class _Run:
    """A cycle on a grid without holes."""

    position: FloatArray
    use: BoolArray
    stuck: BoolArray
    broken: BoolArray
    v_in: FloatArray
    v_out: FloatArray
    margin: float
    period_s: float


@dataclass(frozen=True, slots=True)
class _Solution:
    """Pole, linear parameters and their normal equations."""

    pole: float
    linear: FloatArray
    gram: FloatArray
    columns: BoolArray
    cost: float
    rows: int
    likelihood: float
    v_in_mean: float


def _lay_out(
    frames: Frames,
    masks: Masks,
    period_s: float,
    noise_sigma: float,
    options: OutputErrorOptions,
) -> _Run:
    """Put the samples on a grid of whole periods; missing ones have no weight, commands hold."""
    steps = np.maximum(np.rint(np.diff(frames.stamp_ns) / (period_s * 1e9)), 1.0)
    steps = np.minimum(steps, 1e6).astype(np.int64)
    long = steps > _LONG_GAP
    steps[long] = options.max_lag + 1
    index = np.concatenate((np.zeros(min(len(frames), 1), np.int64), np.cumsum(steps)))
    size = int(index[-1]) + 1 if len(index) else 0
    source = np.searchsorted(index, np.arange(size), side="right") - 1
    here = np.zeros(size, np.bool_)
    here[index] = True
    broken = np.zeros(size, np.bool_)
    broken[index[1:][long]] = True
    known = ~masks.bad & np.isfinite(frames.position)
    position = _held(frames.position, known)
    command = np.where(np.isfinite(frames.inputs), frames.inputs, 0.0)
    margin = options.seat_margin
    if np.isfinite(noise_sigma):
        margin = max(margin, _NOISE_MARGIN * noise_sigma)
    return _Run(
        position=position[source],
        use=(known & ~masks.any)[source] & here,
        stuck=masks.stuck[source],
        broken=broken,
        v_in=np.clip(command[source, 0] - options.offset_in, 0.0, options.v_max),
        v_out=np.clip(command[source, 1] - options.offset_out, 0.0, options.v_max),
        margin=margin,
        period_s=period_s,
    )


def _held(values: FloatArray, known: BoolArray) -> FloatArray:
    """Replace unknown values by the last known one, before the first by that."""
    if not known.any():
        return np.zeros(len(values))
    index = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return values[np.where(index < 0, int(np.argmax(known)), index)]


def _unusable(run: _Run, options: OutputErrorOptions) -> str:
    """Return why a cycle cannot be fitted at all, or nothing."""
    used = int(np.count_nonzero(run.use))
    least = options.max_lag + 3 * N_LINEAR
    if used < least:
        return f"{used} usable samples, {least} needed"
    if float(np.ptp(run.position[run.use])) == 0.0:
        return f"the position stays at {run.position[run.use][0]:.3g}"
    return ""


def _acting(command: FloatArray, lag: int) -> FloatArray:
    """Return the command that acts at each sample: `lag` samples old, the first one before that."""
    return np.concatenate((np.full(min(lag, len(command)), command[0]), command[: len(command) - lag]))


def _search(
    run: _Run, lag: int, columns: BoolArray, options: OutputErrorOptions, *, refine: bool
) -> _Solution:
    """Fit for one lag."""
    v_in, v_out = _acting(run.v_in, lag), _acting(run.v_out, lag)
    seated = _seated(run, v_in, v_out, options)
    anchor = run.broken | run.stuck
    anchor[1:] |= seated[1:] & ~seated[:-1]
    active = options.guard.active_command
    moving = (v_in > active) | (v_out > active)
    free = ~(seated | run.stuck)
    p, gram = np.zeros(N_LINEAR), np.zeros((N_COLUMNS, N_COLUMNS))
    pole, cost, log_determinant, rows = search_pole(
        run.position,
        run.use,
        free,
        anchor,
        moving,
        v_in,
        v_out,
        options.v_max,
        options.wander,
        columns,
        options.pole,
        refine,
        p,
        gram,
    )
    rows = max(rows, 1)
    likelihood = float(np.log(max(cost, 1e-300) / rows) + log_determinant / rows)
    mean = _mean_command(run.position, v_in, free)
    return _Solution(pole, p, gram, columns, cost, rows, likelihood, mean)


def _seated(
    run: _Run, v_in: FloatArray, v_out: FloatArray, options: OutputErrorOptions
) -> BoolArray:
    """Return where the spool rests on a seat: near it, and nothing drives it away."""
    active = options.guard.active_command
    low = (run.position <= options.lower_seat + run.margin) & (v_in <= active)
    high = (run.position >= options.upper_seat - run.margin) & (v_out <= active)
    return low | high


def _mean_command(position: FloatArray, v_in: FloatArray, free: BoolArray) -> float:
    """Return the inflow command, averaged with the displacement during it as weight [1].

    The noise of the increments stays in the sum: it has mean zero there, but not in its positive part.
    """
    moved = np.diff(position, prepend=position[:1])
    on = free & (v_in > 0.0)
    total = float(np.sum(moved[on]))
    return float(np.sum(moved[on] * v_in[on])) / total if total > 0.0 else float("nan")


def _find_lag(run: _Run, columns: BoolArray, options: OutputErrorOptions) -> int:
    """Return the lag of greatest likelihood; the smallest of equal ones."""
    fits = [
        _search(run, lag, columns, options, refine=False) for lag in range(options.max_lag + 1)
    ]
    return int(np.argmin([f.likelihood for f in fits]))


def _hold_samples(run: _Run, lag: int, options: OutputErrorOptions) -> int:
    """Count usable samples at rest off the seats."""
    v_in, v_out = _acting(run.v_in, lag), _acting(run.v_out, lag)
    active = options.guard.active_command
    busy = held_recently((v_in > active) | (v_out > active), _SETTLE)
    rest = ~busy & ~_seated(run, v_in, v_out, options) & ~run.stuck & run.use
    return int(np.count_nonzero(rest))


def _publish(
    run: _Run,
    s: _Solution,
    lag: int,
    inflow: Excitation,
    outflow: Excitation,
    hold: int,
    masks: Masks,
    options: OutputErrorOptions,
) -> OutputErrorFit:
    """Turn the solution into named parameters with their flags."""
    mse = s.cost / s.rows
    errors = _standard_errors(s, mse)
    no_hold = f"{hold} samples of hold off the seats, {options.min_hold} needed"
    leak = (
        _bounded("leak", float(s.linear[4]) / run.period_s, on_bound=s.linear[4] <= 0.0)
        if s.columns[4]
        else _missing("leak", no_hold)
    )
    parameters = (
        _pole(s, errors[N_LINEAR], options),
        *_gain("K_in", s, 0, s.v_in_mean, inflow, errors, options),
        ParameterValue("v_in_mean", s.v_in_mean)
        if s.columns[0]
        else _missing("v_in_mean", inflow.reason),
        *_gain("K_out", s, 2, options.v_ref, outflow, errors, options),
        leak,
    )
    return OutputErrorFit(
        parameters,
        *_verdict(parameters),
        lag,
        mse,
        _condition(s),
        _counts(masks, s.rows),
    )


def _gain(
    name: str,
    s: _Solution,
    first: int,
    command: float,
    excitation: Excitation,
    errors: FloatArray,
    options: OutputErrorOptions,
) -> tuple[ParameterValue, ParameterValue]:
    """Return the gain at a command and its slope there."""
    slope_name = f"{name}_slope"
    if not s.columns[first]:
        return _missing(name, excitation.reason), _missing(slope_name, excitation.reason)
    base, sag = float(s.linear[first]), float(s.linear[first + 1])
    value = base + sag * (2.0 * options.v_max - command)
    error = float(errors[first if sag <= 0.0 else first + 1])
    if base > 0.0 and sag > 0.0:
        error = _combined_error(s, first, command, options)
    if not error <= options.max_relative_error * value and value > 0.0:
        reason = f"standard error {error:.2g} of {value:.2g}: too little motion for the noise"
        return _missing(name, reason), _missing(slope_name, reason)
    gain = _bounded(name, value, on_bound=value <= 0.0)
    if not s.columns[first + 1]:
        return gain, _missing(slope_name, excitation.reason)
    return gain, _bounded(slope_name, -sag, on_bound=base <= 0.0 or sag <= 0.0)


def _pole(s: _Solution, error: float, options: OutputErrorOptions) -> ParameterValue:
    if options.pole >= 0.0:
        return ParameterValue("pole", s.pole, ParameterStatus.AT_BOUND, "fixed by configuration")
    on_bound = s.pole <= 0.0 or s.pole >= POLE_MAX
    if not on_bound and not error <= options.max_relative_error:
        return _missing("pole", f"standard error {error:.2g}: the motion shows no transient")
    return _bounded("pole", s.pole, on_bound=on_bound)


def _bounded(name: str, value: float, *, on_bound: bool) -> ParameterValue:
    if on_bound:
        return ParameterValue(
            name, value, ParameterStatus.AT_BOUND, f"rests on its bound {value:.4g}"
        )
    return ParameterValue(name, value)


def _missing(name: str, reason: str) -> ParameterValue:
    return ParameterValue(name, float("nan"), ParameterStatus.NOT_EXCITED, reason)


def _fitted(s: _Solution) -> FloatArray:
    """Return the columns that are not on a bound, the pole with them."""
    free = np.append(s.linear > 0.0, s.pole > 0.0)
    return np.flatnonzero(free & (np.diag(s.gram)[: N_LINEAR + 1] > 0.0))


def _covariance(s: _Solution, mse: float) -> FloatArray:
    """Return the (6, 6) covariance from the residuals alone; infinite where there is none."""
    fitted = _fitted(s)
    covariance = np.full((N_LINEAR + 1, N_LINEAR + 1), np.inf)
    if len(fitted):
        scale = np.sqrt(np.diag(s.gram)[fitted])
        scaled = s.gram[np.ix_(fitted, fitted)] / np.outer(scale, scale)
        inverse = np.linalg.pinv(scaled, hermitian=True) / np.outer(scale, scale)
        covariance[np.ix_(fitted, fitted)] = mse * inverse
    return covariance


def _standard_errors(s: _Solution, mse: float) -> FloatArray:
    return np.sqrt(np.maximum(np.diag(_covariance(s, mse)), 0.0))


def _combined_error(
    s: _Solution, first: int, command: float, options: OutputErrorOptions
) -> float:
    """Standard error of base + sag (2 v_max - command)."""
    block = _covariance(s, s.cost / s.rows)[first : first + 2, first : first + 2]
    weight = np.array([1.0, 2.0 * options.v_max - command])
    return float(np.sqrt(max(weight @ block @ weight, 0.0)))


def _condition(s: _Solution) -> float:
    """Return the condition number of the column-scaled sensitivities."""
    fitted = _fitted(s)
    if not len(fitted):
        return float("nan")
    scale = np.sqrt(np.diag(s.gram)[fitted])
    values = np.linalg.eigvalsh(s.gram[np.ix_(fitted, fitted)] / np.outer(scale, scale))
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 0.0 else float("inf")


def _verdict(parameters: tuple[ParameterValue, ...]) -> tuple[EstimateStatus, str]:
    missing = [p for p in parameters if p.status is ParameterStatus.NOT_EXCITED]
    bound = [p.name for p in parameters if p.status is ParameterStatus.AT_BOUND]
    parts = []
    if missing:
        parts.append("not excited: " + "; ".join(f"{p.name} ({p.reason})" for p in missing))
    if bound:
        parts.append(f"at bound: {', '.join(bound)}")
    status = EstimateStatus.PARTIAL if parts else EstimateStatus.ACCEPTED
    return status, "; ".join(parts) or "all parameters free and excited"


def _counts(masks: Masks, used: int) -> MaskCounts:
    return MaskCounts(
        used,
        int(masks.seat.sum()),
        int(masks.stuck.sum()),
        int(masks.stale.sum()),
        int((masks.bad | masks.gap).sum()),
    )


def _refused(reason: str, masks: Masks) -> OutputErrorFit:
    nothing = float("nan")
    parameters = tuple(
        ParameterValue(name, nothing, ParameterStatus.REFUSED, reason) for name in NAMES
    )
    return OutputErrorFit(
        parameters, EstimateStatus.REFUSED, reason, 0, nothing, nothing, _counts(masks, 0)
    )
