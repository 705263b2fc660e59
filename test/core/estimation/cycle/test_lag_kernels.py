# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The compiled comparisons of motion and commands against their definitions in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.lag_kernels import effects_at_lag, explained_by_lag


def cycle(seed: int, samples: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Return a position and commands that chatter (even seeds) or come in pulses."""
    rng = np.random.default_rng(seed)
    inputs = (rng.random((samples, 2)) > rng.random()) * rng.random((samples, 2))
    if seed % 2:
        inputs = np.repeat(inputs[: samples // 20], 20, axis=0)
    lag = int(rng.integers(-10, 10))
    moved = np.cumsum(np.roll(inputs[:, 0] - inputs[:, 1], lag))
    return 0.01 * moved + 1e-3 * rng.normal(size=samples), inputs


def explained_in_numpy(
    position: np.ndarray, inputs: np.ndarray, lag: int, stop: float = 0.0
) -> float:
    """Return the share of the motion that two commands of 0 or 1 explain at one lag."""
    near = stop * np.ptp(position) if stop else -np.inf
    free = np.stack((position < position.max() - near, position > position.min() + near), axis=1)
    motion = np.diff(position)
    on, free = inputs[:-1] > 0.0, free[:-1]
    count = len(motion) - abs(lag)
    motion, free = (x[max(lag, 0) :][:count] for x in (motion, free))
    on = on[max(-lag, 0) :][:count]
    total = 0.0
    for active, moves, sign in zip(on.T, free.T, (1.0, -1.0), strict=True):
        along = max(sign * motion[active].sum(), 0.0)
        power = np.count_nonzero(active & moves)
        total += along**2 / power if power else 0.0
    return total / float(motion @ motion)


@pytest.mark.parametrize("stop", [0.0, 0.05])
@pytest.mark.parametrize("seed", range(8))
def test_the_share_by_lag_is_that_of_its_definition(seed, stop):
    position, inputs = cycle(seed)
    found = explained_by_lag(position, inputs, 40, stop)
    expected = [explained_in_numpy(position, inputs, lag, stop) for lag in range(-40, 41)]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_a_position_at_rest_is_explained_by_nothing():
    assert not explained_by_lag(np.full(50, 0.3), np.ones((50, 2)), 10).any()


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("lag", [0, 3])
def test_the_effects_are_those_of_least_squares(seed, lag):
    position, inputs = cycle(seed)
    increments = np.diff(position)[lag:]
    u = inputs[: len(increments)]
    effects, rest, rank, _ = np.linalg.lstsq(u, increments, rcond=None)
    assert rank == 2
    errors = np.sqrt(np.diag(np.linalg.inv(u.T @ u)) * rest[0] / (len(u) - 2))
    explained, *t = effects_at_lag(position, inputs, lag)
    assert explained == pytest.approx(1.0 - rest[0] / (increments @ increments))
    np.testing.assert_allclose(t, effects / errors, rtol=1e-7)


def test_a_command_that_never_acts_has_no_effect():
    position, inputs = cycle(1)
    inputs[:, 1] = 0.0
    explained, rising, falling = effects_at_lag(position, inputs, 0)
    increments, u = np.diff(position), inputs[:-1, 0]
    first = (u @ increments) / (u @ u)
    assert explained == pytest.approx(first * (u @ increments) / (increments @ increments))
    assert falling == 0.0
    assert np.sign(rising) == np.sign(first)
