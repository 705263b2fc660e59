# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Intervals of the positioner from blocks of one cycle: what they cover, when there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from valve_twin.core.types import Cycle, Frames, ParameterStatus
from valve_twin.core.valves.kit.intervals import block_errors, block_masks
from valve_twin.core.valves.positioner.kernels import advance
from valve_twin.core.valves.positioner.model import MODEL
from valve_twin.core.valves.registry import complete_options

PERIOD_S = 0.01
TRUTH = (8.0, 5.0, 0.9, 0.6, 0.01)
NAMES = ("rate_rising", "rate_falling", "slew_rising", "slew_falling", "dead_band")
OPTIONS = complete_options(MODEL, {"max_delay_s": 0.03, "interval_blocks": 20})


def noisy_cycle(seed, hang_together, n=1600):
    """Random steps; the noise of neighbouring samples hangs together as a model error does."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(0.1, 0.9, n // 40), 40)
    position = np.full(n, 0.5)
    for k in range(3, n):
        position[k] = advance(position[k - 1], command[k - 2], np.array(TRUTH), PERIOD_S)
    noise = lfilter([np.sqrt(1 - hang_together**2)], [1, -hang_together], rng.normal(0, 2e-3, n))
    nothing = np.full(n, np.nan)
    stamps = np.arange(n, dtype=np.int64) * 10_000_000
    ok = np.ones(n, dtype=bool)
    frames = Frames(stamps, position + noise, command.reshape(-1, 1), nothing, nothing, ok)
    return Cycle(1, PERIOD_S, frames)


@pytest.mark.no_cover
@pytest.mark.parametrize("hang_together", [0.0, 0.9])
def test_the_intervals_cover_the_truth(hang_together):
    """95 % intended; of 200 intervals 0.91 leaves 2.6 binomial standard deviations."""
    distance, covered = [], []
    for seed in range(40):
        (found,) = MODEL.estimate(noisy_cycle(seed, hang_together, 3200), OPTIONS)
        values = {p.name: p for p in found.parameters}
        for name, truth in zip(NAMES, TRUTH, strict=True):
            value = values[name]
            if np.isfinite(value.standard_error):
                covered.append(value.lower_95 <= truth <= value.upper_95)
                distance.append((value.value - truth) / value.standard_error)
    assert len(covered) > 180
    assert np.mean(covered) >= 0.91
    assert 0.8 < np.std(distance) < 1.3  # neither too narrow nor generous


def test_without_blocks_a_cycle_gives_no_interval():
    options = complete_options(MODEL, {"max_delay_s": 0.03})
    (found,) = MODEL.estimate(noisy_cycle(1, 0.0), options)
    assert all(np.isnan(p.standard_error) for p in found.parameters)


def test_a_parameter_on_its_bound_has_no_interval():
    cycle = noisy_cycle(1, 0.0)
    (found,) = MODEL.estimate(cycle, replace(OPTIONS, max_dead_band=0.005))
    (band,) = (p for p in found.parameters if p.name == "dead_band")
    assert band.status is ParameterStatus.AT_BOUND
    assert np.isnan(band.standard_error)


def test_of_white_residuals_the_errors_are_those_of_least_squares():
    """Against the textbook: sigma^2 (X^T X)^-1, mean over records of 40 blocks."""
    rng = np.random.default_rng(7)
    design = rng.normal(size=(4000, 3)) * [1.0, 5.0, 0.2]
    used = np.ones(4000, dtype=np.bool_)
    hessian = design.T @ design
    variances = []
    for _ in range(60):
        noise = rng.normal(0, 0.3, 4000)
        residual = noise - design @ np.linalg.solve(hessian, design.T @ noise)

        def normal(mask, residual=residual):
            part = design[mask]
            return part.T @ residual[mask], part.T @ part

        free = np.ones(3, dtype=np.bool_)
        variances.append(block_errors(hessian, normal, used, free, 40) ** 2)
    textbook = 0.3**2 * np.diag(np.linalg.inv(hessian))
    assert np.mean(variances, axis=0) == pytest.approx(textbook, rel=0.12)


def test_blocks_share_the_used_samples():
    used = np.ones(100, dtype=np.bool_)
    used[20:50] = False
    masks = block_masks(used, 7)
    assert np.array_equal(np.sum(masks, axis=0), used)
    assert {int(m.sum()) for m in masks} == {10}
