# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.aging.wave import Wave, find_waves

U = np.linspace(0.0, 1.0, 120)


def left(found, y):
    """Share of the variance of y that a wave and a line leave."""
    wave, _ = found
    matrix = np.column_stack([np.ones(len(U)), U, wave.columns(U)])
    rest = y - matrix @ np.linalg.lstsq(matrix, y, rcond=None)[0]
    return float(rest @ rest) / float(np.sum((y - y.mean()) ** 2))


@pytest.mark.parametrize("teeth", [2.7, 4.5, 7.3])
@pytest.mark.parametrize("chirp", [-0.15, 0.0, 0.15])
def test_teeth_are_found_with_their_edges_and_height(teeth, chirp, scatter):
    turn = teeth * (U + chirp * U * (U - 1.0)) + 0.3
    y = 0.01 * (turn - np.floor(turn)) + 5e-4 * scatter(1, 120)
    (wave, size), _ = find_waves(U, y, U)
    assert wave.toothed
    assert wave.period == pytest.approx(1.0 / teeth, rel=0.2)
    assert size[0] == pytest.approx(0.01, rel=0.1)
    assert left((wave, size), y) < 0.12


def test_a_sine_is_found(scatter):
    y = 0.01 * np.sin(2.0 * np.pi * 5.3 * U + 1.0) + 1e-3 * scatter(2, 120)
    _, (wave, size) = find_waves(U, y, U)
    assert not wave.toothed
    assert np.hypot(*size) == pytest.approx(0.01, rel=0.05)
    assert left((wave, size), y) < 0.03


def test_teeth_have_the_mean_zero_and_unit_height():
    wave = Wave(np.linspace(-0.25, 1.25, 7), toothed=True)
    column = wave.columns(np.linspace(0.0, 1.0, 4001))[:, 0]
    assert column.mean() == pytest.approx(0.0, abs=1e-3)
    assert np.ptp(column) == pytest.approx(1.0, abs=1e-2)
    assert wave.period == pytest.approx(0.25)
