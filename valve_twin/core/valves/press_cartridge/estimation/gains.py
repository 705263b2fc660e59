# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Gains, pole and leak of a cycle: what can be estimated, and the named values with their flags.

Shared by the estimators that solve for a pole and five positive parameters (`output_error`,
`kalman`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import (
    BoolArray,
    EstimateStatus,
    FloatArray,
    Guard,
    IntArray,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.core.valves.press_cartridge.estimation.excitation import assess_input
from valve_twin.core.valves.press_cartridge.estimation.free_run import (
    OutputErrorOptions,
    Phases,
    Run,
    Solution,
    find_lag,
    find_phases,
    hold_samples,
    lay_out,
)
from valve_twin.core.valves.press_cartridge.estimation.gain_ridges import (
    RIDGE,
    gain_condition,
    gain_identifiability,
    refuse_ridges,
)
from valve_twin.core.valves.press_cartridge.estimation.guards import (
    check_bounds,
    check_condition,
    check_excitation,
    check_identifiability,
    check_noise,
)
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_LINEAR,
    POLE_MAX,
)
from valve_twin.core.valves.press_cartridge.estimation.regression import usable_rows
from valve_twin.core.valves.press_cartridge.estimation.response.accuracy import (
    systematic_halves,
    with_limits,
)
from valve_twin.core.valves.press_cartridge.estimation.whitened.inverse import inverse_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.estimation.data.masks import Masks
    from valve_twin.core.types import Frames
    from valve_twin.core.valves.press_cartridge.estimation.excitation import Excitation
    from valve_twin.core.valves.press_cartridge.estimation.response.timing import Timing

NAMES = (
    "pole",
    "K_in",
    "K_in_slope",
    "v_in_mean",
    "K_out",
    "K_out_slope",
    "leak",
    "delay",
    "delay_alone",
    "pole_alone",
)
"""Parameters in the order in which they are published."""

FOLLOWED = ("K_in", "K_out", "leak")
"""Those that a trend follows."""


@dataclass(frozen=True, slots=True)
class GainFit:
    """What one estimator says about a cycle.

    Attributes
    ----------
    parameters : tuple of ParameterValue
        In the order of `NAMES`; gains [1/sample of stroke per unit command], leak [1/s]. With
        intervals, the noise ratio behind them.
    status, reason : EstimateStatus, str
        Whether it may be used, and why in one line.
    lag : int
        Command to position lag [samples].
    mse : float
        Mean squared weighted residual [1]: the noise variance where the model holds.
    condition_number : float
        Of the column-scaled sensitivities of what was fitted [1].
    counts : MaskCounts
        Samples used and masked.
    noise_ratio : float
        Variance of the process noise over that of the measurement noise [1]; NaN where the
        estimator does not find it.
    guards : tuple of Guard
        What was checked.
    """

    parameters: tuple[ParameterValue, ...]
    status: EstimateStatus
    reason: str
    lag: int
    mse: float
    condition_number: float
    counts: MaskCounts
    noise_ratio: float = float("nan")
    guards: tuple[Guard, ...] = ()


@dataclass(frozen=True, slots=True)
class PreparedCycle:
    """A cycle on its grid, and what of it can be identified.

    Attributes
    ----------
    run : Run
        The cycle on its grid.
    lag : int
        Command to position lag [samples].
    inflow, outflow : Excitation
        What each command did.
    hold : int
        Samples of hold off the seats.
    phases : Phases
        What the spool does at each sample, by the lag.
    columns : (5,) bool array
        Which parameters can be fitted.
    noise_sigma : float
        Position noise at rest [1]; NaN = unknown.
    """

    run: Run
    lag: int
    inflow: Excitation
    outflow: Excitation
    hold: int
    phases: Phases
    columns: BoolArray
    noise_sigma: float


def prepare_cycle(
    frames: Frames, masks: Masks, period_s: float, noise_sigma: float, options: OutputErrorOptions
) -> PreparedCycle | str:
    """Lay a cycle out and find what of it can be identified, or why nothing can.

    Parameters
    ----------
    frames, masks : Frames, Masks
        Samples of one cycle and their masks.
    period_s : float
        Sampling time [s].
    noise_sigma : float
        Standard deviation of the measured position; NaN = not known [1].
    options : OutputErrorOptions
        How the free run is fitted, and when a gain is refused.
    """
    run = lay_out(frames, masks, period_s, noise_sigma, options)
    reason = _unusable(run, options)
    if reason:
        return reason
    everything = np.ones(N_LINEAR, np.bool_)
    lag = options.lag if options.lag >= 0 else find_lag(run, everything, options)
    rows = usable_rows(frames, masks, lag, keep_stale=True)
    inflow, outflow = (
        assess_input(frames, rows, lag, k, noise_sigma=noise_sigma, options=options.guard)
        for k in (0, 1)
    )
    if not (inflow.excited or outflow.excited):
        text = f"inflow: {inflow.reason}; outflow: {outflow.reason}"
        return Refusal(RefusalCode.NOT_EXCITED, text)
    phases = find_phases(run, lag, options)
    hold = hold_samples(run, phases)
    columns = np.array(
        [inflow.excited, inflow.graded, outflow.excited, outflow.graded, hold >= options.min_hold]
    )
    return PreparedCycle(run, lag, inflow, outflow, hold, phases, columns, noise_sigma)


def _unusable(run: Run, options: OutputErrorOptions) -> str:
    """Return why a cycle cannot be fitted at all, or nothing."""
    used = int(np.count_nonzero(run.use))
    least = options.max_lag + 3 * N_LINEAR
    if used < least:
        return Refusal(RefusalCode.FEW_SAMPLES, f"{used} usable samples, {least} needed")
    if float(np.ptp(run.position[run.use])) == 0.0:
        text = f"the position stays at {run.position[run.use][0]:.3g}"
        return Refusal(RefusalCode.NO_MOTION, text)
    return ""


def gain_fit(
    prepared: PreparedCycle,
    solution: Solution,
    phases: Phases,
    masks: Masks,
    options: OutputErrorOptions,
    *,
    timing: Timing,
    alone: Timing | None = None,
    noise_ratio: float = float("nan"),
    covariance: FloatArray | None = None,
    scatter: Mapping[str, float] | None = None,
) -> GainFit:
    """Turn a solution into named parameters with their flags.

    Parameters
    ----------
    prepared : PreparedCycle
        The cycle, and what of it can be identified.
    solution : Solution
        The estimator's minimum.
    phases : Phases
        What the spool does at each sample, by the delay of `timing`.
    masks : Masks
        Masks of the cycle, to be counted.
    options : OutputErrorOptions
        Limits.
    timing, alone : Timing
        When commands act, and what this cycle says of it by itself, where it was asked.
    noise_ratio : float
        As published [1].
    covariance : (6, 6) array, optional
        Of the linear parameters and the pole, infinite where nothing is known [1], if it is to be
        trusted: standard errors and 95 % limits are then published from this cycle alone.
    scatter : mapping, optional
        Half of the 95 % interval of the scatter between cycles, which those limits hold, too.
    """
    mse, fitted = solution.cost / solution.rows, _fitted(solution)
    parameters = _parameters(prepared, solution, mse, fitted, options)
    parameters += _timing_values(timing, alone)
    own = solution.linear if covariance is None else None  # else of another fit
    halves = systematic_halves(solution, prepared.run, phases, timing, options, own)
    if covariance is not None:
        errors = _errors(prepared, solution, covariance, options)
        parameters = with_limits(parameters, errors, halves, scatter)
        parameters += (ParameterValue("noise_ratio", noise_ratio),)
    else:
        parameters = with_limits(parameters, {}, halves)
    found = gain_identifiability(solution, fitted, mse, prepared.run.period_s, options)
    parameters = refuse_ridges(parameters, found)
    condition = gain_condition(solution.gram[fitted[:, None], fitted])
    guard = options.guard
    return GainFit(
        parameters,
        *_verdict(parameters),
        prepared.lag,
        mse,
        condition,
        _mask_counts(masks, solution.rows),
        noise_ratio,
        (
            check_noise(prepared.noise_sigma, guard),
            *check_excitation(prepared.inflow, prepared.outflow, guard),
            check_condition(condition, guard),
            check_bounds(parameters, FOLLOWED),
            check_identifiability(found, RIDGE.max_error),
        ),
    )


def refused_fit(reason: str, masks: Masks) -> GainFit:
    """Return the fit of a cycle that shows nothing."""
    nothing = float("nan")
    parameters = tuple(
        ParameterValue(name, nothing, ParameterStatus.REFUSED, reason) for name in NAMES
    )
    return GainFit(
        parameters, EstimateStatus.REFUSED, reason, 0, nothing, nothing, _mask_counts(masks, 0)
    )


def _mask_counts(masks: Masks, used: int) -> MaskCounts:
    """Count what each mask took out."""
    return MaskCounts(
        used,
        int(np.count_nonzero(masks.seat)),
        int(np.count_nonzero(masks.stuck)),
        int(np.count_nonzero(masks.stale)),
        int(np.count_nonzero(masks.bad | masks.gap)),
    )


def _parameters(
    prepared: PreparedCycle,
    s: Solution,
    mse: float,
    fitted: IntArray,
    options: OutputErrorOptions,
) -> tuple[ParameterValue, ...]:
    covariance = fit_covariance(s, mse, fitted)
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    no_hold = f"{prepared.hold} samples of hold off the seats, {options.min_hold} needed"
    leak = (
        _bounded("leak", float(s.linear[4]) / prepared.run.period_s, on_bound=s.linear[4] <= 0.0)
        if s.columns[4]
        else _missing("leak", no_hold)
    )
    return (
        _pole(s, float(errors[N_LINEAR]), options),
        *_gain("K_in", s, 0, s.v_in_mean, prepared.inflow, covariance, options),
        ParameterValue("v_in_mean", s.v_in_mean)
        if s.columns[0]
        else _missing("v_in_mean", prepared.inflow.reason),
        *_gain("K_out", s, 2, options.v_ref, prepared.outflow, covariance, options),
        leak,
    )


def _gain(
    name: str,
    s: Solution,
    first: int,
    command: float,
    excitation: Excitation,
    covariance: FloatArray,
    options: OutputErrorOptions,
) -> tuple[ParameterValue, ParameterValue]:
    """Return the gain at a command and its slope there."""
    slope_name = f"{name}_slope"
    if not s.columns[first]:
        return _missing(name, excitation.reason), _missing(slope_name, excitation.reason)
    base, sag = float(s.linear[first]), float(s.linear[first + 1])
    value = base + sag * (2.0 * options.v_max - command)
    if base > 0.0 and sag > 0.0:
        error = _gain_error(covariance, first, command, options)
    else:
        k = first if sag <= 0.0 else first + 1
        error = float(np.sqrt(max(covariance[k, k], 0.0)))
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


def _errors(
    prepared: PreparedCycle, s: Solution, covariance: FloatArray, options: OutputErrorOptions
) -> dict[str, float]:
    """Return the standard errors of this cycle by name."""
    variance = np.diag(covariance)
    return {
        "pole": float(np.sqrt(variance[N_LINEAR])),
        "K_in": _gain_error(covariance, 0, s.v_in_mean, options),
        "K_in_slope": float(np.sqrt(variance[1])),
        "K_out": _gain_error(covariance, 2, options.v_ref, options),
        "K_out_slope": float(np.sqrt(variance[3])),
        "leak": float(np.sqrt(variance[4])) / prepared.run.period_s,
    }


def _timing_values(timing: Timing, alone: Timing | None) -> tuple[ParameterValue, ...]:
    found = [ParameterValue("delay", timing.delay)]
    if alone is not None:
        found.append(ParameterValue("delay_alone", alone.delay))
        found.append(ParameterValue("pole_alone", alone.pole))
    return tuple(found)


def _fitted(s: Solution) -> IntArray:
    """Return the columns that are not on a bound, the pole with them."""
    free = np.append(s.linear > 0.0, s.pole > 0.0)
    return np.flatnonzero(free & (np.diag(s.gram)[: N_LINEAR + 1] > 0.0))


def fit_covariance(s: Solution, mse: float, fitted: IntArray) -> FloatArray:
    """Return the (6, 6) covariance of the fitted columns [1]; infinite where there is none.

    Parameters
    ----------
    s : Solution
        The estimator's minimum.
    mse : float
        Variance of the residual [1].
    fitted : (F,) int array
        Columns that were fitted, the pole as column 5.
    """
    covariance = np.full((N_LINEAR + 1, N_LINEAR + 1), np.inf)
    fitted = fitted[np.diag(s.gram)[fitted] > 0.0]
    if len(fitted):
        covariance[fitted[:, None], fitted] = mse * inverse_of(s.gram, fitted)
    return covariance


def _gain_error(
    covariance: FloatArray, first: int, command: float, options: OutputErrorOptions
) -> float:
    """Return the standard error of base + sag (2 v_max - command)."""
    if not np.isfinite(covariance[first + 1, first + 1]):
        return float(np.sqrt(covariance[first, first]))
    block = covariance[first : first + 2, first : first + 2]
    weight = np.array([1.0, 2.0 * options.v_max - command])
    return float(np.sqrt(max(weight @ block @ weight, 0.0)))


def _verdict(parameters: tuple[ParameterValue, ...]) -> tuple[EstimateStatus, str]:
    missing = [p for p in parameters if p.status is ParameterStatus.NOT_EXCITED]
    bound = [p.name for p in parameters if p.status is ParameterStatus.AT_BOUND]
    refused = dict.fromkeys(p.reason for p in parameters if p.status is ParameterStatus.REFUSED)
    parts = list(refused)
    if missing:
        parts.append("not excited: " + "; ".join(f"{p.name} ({p.reason})" for p in missing))
    if bound:
        parts.append(f"at bound: {', '.join(bound)}")
    status = EstimateStatus.PARTIAL if parts else EstimateStatus.ACCEPTED
    return status, "; ".join(parts) or "all parameters free and excited"
