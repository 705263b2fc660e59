# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What cycles are compared with, and how a change is fitted."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.diagnosis import lines
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.lines import (
    fit_changes,
    rays_of_steps,
    whitened_rays,
)
from valve_twin.core.diagnosis.watch.straight import Sums, follow
from valve_twin.core.valves.press_cartridge import MODEL

CONFIG = DetectionConfig()


def strayed(w, m=1):
    """Return how far each m of (N, F) cycles lie off, and by how much those before strayed."""
    sums, begin = Sums.of(w), CONFIG.least + m - 1
    squares = np.zeros((CONFIG.recent, w.shape[1]))
    ratio, factor = np.empty((2, len(w) - begin, w.shape[1]))
    rule = (m, CONFIG.window, CONFIG.threshold)
    rays = np.eye(w.shape[1])
    of = (sums.total, sums.total, sums.moment)
    found = follow(*of, rays, begin, 0, rule, squares, ratio, factor)
    assert found == bool((ratio > np.sqrt(CONFIG.threshold)).any())
    return ratio, factor


@pytest.mark.parametrize(("spread", "least", "most"), [(1.0, 1.0, 1.35), (3.0, 2.2, 4.0)])
def test_it_is_the_root_mean_square_of_what_was_known_before(spread, least, most):
    ratio, factor = strayed(spread * np.random.default_rng(5).standard_normal((200, 30)))
    assert np.all(factor[: CONFIG.recent] == 1.0)
    assert np.all((factor[150:] >= least) & (factor[150:] <= most))
    row = 120
    squares = np.minimum(ratio[: row - CONFIG.recent + 1] ** 2, CONFIG.threshold)
    by_chance = CONFIG.recent + squares.sum(axis=0)
    mean = by_chance / (row + 1)
    assert factor[row] == pytest.approx(np.sqrt(np.maximum(mean, 1.0)), rel=1e-12)


def test_the_newest_cycles_which_are_judged_do_not_count():
    w = np.zeros((50, 1))
    w[38:] = 25.0
    factor = strayed(w)[1][:, 0]
    assert np.all(factor[: 30 + CONFIG.recent] == 1.0)
    assert factor[-1] > 1.0


def test_steps_are_whitened_without_the_levels_of_products():
    table, rng = MODEL.signatures(), np.random.default_rng(3)
    parts = [
        rng.multivariate_normal(level, 9.0 * np.array(table.covariance), 200)
        for level in (np.zeros(len(table.features)), np.full(len(table.features), 7.0))
    ]
    rays = rays_of_steps(parts, table, CONFIG)
    own = np.std(rays.whitened(parts[1]), axis=0, ddof=1)
    assert own[:11] == pytest.approx(1.0 / CONFIG.margin, rel=0.2)  # 4 sigma of a scatter of 400


def test_scatter_that_is_no_noise_may_have_correlations_of_its_own():
    """A valve's parameters scatter: by the correlations of noise a sound cycle lay 350 off."""
    base, rng = MODEL.signatures(), np.random.default_rng(11)
    count = len(base.features)
    alike = 1e-4 * (0.999 * np.ones((count, count)) + 0.001 * np.eye(count))  # noise moves all
    table = replace(base, covariance=tuple(map(tuple, alike)), floor=(1e-9,) * count)
    cycles = 0.3 * rng.standard_normal((400, count))  # and the valve each by itself
    worst = []
    for apart in (0.0, 1.0):
        config = replace(CONFIG, apart=apart)
        rays = whitened_rays(cycles[:20], np.isfinite(cycles[:20]), table, config)
        worst.append(np.quantile(np.abs(rays.whitened(cycles[20:])).max(axis=1), 0.95))
    assert worst[1] < 4.0
    assert worst[0] > 3.0 * worst[1]


def test_a_fault_whose_features_the_cycles_do_not_show_makes_no_step():
    table, rng = MODEL.signatures(), np.random.default_rng(4)
    vectors = rng.multivariate_normal(np.zeros(len(table.features)), table.covariance, 30)
    small_gas = next(k for k, s in enumerate(table.signatures) if s.fault == "aeration")
    assert np.any(rays_of_steps([vectors], table, CONFIG).rays[small_gas])
    vectors[:, table.features.index("delay_in")] = np.nan  # which carries most of it
    assert not np.any(rays_of_steps([vectors], table, CONFIG).rays[small_gas])


def test_a_fault_that_shows_more_or_less_from_cycle_to_cycle_stays_that_fault():
    table = MODEL.signatures()
    none = (0.0,) * len(table.features)
    flat = replace(table, signatures=tuple(replace(s, scatter=none) for s in table.signatures))
    rng = np.random.default_rng(5)
    healthy = rng.multivariate_normal(none, np.array(table.covariance), 60)
    rays = whitened_rays(healthy, np.isfinite(healthy), flat, CONFIG)
    index = next(k for k, s in enumerate(flat.signatures) if s.fault == "leak") + 2
    shown = np.array([0.6, 0.8, 1.0, 1.2, 1.4])[:, None] * rays.changes[index]
    limits = [flat.range(k) for k in range(len(flat.signatures))]
    steady = fit_changes(shown, rays, 0.0, limits, unlike=0.0)[index]
    varied = fit_changes(shown, rays, 0.0, limits, unlike=0.0, varies=0.25)[index]
    assert varied[1] == pytest.approx(1.0) == steady[1]  # the mean is what it was
    assert varied[0] > steady[0]


@pytest.mark.parametrize("count", [1, 2, 7, 8, 31, 32])
def test_quantiles_of_rising_rows_are_those_of_numpy(count):
    rows = np.sort(np.random.default_rng(count).standard_normal((count, 3)), axis=0)
    for share in (0.5, 0.9):
        assert lines._of_rising(rows, share) == pytest.approx(np.quantile(rows, share, axis=0))
