# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cycles that obey the identified model exactly, with known truth.

Measurement noise on every sample, process noise on the increments in motion only, leak off the
lower seat only, known seats and lag. The commands come from a proportional controller with a dead
band that follows the reference of the press experiment: rest, near-step to 0.2, ramp to 0.28,
hold, return.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from valve_twin.core.types import Cycle, FloatArray, Frames
from valve_twin.core.valves.press_cartridge.predictor import (
    COEFFICIENTS,
    HIGH_SEAT,
    LAG,
    LEAK,
    LOW_SEAT,
    step,
)

CYCLE_SAMPLES = 850
"""Samples of the reference cycle: 25.5 s at 0.03 s."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What a generated cycle obeys.

    Attributes
    ----------
    pole : float
        Pole z = 1 + theta_1 of the increments [1].
    k_in : float
        Inflow gain [1/sample of stroke per unit command].
    k_out, k_out_slope : float
        Outflow gain is k_out + k_out_slope (v - v_ref), same unit.
    v_ref : float
        Command at which k_out holds [1].
    leak : float
        Loss of position off the seat [1/sample].
    lag : int
        From command to position [samples].
    sigma : float
        Standard deviation of the measurement noise [1].
    process_noise : float
        Standard deviation of the disturbance of each increment in motion [1].
    period_s : float
        Sampling time [s].
    """

    pole: float = 0.1
    k_in: float = 0.0091 / 0.9
    k_out: float = (0.0505 - 0.0250 * 0.3) / 0.9
    k_out_slope: float = -0.0250 / 0.9
    v_ref: float = 0.3
    leak: float = 2.7e-5
    lag: int = 2
    sigma: float = 1e-3
    process_noise: float = 2e-4
    period_s: float = 0.03

    @staticmethod
    def from_theta(theta: FloatArray, **others: float) -> Truth:
        """Make the truth from theta_1, theta_2, theta_3, theta_5 of paper 002, eq. (32)."""
        speed = -theta[0]
        v_ref = others.get("v_ref", 0.3)
        return Truth(
            pole=1.0 + theta[0],
            k_in=theta[1] / speed,
            k_out=-(theta[2] + theta[3] * v_ref) / speed,
            k_out_slope=-theta[3] / speed,
            **others,  # type: ignore[arg-type]
        )

    def coefficients(self) -> FloatArray:
        """Return the (16,) coefficients of the predictor that knows the truth."""
        c = np.zeros(COEFFICIENTS)
        speed = 1.0 - self.pole
        c[0] = -speed
        c[1] = speed * self.k_in
        c[2] = -speed * (self.k_out - self.k_out_slope * self.v_ref)
        c[4] = -speed * self.k_out_slope
        c[LEAK] = speed * self.leak
        c[LAG] = self.lag
        c[HIGH_SEAT] = 1.0
        return c


def steady_gains(theta: FloatArray, v_in: float, v_out: float) -> tuple[float, float]:
    """Return (K_in(v_in), K_out(v_out)) [1/sample]; NaN without a speed term.

    K_in = (theta_2 + theta_4 v)/-(theta_1 + theta_7 v), K_out = -(theta_3 + theta_5 v)/-(theta_1 +
    theta_8 v): equations.md 2.1 with all eight terms.

    Parameters
    ----------
    theta : (8,) array
        theta_1 ... theta_8.
    v_in, v_out : float
        Command levels at which the gains hold [1].
    """
    speed_in, speed_out = theta[0] + theta[6] * v_in, theta[0] + theta[7] * v_out
    k_in = (theta[1] + theta[3] * v_in) / -speed_in if speed_in < 0.0 else np.nan
    k_out = (theta[2] + theta[4] * v_out) / speed_out if speed_out < 0.0 else np.nan
    return float(k_in), float(k_out)


def reference_trajectory(samples: int = CYCLE_SAMPLES, period_s: float = 0.03) -> FloatArray:
    """Return the (N,) position reference [1] of the press experiment (equations.md 2.3)."""
    t_s = np.arange(samples) * period_s
    ramp = 0.2 + 0.08 * np.clip((t_s - 2.0) / 5.5, 0.0, 1.0)
    return np.where((t_s < 1.0) | (t_s >= 18.0), 0.0, ramp)


@njit(cache=True)
def _closed_loop(
    c: FloatArray,
    reference: FloatArray,
    noise: FloatArray,
    disturbance: FloatArray,
    position: FloatArray,
    measured: FloatArray,
    inputs: FloatArray,
) -> None:
    """Run the model under its controller.

    Gains 6 in and 3 out, |v| <= 0.8, off inside the dead band at constant reference (equations.md
    2.3 without the integral part).
    """
    lag = int(c[LAG])
    low, high = c[LOW_SEAT], c[HIGH_SEAT]
    x, dx = low, 0.0
    for n in range(len(reference)):
        v_in = inputs[n - lag, 0] if n >= lag else 0.0
        v_out = inputs[n - lag, 1] if n >= lag else 0.0
        ahead = step(c, v_in, v_out, x, dx)
        if v_in > 0.0 or v_out > 0.0:
            ahead = min(max(ahead + disturbance[n], low), high)
        dx = ahead - x
        x = ahead
        position[n] = x
        measured[n] = x + noise[n]
        if n + 1 < len(reference):
            error = reference[n] - measured[n]
            still = n > 0 and reference[n] == reference[n - 1]
            if not (still and abs(error) < 0.01):
                inputs[n + 1, 0] = min(max(6.0 * error, 0.0), 0.8)
                inputs[n + 1, 1] = min(max(-3.0 * error, 0.0), 0.8)


def generate_cycle(
    truth: Truth,
    rng: np.random.Generator,
    *,
    number: int = 1,
    start_ns: int = 0,
    reference: FloatArray | None = None,
) -> Cycle:
    """Generate one cycle.

    Parameters
    ----------
    truth : Truth
        What the cycle obeys.
    rng : numpy.random.Generator
        Source of both noises; the only one.
    number : int
        Cycle number.
    start_ns : int
        Stamp of the first sample [ns].
    reference : (N,) array, optional
        Position reference [1]; that of the press experiment by default.

    Returns
    -------
    Cycle
        N samples; the noise-free position stands in no field of it.
    """
    path = reference_trajectory(period_s=truth.period_s) if reference is None else reference
    n = len(path)
    noise = truth.sigma * rng.standard_normal(n)
    disturbance = truth.process_noise * rng.standard_normal(n)
    position, measured, inputs = np.zeros(n), np.zeros(n), np.zeros((n, 2))
    _closed_loop(truth.coefficients(), path, noise, disturbance, position, measured, inputs)
    stamps = start_ns + np.arange(n, dtype=np.int64) * round(truth.period_s * 1e9)
    nothing = np.full(n, np.nan)
    frames = Frames(stamps, measured, inputs, nothing, path, np.ones(n, dtype=np.bool_))
    return Cycle(number, truth.period_s, frames)
