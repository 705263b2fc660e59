# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the estimators of the press valve say of one cycle."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.estimation.data.masks import Masks, find_masks
from valve_twin.core.estimation.data.noise import rest_noise
from valve_twin.core.types import (
    Cycle,
    Estimate,
    EstimateStatus,
    Guard,
    MaskCounts,
    ParameterValue,
)
from valve_twin.core.valves.press_cartridge.diagnosis import features
from valve_twin.core.valves.press_cartridge.estimation.equation_error import fit_equation_error
from valve_twin.core.valves.press_cartridge.estimation.guards import check_gap
from valve_twin.core.valves.press_cartridge.estimation.kalman import fit_kalman, pool_ratios
from valve_twin.core.valves.press_cartridge.estimation.lag import LagScan, scan_lag
from valve_twin.core.valves.press_cartridge.estimation.output_error import fit_output_error
from valve_twin.core.valves.press_cartridge.estimation.response.accuracy import scatter_halves
from valve_twin.core.valves.press_cartridge.estimation.response.timing import (
    Timing,
    pool_timing,
    timings_alone,
)
from valve_twin.core.valves.press_cartridge.estimator_options import (
    equation_error_options,
    feature_options,
    guard_options,
    mask_options,
    output_error_options,
)
from valve_twin.core.valves.press_cartridge.estimators import (
    EQUATION_ERROR,
    KALMAN,
    NAME,
    OUTPUT_ERROR,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.valves.press_cartridge.parameters import PressCartridgeOptions


_PUSH = (1.0, -1.0)

_SHARP = 0.005
"""Least relative rise of the one-step error at any other lag that settles the lag, assumed.

Below it the one-step error cannot decide and the free run decides. The free run alone prefers one
sample less with a slow pole in a fifth of the cycles that begin with the command (noise 1e-3),
which moves K_out by 4 %.
"""


def estimates_of(
    cycle: Cycle, options: PressCartridgeOptions, earlier: Sequence[Estimate]
) -> tuple[Estimate, ...]:
    """Estimate a cycle with every configured estimator, the output error unless it is off.

    Constants count as known exactly.

    Parameters
    ----------
    cycle : Cycle
        One cycle of N samples (N > 0).
    options : PressCartridgeOptions
        The model's options.
    earlier : sequence of Estimate
        Those of the cycles before, oldest first; their noise ratios are pooled.

    Returns
    -------
    tuple of Estimate
        One an estimator; REFUSED with its reason where the cycle says nothing.
    """
    masks = _masks(cycle, options)
    sigma = rest_noise(cycle.frames, masks, active_command=options.active_command).sigma
    scan = _scan(cycle, masks, options)
    always = (OUTPUT_ERROR,) if options.output_error else ()
    names = dict.fromkeys((*always, *options.estimators))
    results: list[Estimate] = []
    for name in names:
        if name == FEATURES:
            results.append(_features(cycle, masks, sigma, options))
        elif name in EQUATION_ERROR:
            results.append(_equation_error(name, cycle, masks, sigma, scan, options))
        else:
            timing = _timing_of(results)
            results.append(_gains(name, cycle, masks, sigma, scan, options, earlier, timing))
    return _with_gap(results, options)


def shown_features(cycle: Cycle, options: PressCartridgeOptions) -> tuple[ParameterValue, ...]:
    """Return what a cycle shows of faults, see `diagnosis.features`."""
    return _shown(cycle, _masks(cycle, options), options)


def _masks(cycle: Cycle, options: PressCartridgeOptions) -> Masks:
    return find_masks(cycle.frames, cycle.period_s, push=_PUSH, options=mask_options(options))


def _shown(
    cycle: Cycle, masks: Masks, options: PressCartridgeOptions
) -> tuple[ParameterValue, ...]:
    return features.cycle_features(cycle.frames, masks, cycle.period_s, feature_options(options))


def _gains(
    name: str,
    cycle: Cycle,
    masks: Masks,
    sigma: float,
    scan: LagScan,
    options: PressCartridgeOptions,
    earlier: Sequence[Estimate],
    timing: Timing | None,
) -> Estimate:
    settled = scan.lag >= 0 and scan.sharpness >= _SHARP
    chosen = output_error_options(options, scan.lag if settled else -1)
    data = (cycle.frames, masks, cycle.period_s)
    before = [e for e in earlier if e.estimator == name]
    if name == KALMAN:
        ratios = pool_ratios(np.array([e.value("noise_ratio") for e in before]))
        fit = fit_kalman(
            *data,
            noise_sigma=sigma,
            pooled=ratios,
            timing=timing,
            scatter=scatter_halves(before),
            options=chosen,
        )
    else:
        pooled = pool_timing(timings_alone(before))
        fit = fit_output_error(*data, noise_sigma=sigma, pooled=pooled, options=chosen)
    return _estimate(
        name,
        cycle,
        fit.parameters,
        (fit.status, fit.reason),
        fit.condition_number,
        fit.lag,
        sigma,
        fit.counts,
        fit.guards,
    )


def _features(
    cycle: Cycle, masks: Masks, sigma: float, options: PressCartridgeOptions
) -> Estimate:
    shown = _shown(cycle, masks, options)
    count = sum(p.usable for p in shown)
    whole = count == len(shown)
    status = EstimateStatus.ACCEPTED if whole else EstimateStatus.PARTIAL
    reason = f"{count} of {len(shown)} features of faults are shown"
    counts = MaskCounts(
        int(np.count_nonzero(~masks.any)),
        seat=int(np.count_nonzero(masks.seat)),
        stuck=int(np.count_nonzero(masks.stuck)),
        stale=int(np.count_nonzero(masks.stale)),
        bad=int(np.count_nonzero(masks.bad)),
    )
    return _estimate(FEATURES, cycle, shown, (status, reason), np.nan, 0, sigma, counts)


def _equation_error(
    name: str,
    cycle: Cycle,
    masks: Masks,
    sigma: float,
    scan: LagScan,
    options: PressCartridgeOptions,
) -> Estimate:
    fit = fit_equation_error(
        cycle.frames,
        masks,
        name,
        lag=scan.lag,
        noise_sigma=sigma,
        options=equation_error_options(options),
    )
    return _estimate(
        name,
        cycle,
        fit.parameters,
        (fit.status, fit.reason),
        fit.condition_number,
        max(fit.lag, 0),
        sigma,
        fit.counts,
    )


def _estimate(
    estimator: str,
    cycle: Cycle,
    parameters: tuple[ParameterValue, ...],
    verdict: tuple[EstimateStatus, str],
    condition_number: float,
    lag: int,
    sigma: float,
    counts: MaskCounts,
    guards: tuple[Guard, ...] = (),
) -> Estimate:
    return Estimate(
        model=NAME,
        estimator=estimator,
        parameters=parameters,
        status=verdict[0],
        reason=verdict[1],
        condition_number=condition_number,
        lag=lag,
        noise_sigma=sigma,
        counts=counts,
        used_by_trend=estimator == OUTPUT_ERROR,
        guards=guards,
        **cycle.origin,
    )


def _timing_of(results: Sequence[Estimate]) -> Timing | None:
    """Return delay and pole that the output error found of the same cycle."""
    found = next((e for e in results if e.estimator == OUTPUT_ERROR), None)
    if found is None or not np.isfinite(found.value("delay") + found.value("pole")):
        return None
    delay = found.value("delay")
    return Timing(delay, found.value("pole"), pooled=delay != found.value("delay_alone"))


def _with_gap(
    estimates: Sequence[Estimate], options: PressCartridgeOptions
) -> tuple[Estimate, ...]:
    """Hold the gains against those of the equation error, where that was run."""
    paper = next((e for e in estimates if e.estimator in EQUATION_ERROR), None)
    if paper is None or not any(e.guards for e in estimates):
        return tuple(estimates)
    theta = {p.name: p.value for p in paper.parameters}
    v_ref, guard = options.v_ref, guard_options(options)
    return tuple(
        replace(
            e,
            guards=(
                *e.guards,
                *check_gap({p.name: p.value for p in e.parameters}, theta, v_ref, guard),
            ),
        )
        if e.guards
        else e
        for e in estimates
    )


def _scan(cycle: Cycle, masks: Masks, options: PressCartridgeOptions) -> LagScan:
    """Find the lag, or take the configured one as settled."""
    lag, max_lag = options.lag, options.max_lag
    if lag >= 0:
        return LagScan(lag, np.full(max_lag + 1, np.nan), np.inf)
    return scan_lag(cycle.frames, masks, max_lag=max_lag)
