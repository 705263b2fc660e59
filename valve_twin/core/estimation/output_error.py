# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Output error of one cycle: pole, gains and leak of the valve from its free run.

The free run of the model is compared with the whole measured cycle, so position noise does not
bias it as it biases the equation error (equations.md 2.6). What the method rests on:

- the lag and the pole are searched, the rest is an exact bounded least squares
  (`output_error_kernel`);
- the leak acts off the seats only, and the level of the run is unknown anew after each seat
  contact;
- repeated, stuck and bad samples have no weight: they are missing;
- both gains may fall with the command (pilot saturation); without that freedom the drift of the
  gain is biased by what the aging does to the commands;
- in motion the level may wander a little, so that a disturbance early in the cycle does not spoil
  all that follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.free_run import (
    OutputErrorOptions,
    Run,
    Solution,
    find_lag,
    fit_lag,
    hold_samples,
    lay_out,
)
from valve_twin.core.estimation.guards import assess_input
from valve_twin.core.estimation.output_error_kernel import N_LINEAR, POLE_MAX
from valve_twin.core.estimation.regression import usable_rows
from valve_twin.core.types import (
    EstimateStatus,
    FloatArray,
    IntArray,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)

if TYPE_CHECKING:
    from valve_twin.core.estimation.guards import Excitation
    from valve_twin.core.estimation.masks import Masks
    from valve_twin.core.types import Frames

ESTIMATOR = "output_error"

NAMES = ("pole", "K_in", "K_in_slope", "v_in_mean", "K_out", "K_out_slope", "leak")
"""Parameters in the order in which they are published."""


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
        Mean squared weighted residual of the free run [1]: the noise variance where the model
        holds.
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
    run = lay_out(frames, masks, period_s, noise_sigma, options)
    reason = _unusable(run, options)
    if reason:
        return _refused(reason, masks)
    columns = np.ones(N_LINEAR, np.bool_)
    lag = options.lag if options.lag >= 0 else find_lag(run, columns, options)
    rows = usable_rows(frames, masks, lag, keep_stale=True)
    inflow, outflow = (
        assess_input(frames, rows, lag, k, noise_sigma=noise_sigma, options=options.guard)
        for k in (0, 1)
    )
    if not (inflow.excited or outflow.excited):
        return _refused(f"inflow: {inflow.reason}; outflow: {outflow.reason}", masks)
    hold = hold_samples(run, lag, options)
    columns = np.array(
        [inflow.excited, inflow.graded, outflow.excited, outflow.graded, hold >= options.min_hold]
    )
    solution = fit_lag(run, lag, columns, options, refine=True)
    return _publish(run, solution, lag, inflow, outflow, hold, masks, options)


def _unusable(run: Run, options: OutputErrorOptions) -> str:
    """Return why a cycle cannot be fitted at all, or nothing."""
    used = int(np.count_nonzero(run.use))
    least = options.max_lag + 3 * N_LINEAR
    if used < least:
        return f"{used} usable samples, {least} needed"
    if float(np.ptp(run.position[run.use])) == 0.0:
        return f"the position stays at {run.position[run.use][0]:.3g}"
    return ""


def _publish(
    run: Run,
    s: Solution,
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
    s: Solution,
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


def _pole(s: Solution, error: float, options: OutputErrorOptions) -> ParameterValue:
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


def _fitted(s: Solution) -> IntArray:
    """Return the columns that are not on a bound, the pole with them."""
    free = np.append(s.linear > 0.0, s.pole > 0.0)
    return np.flatnonzero(free & (np.diag(s.gram)[: N_LINEAR + 1] > 0.0))


def _covariance(s: Solution, mse: float) -> FloatArray:
    """Return the (6, 6) covariance from the residuals alone; infinite where there is none."""
    fitted = _fitted(s)
    covariance = np.full((N_LINEAR + 1, N_LINEAR + 1), np.inf)
    if len(fitted):
        scale = np.sqrt(np.diag(s.gram)[fitted])
        scaled = s.gram[np.ix_(fitted, fitted)] / np.outer(scale, scale)
        inverse = np.linalg.pinv(scaled, hermitian=True) / np.outer(scale, scale)
        covariance[np.ix_(fitted, fitted)] = mse * inverse
    return covariance


def _standard_errors(s: Solution, mse: float) -> FloatArray:
    return np.sqrt(np.maximum(np.diag(_covariance(s, mse)), 0.0))


def _combined_error(s: Solution, first: int, command: float, options: OutputErrorOptions) -> float:
    """Return the standard error of base + sag (2 v_max - command)."""
    block = _covariance(s, s.cost / s.rows)[first : first + 2, first : first + 2]
    weight = np.array([1.0, 2.0 * options.v_max - command])
    return float(np.sqrt(max(weight @ block @ weight, 0.0)))


def _condition(s: Solution) -> float:
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
