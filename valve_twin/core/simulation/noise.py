# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Noise of sensors inside a plant: a function of seed and index, so any block gives its bits."""

from __future__ import annotations

from math import cos, log, pi, sqrt

import numpy as np

from valve_twin.kernels import njit


@njit(cache=True)
def uniform_at(seed: int, index: int) -> float:
    """Return a number in (0, 1) that depends on seed and index only (splitmix64)."""
    z = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(index)
    z = (z + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return (float(z >> np.uint64(11)) + 0.5) / 9007199254740992.0


@njit(cache=True)
def normal_at(seed: int, index: int) -> float:
    """Return a normal number that depends on seed and index only."""
    first, second = uniform_at(seed, 2 * index), uniform_at(seed, 2 * index + 1)
    return sqrt(-2.0 * log(first)) * cos(2.0 * pi * second)
