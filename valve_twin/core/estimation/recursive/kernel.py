# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled recursions of the Hammerstein-Wiener adaptation; `recursive` says what they are for.

The adaptation gain is kept as F = U D U^T (U unit upper triangular, D diagonal) and updated after
Bierman: D stays positive whatever the data, which the printed difference of equation (5) does not
promise.
"""

from __future__ import annotations

from math import isfinite, nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray

LINEAR, SEEN, FORGETTING, LARGEST = range(4)
MEMORY_SIZE = 4
"""Linear part of the last output, samples since the last gap, forgetting in force, largest |y|."""

_MAX_HALVINGS = 8
_DIVERGED = 1e9
"""A free run is held at this size: its fit is then a finite number that says enough."""

_RUNAWAY = 10.0
"""A simulated output this many times the largest measured one starts again from it."""


class RecursiveState(NamedTuple):
    """Where an adaptation stands; io can store it.

    Attributes
    ----------
    theta : (P,) array
        Parameters.
    upper, diagonal : (P, P), (P,) arrays
        Adaptation gain F = U D U^T.
    past_y, past_u : (na,), (nk + nb - 1,) arrays
        Past outputs (measured, or simulated by the corrected algorithm) and inputs, newest first.
    gradients : (na + 1, P) array
        Gradients of the simulated outputs; zero in the literal algorithm.
    memory : (4,) array
        See `MEMORY_SIZE`.
    """

    theta: FloatArray
    upper: FloatArray
    diagonal: FloatArray
    past_y: FloatArray
    past_u: FloatArray
    gradients: FloatArray
    memory: FloatArray

    @property
    def gain(self) -> FloatArray:
        """The adaptation gain F (P, P)."""
        scaled: FloatArray = self.upper * self.diagonal
        return scaled @ self.upper.T


@njit(cache=True)
def update_factors(
    upper: FloatArray, diagonal: FloatArray, phi: FloatArray, forgetting: float, gain: FloatArray
) -> None:
    """Update F = U D U^T in place and write F(t+1) phi into `gain`: paper 004, eq. (5).

    Parameters
    ----------
    upper, diagonal : (P, P), (P,) arrays
        Factors of the adaptation gain, written in place [1].
    phi : (P,) array
        Regressor or gradient [1].
    forgetting : float
        Weight of the past, 1 = none is forgotten [1].
    gain : (P,) array
        Overwritten [1].
    """
    n = len(phi)
    alpha = forgetting
    for j in range(n):
        f = phi[j]
        for i in range(j):
            f += upper[i, j] * phi[i]
        v = diagonal[j] * f
        before = alpha
        alpha += v * f
        diagonal[j] *= before / (alpha * forgetting)
        change = -f / before
        for i in range(j):
            old = upper[i, j]
            upper[i, j] = old + gain[i] * change
            gain[i] += v * old
        gain[j] = v
    for j in range(n):
        gain[j] /= alpha


@njit(cache=True)
def bound_trace(upper: FloatArray, diagonal: FloatArray, limit: float) -> None:
    """Scale the adaptation gain back to a trace of at most `limit`: forgetting stays bounded.

    Parameters
    ----------
    upper, diagonal : (P, P), (P,) arrays
        Factors of the adaptation gain; the diagonal is written in place [1].
    limit : float
        Largest trace [1].
    """
    trace = 0.0
    for j in range(len(diagonal)):
        square = 1.0
        for i in range(j):
            square += upper[i, j] * upper[i, j]
        trace += diagonal[j] * square
    if trace > limit:
        diagonal *= limit / trace


@njit(cache=True)
def fill_regressor(
    phi: FloatArray, orders: IntArray, past_y: FloatArray, past_u: FloatArray, linear: float
) -> int:
    """Write the regressor of equation (8) and return the length of its linear part.

    [-y(t-1).. -y(t-na), u(t-nk).. u(t-nk-nb+1), u(t-nk)^2.. u(t-nk)^nl, ylin^2.. ylin^nl]: the
    powers start at 2, a first one would double b_1.

    Parameters
    ----------
    phi : (P,) array
        Overwritten with the regressor [1].
    orders : (4,) int64 array
        na, nb, nk, nl.
    past_y, past_u : (na,), (nk + nb - 1,) arrays
        Past outputs and inputs, the newest first [1].
    linear : float
        Linear part of the last output, ylin [1].
    """
    na, nb, nk, nl = orders
    for i in range(na):
        phi[i] = -past_y[i]
    for j in range(nb):
        phi[na + j] = past_u[nk - 1 + j]
    at = na + nb
    u, power = past_u[nk - 1], past_u[nk - 1]
    power_linear = linear
    for k in range(nl - 1):
        power *= u
        power_linear *= linear
        phi[at + k] = power
        phi[at + nl - 1 + k] = power_linear
    return int(at + nl - 1)


@njit(cache=True)
def is_stable(theta: FloatArray, na: int, radius: float) -> bool:
    """Tell whether all poles of 1 + a_1 z^-1 + .. lie inside `radius`, by the Schur recursion.

    Parameters
    ----------
    theta : (P,) array
        Parameters, a_1 .. a_na first [1].
    na : int
        Number of poles.
    radius : float
        Largest distance of a pole from the origin [1].
    """
    a = np.empty(na + 1)
    a[0] = 1.0
    scale = 1.0
    for i in range(na):
        scale /= radius
        a[i + 1] = theta[i] * scale
    for m in range(na, 0, -1):
        k = a[m]
        if not abs(k) < 1.0:
            return False
        rest = 1.0 - k * k
        for i in range((m // 2) + 1):
            low, high = a[i], a[m - i]
            a[i] = (low - k * high) / rest
            a[m - i] = (high - k * low) / rest
    return True


@njit(cache=True)
def _push(past: FloatArray, value: float) -> None:
    for i in range(len(past) - 1, 0, -1):
        past[i] = past[i - 1]
    past[0] = value


@njit(cache=True)
def _dot(a: FloatArray, b: FloatArray, n: int) -> float:
    total = 0.0
    for i in range(n):
        total += a[i] * b[i]
    return total


@njit(cache=True)
def adapt_block(
    state: RecursiveState,
    orders: IntArray,
    limit: float,
    y: FloatArray,
    u: FloatArray,
    prior: FloatArray,
    posterior: FloatArray,
) -> None:
    """Run equations (4)-(10) over N samples; the state is written in place.

    Parameters
    ----------
    state : RecursiveState
        Parameters, adaptation gain and past; the gradients are not used.
    orders : (4,) int64 array
        na, nb, nk, nl.
    limit : float
        Largest trace of F where something is forgotten [1].
    y, u : (N,) arrays
        Output and input [1]; a sample that is not finite is a gap.
    prior, posterior : (N,) arrays
        Overwritten with the outputs before and after the sample was learned [1]; NaN at a start.
    """
    theta, upper, diagonal = state.theta, state.upper, state.diagonal
    past_y, past_u, memory = state.past_y, state.past_u, state.memory
    phi, gain = np.zeros(len(theta)), np.zeros(len(theta))
    needed = max(len(past_y), len(past_u))
    for n in range(len(y)):
        prior[n], posterior[n] = nan, nan
        if not (isfinite(y[n]) and isfinite(u[n])):
            memory[SEEN] = 0.0
            continue
        if memory[SEEN] >= needed:
            linear = fill_regressor(phi, orders, past_y, past_u, memory[LINEAR])
            prior[n] = _dot(theta, phi, len(phi))
            memory[LINEAR] = _dot(theta, phi, linear)
            update_factors(upper, diagonal, phi, memory[FORGETTING], gain)
            if memory[FORGETTING] < 1.0:
                bound_trace(upper, diagonal, limit)
            error = y[n] - prior[n]
            for j in range(len(theta)):
                theta[j] += gain[j] * error
            posterior[n] = _dot(theta, phi, len(phi))
        else:
            memory[LINEAR] = y[n]
        _push(past_y, y[n])
        _push(past_u, u[n])
        memory[SEEN] += 1.0


@njit(cache=True)
def _learn(
    theta: FloatArray, gain: FloatArray, error: float, na: int, radius: float, trial: FloatArray
) -> None:
    """Go along the gain, half as far until the poles stay inside, not at all if they never do."""
    share = 1.0
    for _ in range(_MAX_HALVINGS):
        for j in range(len(theta)):
            trial[j] = theta[j] + share * gain[j] * error
        if is_stable(trial, na, radius):
            theta[:] = trial
            return
        share *= 0.5


@njit(cache=True)
def correct_block(
    state: RecursiveState,
    orders: IntArray,
    settings: FloatArray,
    y: FloatArray,
    u: FloatArray,
    prior: FloatArray,
    posterior: FloatArray,
) -> None:
    """Run the bias-corrected adaptation over N samples; the state is written in place.

    The regressor holds the model's own past outputs and the update follows the exact gradient of
    the free run, so that noise on the measured output does not enter the regressor.

    Parameters
    ----------
    state : RecursiveState
        As `adapt_block` takes, but the past outputs are simulated ones, and the gradients theirs.
    orders, y, u, prior, posterior : arrays
        Same as `adapt_block` takes.
    settings : (4,) array
        Largest trace of F, largest pole radius, forgetting that is approached, and share of the
        way to it a sample [1].
    """
    theta, upper, diagonal, past_y, past_u, gradients, memory = state
    na, nl = orders[0], orders[3]
    size = len(theta)
    phi, gain, psi, trial = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    needed = max(len(past_y), len(past_u))
    for n in range(len(y)):
        prior[n], posterior[n] = nan, nan
        if not (isfinite(y[n]) and isfinite(u[n])):
            memory[SEEN] = 0.0
            continue
        memory[LARGEST] = max(memory[LARGEST], abs(y[n]))
        output = y[n]
        if memory[SEEN] >= needed:
            before = memory[LINEAR]
            linear = fill_regressor(phi, orders, past_y, past_u, before)
            slope, power = 0.0, 1.0
            for k in range(nl - 1):
                power *= before
                slope += theta[linear + k] * (k + 2) * power
            for j in range(size):
                through = 0.0
                for i in range(na):
                    through -= theta[i] * gradients[i, j]
                own = through + phi[j]
                psi[j] = own + slope * gradients[na, j]
                gradients[na, j] = own if j < linear else through
            prior[n] = _dot(theta, phi, size)
            memory[LINEAR] = _dot(theta, phi, linear)
            update_factors(upper, diagonal, psi, memory[FORGETTING], gain)
            if memory[FORGETTING] < 1.0:
                bound_trace(upper, diagonal, settings[0])
            memory[FORGETTING] += settings[3] * (settings[2] - memory[FORGETTING])
            _learn(theta, gain, y[n] - prior[n], na, settings[1], trial)
            posterior[n] = _dot(theta, phi, size)
            output = posterior[n]
            for i in range(na - 1, 0, -1):
                gradients[i] = gradients[i - 1]
            gradients[0] = psi
            if not abs(output) <= _RUNAWAY * memory[LARGEST]:
                output = y[n]
                memory[SEEN] = 0.0
        if memory[SEEN] < needed:
            memory[LINEAR] = y[n]
            gradients[:] = 0.0
        _push(past_y, output)
        _push(past_u, u[n])
        memory[SEEN] += 1.0


@njit(cache=True)
def run_free(
    theta: FloatArray, orders: IntArray, y: FloatArray, u: FloatArray, simulated: FloatArray
) -> None:
    """Simulate from the first measured samples on.

    Parameters
    ----------
    theta, orders : (P,) array, (4,) int64 array
        Parameters [1]; na, nb, nk, nl.
    y, u : (N,) arrays
        Output (only its first samples count) and input [1].
    simulated : (N,) array
        Overwritten with the outputs [1], NaN at the start.
    """
    na, nb, nk, _ = orders
    past_y, past_u = np.zeros(na), np.zeros(nk + nb - 1)
    phi = np.zeros(len(theta))
    needed = max(na, nk + nb - 1)
    before = 0.0
    for n in range(len(y)):
        simulated[n] = nan
        output = y[n]
        if n >= needed:
            linear = fill_regressor(phi, orders, past_y, past_u, before)
            output = _dot(theta, phi, len(phi))
            if abs(output) > _DIVERGED:
                output = _DIVERGED if output > 0.0 else -_DIVERGED
            before = min(max(_dot(theta, phi, linear), -_DIVERGED), _DIVERGED)
            simulated[n] = output
        else:
            before = output
        _push(past_y, output)
        _push(past_u, u[n])
