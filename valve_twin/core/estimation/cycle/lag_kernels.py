# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled passes over one cycle: what varies, and motion against two commands at a lag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray


@njit(cache=True)
def varies(values: FloatArray) -> bool:
    """Return whether N > 0 finite values are not all the same."""
    i = 1
    while i < len(values) and values[i] == values[0]:
        i += 1
    return i < len(values)


@njit(cache=True)
def equals(first: FloatArray, second: FloatArray) -> bool:
    """Return whether two columns of N values are the same in every sample."""
    i = 0
    while i < len(first) and first[i] == second[i]:
        i += 1
    return i == len(first)


@njit(cache=True)
def steps_within(position: FloatArray, largest: float) -> bool:
    """Return whether N positions step by anything up to the largest, but not by 0."""
    for i in range(1, len(position)):
        if 0.0 < abs(position[i] - position[i - 1]) <= largest:
            return True
    return False


@njit(cache=True)
def explained_by_lag(
    position: FloatArray, inputs: FloatArray, reach: int, stop: float = 0.0
) -> FloatArray:
    """Return the share of the motion that commands of 0 or 1 explain, by lag [1].

    A command that is on or off moves the position from where it was when it went on to where it
    was when it went off: the sums over its runs cost nothing per sample.

    Parameters
    ----------
    position : (N,) array
        Position [1], finite.
    inputs : (N, 2) array
        The command that raises it and the one that lowers it [1]; on where positive.
    reach : int
        Longest lag in either direction, less than N [samples].
    stop : float
        Share of its span within which a position at its end is at a stop, where a command that
        presses on is none; 0 = there are no stops [1].

    Returns
    -------
    (2 reach + 1,) array
        At lag -reach..reach; a positive lag means that the position moves after the command.
    """
    n = len(position) - 1
    energy = np.zeros(n + 1)
    for i in range(n):
        step = position[i + 1] - position[i]
        energy[i + 1] = energy[i] + step * step
    explained = np.zeros(2 * reach + 1)
    free = np.zeros(n + 1, np.int64)
    edges = np.empty(n + 2, np.int64)
    low, high = position.min(), position.max()
    near = stop * (high - low) if stop > 0.0 else -np.inf
    for command in range(2):
        sign = 1.0 if command == 0 else -1.0
        end_stop = high - near if command == 0 else low + near
        count = 0
        for i in range(n):
            active = inputs[i, command] > 0.0
            free[i + 1] = free[i] + (sign * (position[i] - end_stop) < 0.0)
            if active != (count % 2 == 1):
                edges[count] = i
                count += 1
        if count % 2 == 1:
            edges[count] = n
            count += 1
        for k in range(2 * reach + 1):
            lag = k - reach
            along, power = 0.0, 0
            for e in range(0, count, 2):
                begin = min(max(edges[e] + lag, 0), n)
                end = min(max(edges[e + 1] + lag, 0), n)
                along += position[end] - position[begin]
                power += free[end] - free[begin]
            along *= sign
            if power > 0 and along > 0.0:
                explained[k] += along * along / power
    for k in range(2 * reach + 1):
        lag = k - reach
        total = energy[n] - energy[lag] if lag >= 0 else energy[n + lag]
        explained[k] = explained[k] / total if total > 0.0 else 0.0
    return explained


@njit(cache=True)
def effects_at_lag(
    position: FloatArray, inputs: FloatArray, lag: int
) -> tuple[float, float, float]:
    """Fit the increments of the position by two commands.

    Parameters
    ----------
    position : (N,) array
        Position [1], finite.
    inputs : (N, 2) array
        Commands [1].
    lag : int
        From command to increment, at most N - 4 [samples].

    Returns
    -------
    tuple of float
        Share of the increments that is explained and both effects over their standard errors [1].
    """
    count = len(position) - 1 - lag
    total = a = b = c = p = q = 0.0
    for i in range(count):
        u, v = inputs[i, 0], inputs[i, 1]
        step = position[i + lag + 1] - position[i + lag]
        total += step * step
        a += u * u
        b += v * v
        c += u * v
        p += u * step
        q += v * step
    if not (total > 0.0 and a + b > 0.0):
        return 0.0, 0.0, 0.0
    d = a * b - c * c
    first = second = first_error = second_error = 0.0
    if d > 1e-9 * (a + b) ** 2:
        first, second = (b * p - c * q) / d, (a * q - c * p) / d
        first_error, second_error = b / d, a / d
    elif a >= b:  # one of them never acts, or both act alike
        first, first_error = p / a, 1.0 / a
    else:
        second, second_error = q / b, 1.0 / b
    rest = max(total - first * p - second * q, 0.0)
    noise = max(rest, np.finfo(np.float64).eps * total) / (count - 2)
    return (
        1.0 - rest / total,
        first / np.sqrt(first_error * noise) if first_error > 0.0 else 0.0,
        second / np.sqrt(second_error * noise) if second_error > 0.0 else 0.0,
    )
