# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Kalman-whitened, sign-constrained least squares of one cycle: gains with honest intervals.

Measurement noise on every sample and process noise in motion are both taken for what they are; the
ratio of their variances is found by restricted likelihood, and repeated values are missing samples
(equations.md 2.6). The covariance of the innovations gives the interval of each parameter from the
cycle alone. The output error is the case without process noise, the equation error the one without
measurement noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import robust_sigma
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.valves.press_cartridge.estimation.free_run import (
    OutputErrorOptions,
    Phases,
    Solution,
    find_phases,
    mean_command,
)
from valve_twin.core.valves.press_cartridge.estimation.gains import (
    GainFit,
    PreparedCycle,
    gain_fit,
    prepare_cycle,
    refused_fit,
)
from valve_twin.core.valves.press_cartridge.estimation.kalman_kernel import (
    LOG_LOW,
)
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    POLE_MAX,
)
from valve_twin.core.valves.press_cartridge.estimation.response.timing import find_timing
from valve_twin.core.valves.press_cartridge.estimation.structure import check_structure
from valve_twin.core.valves.press_cartridge.estimation.whitened.inverse import inverse_of
from valve_twin.core.valves.press_cartridge.estimation.whitened.moments import (
    cut_moments,
    truncated_moments,
)
from valve_twin.core.valves.press_cartridge.estimation.whitened.ratio import (
    find_ratio,
    look_around,
    moments_around,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.estimation.data.masks import Masks
    from valve_twin.core.types import BoolArray, FloatArray, Frames, IntArray
    from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import Stretch
    from valve_twin.core.valves.press_cartridge.estimation.response.timing import Timing


_SPREAD = np.array([-2.0, -1.5, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0])
"""Where else the likelihood of the noise ratio is looked at, around the one found, logarithmic."""

_MIN_POOLED = 5
"""Fewest cycles that are pooled."""

_LEAST_ERROR = 0.2
"""The ratio of one valve may differ by so much from cycle to cycle, logarithmic, assumed."""

_NEAR = 0.15

_REST = 40
"""Samples of rest on a seat before it is left that count [samples]: they show the level. A spool
within the seat's margin may still sink, which earlier ones would take for noise."""


def fit_kalman(
    frames: Frames,
    masks: Masks,
    period_s: float,
    *,
    noise_sigma: float = float("nan"),
    noise_ratio: float = -1.0,
    pooled: PooledRatio | None = None,
    timing: Timing | None = None,
    scatter: Mapping[str, float] | None = None,
    options: OutputErrorOptions | None = None,
) -> GainFit:
    """Fit pole, K_in, K_out(v), leak and the noise ratio to one cycle.

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
    noise_ratio : float
        Variance of the process noise over that of the measurement noise [1]; negative = search.
    pooled : PooledRatio, optional
        What other cycles of the valve say of it.
    timing : Timing, optional
        Delay and pole that the output error of this cycle uses; searched where omitted.
    scatter : mapping, optional
        Half of the 95 % interval of the scatter of cycles before, as `scatter_halves` returns it.
    options : OutputErrorOptions, optional
        Limits and constraints; `wander` is not used.

    Returns
    -------
    GainFit
        With standard errors from this cycle alone, and 95 % limits that hold the scatter of cycles
        and what is wrong in every cycle alike, too. A cycle that cannot be used is a value with
        its reason, never an exception.
    """
    options = options or OutputErrorOptions()
    prepared = prepare_cycle(frames, masks, period_s, noise_sigma, options)
    if isinstance(prepared, str):
        return refused_fit(prepared, masks)
    timing = timing or find_timing(
        prepared.run, prepared.lag, prepared.columns, options, prepared.phases
    )
    phases = find_phases(prepared.run, timing.delay, options, settle=0)
    timed = replace(options, pole=timing.pole) if timing.pooled else options
    use = prepared.run.use & ~(_long_rest(phases) | phases.leaving)
    data = phases.stretch(prepared.run.position, use)
    mean = mean_command(
        prepared.run.position, phases.v_in, phases.free, options.guard.active_command
    )
    problem = _Problem(prepared, data, mean, timed)
    prior = np.zeros(2)
    if pooled is not None and noise_ratio < 0.0:
        prior[:] = pooled.mean, pooled.standard_error**-2.0
    found = problem.search(noise_ratio, prior)
    solution, ratio = found.solution, found.ratio
    fitted = int(np.count_nonzero(solution.linear)) + (timed.pole < 0.0)
    if solution.rows <= fitted + N_LINEAR:
        text = f"{solution.rows} usable samples off the seats, {fitted + N_LINEAR + 1} needed"
        return refused_fit(Refusal(RefusalCode.FEW_SAMPLES, text), masks)
    covariance = problem.covariance(found, prior, spread=noise_ratio < 0.0)
    fit = gain_fit(
        prepared,
        solution,
        find_phases(prepared.run, timing.delay, options),
        masks,
        options,
        timing=timing,
        noise_ratio=found.alone,
        covariance=covariance,
        scatter=scatter,
    )
    structure = check_structure(prepared.run, phases, use, solution, ratio, options.v_max)
    return replace(fit, guards=(*fit.guards, *structure))


@dataclass(frozen=True, slots=True)
class PooledRatio:
    """What several cycles say of the noise ratio.

    Attributes
    ----------
    mean, standard_error : float
        Of its natural logarithm [1].
    """

    mean: float
    standard_error: float


def pool_ratios(ratios: FloatArray) -> PooledRatio | None:
    """Pool the noise ratios that single cycles found; None where they are too few.

    One cycle shows the ratio within a factor of 1.6 only (sigma 1e-3), and where it finds too
    little its intervals are too narrow. The median does not mind cycles that find none at all.

    Parameters
    ----------
    ratios : (N,) array
        Noise ratios, each of its cycle alone [1]; what is not finite is left out.
    """
    found = np.log(np.maximum(ratios[np.isfinite(ratios)], np.exp(LOG_LOW)))
    if len(found) < _MIN_POOLED:
        return None
    mean = float(np.median(found))
    spread = robust_sigma(found - mean)
    error = 1.2533 * spread / np.sqrt(len(found))  # of a median of normal values
    return PooledRatio(mean, max(error, _LEAST_ERROR))


@dataclass(frozen=True, slots=True)
class _Found:
    """What a search found: ratio alone and with the prior, the solution at the latter, its value.

    The value is minus twice the log restricted likelihood, with the prior.
    """

    alone: float
    ratio: float
    solution: Solution
    value: float


@dataclass(frozen=True, slots=True)
class _Problem:
    """One cycle, whose likelihood is asked for at several noise ratios."""

    cycle: PreparedCycle
    data: Stretch
    v_in_mean: float
    options: OutputErrorOptions

    def search(self, ratio: float, prior: FloatArray) -> _Found:
        """Return the noise ratio of greatest restricted likelihood, alone and with the prior."""
        p, gram = np.zeros(N_LINEAR), np.zeros((N_COLUMNS, N_COLUMNS))
        options, columns = self.options, self.cycle.columns
        alone, found, pole, cost, rows, value = find_ratio(
            self.data, options.v_max, columns, prior, options.pole, ratio, p, gram
        )
        return _Found(alone, found, self._solution(pole, p, gram, cost, rows), value)

    def covariance(self, found: _Found, prior: FloatArray, *, spread: bool) -> FloatArray:
        """Return the (6, 6) covariance, averaged over what the ratio may be.

        Each of `_SPREAD` weighs as its restricted likelihood. With the found ratio taken for
        certain, the leak of one cycle covered 91-92 % at sigma 1e-3, and 87 % where too small a
        ratio was found.
        """
        mode, columns = found.solution, self.cycle.columns
        searched = self.options.pole < 0.0
        fitted = np.flatnonzero(np.append(columns, searched and mode.pole > 0.0))
        own = np.empty((N_LINEAR + 1, N_LINEAR + 1))
        variance = mode.cost / mode.rows
        if not truncated_moments(mode.gram, fitted, variance, own):
            own = _truncated(mode.gram, fitted, variance)
        if not spread:
            return own
        low, high = mode.pole, mode.pole
        if searched:
            low, high = max(mode.pole - _NEAR, 0.0), min(mode.pole + _NEAR, POLE_MAX)
        at = np.log(max(found.ratio, np.exp(LOG_LOW))) + _SPREAD
        v_max, p = self.options.v_max, mode.linear
        around = look_around(self.data, v_max, columns, prior, at, (low, high), mode.pole, p)
        variances, moments, regular = moments_around(around, fitted, mode.pole, p, searched)
        lanes = around[0]
        if not regular:
            for i, variance in enumerate(variances):
                off = np.append(lanes.p[i] - p, lanes.pole[i] - mode.pole)
                moments[i] = _truncated(lanes.gram[i], fitted, variance) + np.outer(off, off)
        values = np.append(lanes.value, found.value)
        with np.errstate(invalid="ignore"):  # exact data: what has no likelihood has no interval
            weight = np.exp(-0.5 * (values - values.min()))
            weight /= weight.sum()
            return np.asarray(np.tensordot(weight[:-1], moments, axes=1) + weight[-1] * own)

    def _solution(
        self, pole: float, p: FloatArray, gram: FloatArray, cost: float, rows: int
    ) -> Solution:
        """Return a solution whose cost a row is the unbiased variance."""
        fitted = int(np.count_nonzero(p)) + (self.options.pole < 0.0)
        unbiased = cost * rows / max(rows - fitted, 1)
        columns, mean = self.cycle.columns, self.v_in_mean
        return Solution(pole, p, gram, columns, unbiased, max(rows, 1), float("nan"), mean)


def _truncated(gram: FloatArray, fitted: IntArray, variance: float) -> FloatArray:
    """Return as `truncated_moments` where the equations may be singular: (6, 6)."""
    fitted = fitted[np.diag(gram)[fitted] > 0.0]
    moments = np.full((N_LINEAR + 1, N_LINEAR + 1), np.inf)
    inverse = inverse_of(gram, fitted)
    free = inverse @ gram[fitted, -1]
    cut_moments(inverse, variance, fitted, free)
    moments[np.ix_(fitted, fitted)] = inverse
    return moments


def _long_rest(phases: Phases) -> BoolArray:
    """Return rest on a seat that is not followed by motion within `_REST` samples: (N,) bool."""
    n = len(phases.seated)
    index = np.arange(n)
    leaves = np.where(phases.seated, n + _REST + 1, index)
    next_free = np.minimum.accumulate(leaves[::-1])[::-1]
    long: BoolArray = phases.seated & (next_free - index > _REST)
    return long
