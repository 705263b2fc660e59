# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Counters of movements and travel against what was made, for noise, steps and any stroke."""

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.movement import count_movement


def strokes(rng, moves, least=0.05, samples=200):
    """Return a position of so many movements to random places, and their way."""
    sign = np.where(np.arange(moves) % 2, -1.0, 1.0)
    size = rng.uniform(least, 1.0, moves)
    places = np.concatenate(([0.0], np.cumsum(sign * size)))
    ramp = np.clip(np.linspace(-0.5, 1.5, samples), 0.0, 1.0)
    return (places[:-1, None] + np.diff(places)[:, None] * ramp).ravel(), float(size.sum())


def test_a_million_movements_are_counted_to_one_and_travel_to_a_thousandth():
    """A million is counted in ten parts, as cycles are."""
    rng = np.random.default_rng(7)
    moves, travel, made = 0, 0.0, 0.0
    for _ in range(10):
        position, way = strokes(rng, 100_000, samples=20)
        n, told = count_movement(position + 1e-4 * rng.standard_normal(len(position)))
        moves, travel, made = moves + n, travel + told, made + way
    assert moves == 1_000_000
    assert travel == pytest.approx(made, rel=1e-3)


@pytest.mark.parametrize("samples", [60, 300])
@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_noise_and_length_of_a_stroke_do_not_matter(noise, samples):
    rng = np.random.default_rng(9)
    position, way = strokes(rng, 5000, samples=samples)
    moves, travel = count_movement(position + noise * rng.standard_normal(len(position)))
    assert moves == 5000
    assert travel == pytest.approx(way, rel=1e-3)


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3])
def test_a_quantised_position_that_flickers_at_rest_does_not_move(bits, noise):
    rng = np.random.default_rng(8)
    position, way = strokes(rng, 1000, least=0.1)
    step = 2.0**-bits
    seen = step * np.round((position + noise * rng.standard_normal(len(position))) / step)
    moves, travel = count_movement(seen)
    assert moves == 1000
    assert travel == pytest.approx(way, rel={8: 0.02, 12: 4e-3, 16: 2e-3}[bits])
    held = step * np.round((0.3 + noise * rng.standard_normal(100_000)) / step)
    assert count_movement(held) == (0, 0.0)


def test_nothing_is_counted_of_nothing():
    for position in (np.zeros(0), np.zeros(2), np.full(1000, 0.4)):
        assert count_movement(position) == (0, 0.0)
