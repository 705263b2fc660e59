# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The reference experiment of paper 002, simulated with a measurement layer and fitted.

105 cycles (429 to 533) of an aging valve, random refresh phase and noise in each; no cycle and no
configuration is picked. Every fit takes lag 2 and all samples, as the paper does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.simulation import (
    AgingRule,
    SimulatedValve,
    configure,
    simulate_cycles,
    to_frames,
)
from valve_twin.core.types import Cycle
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.press_cartridge.estimation.constraints import physical_inequalities
from valve_twin.core.valves.press_cartridge.estimation.qp import solve_qp
from valve_twin.core.valves.press_cartridge.estimation.regression import TERMS, design, gram
from valve_twin.core.valves.press_cartridge.estimators import TERM_SETS
from valve_twin.core.valves.registry import complete_options

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.simulation import SimulationConfig
    from valve_twin.core.types import FloatArray, Frames

FIRST_CYCLE = 429
"""First cycle of paper 002, Fig. 5."""

AREA_LOSS = 0.15
"""Loss of filling pilot area from the first to the last cycle (equations.md 2.5) [1]."""

LAG = 2
"""Lag of the paper's regressor, eq. (19) [samples]."""

LINE_BAND = 0.0235
"""Width of the band about a period of three samples: 4.7 % of all frequencies [1/sample]."""

FREQUENCIES = 64
"""Bands of the mean spectrum of the residuals."""

ESTIMATORS = {"LS3": TERM_SETS["3"], "LS5": TERM_SETS["5"], "QP4": TERM_SETS["4"]}
"""Estimators of Table 1 and their terms."""


@dataclass(frozen=True, slots=True)
class Layer:
    """What the sensor makes of the position: name, delay and refresh [samples], noise [1]."""

    name: str
    delay: int
    refresh: int
    noise: float


@dataclass(frozen=True, slots=True)
class LayerFits:
    """Fits of all cycles of one layer.

    Attributes
    ----------
    layer : Layer
        The layer.
    cycles : (C,) array
        Cycle numbers.
    theta : dict of (C, 8) arrays
        theta_1 ... theta_8 by estimator, 0 where a term is not fitted.
    mse, mse_test : dict of (C,) arrays
        Mean squared one-step error on the cycle itself, and of the theta of the cycle before;
        the first of the latter is NaN [1].
    line : (C,) array
        Share of the power of QP4's residual about a period of three samples [1].
    spectrum : (FREQUENCIES,) array
        Mean power spectrum of QP4's residual over the cycles, shares of the power; from 0 to half
        the sampling frequency [1].
    condition_growth : (C,) array
        Condition number of the normal equations of 5 terms over that of 3 [1].
    k_in : float
        True steady filling gain in the middle of the aging, at the command where a least-squares
        gain without a saturation term holds: the mean weighted with v_in^2 [1/sample].
    """

    layer: Layer
    cycles: FloatArray
    theta: dict[str, FloatArray]
    mse: dict[str, FloatArray]
    mse_test: dict[str, FloatArray]
    line: FloatArray
    spectrum: FloatArray
    condition_growth: FloatArray
    k_in: float

    def mean(self, estimator: str, term: int) -> float:
        """Return the mean of a term over the cycles [1]."""
        return float(self.theta[estimator][:, term - 1].mean())

    def scatter(self, estimator: str, term: int) -> float:
        """Return the standard deviation of a term from cycle to cycle [1]."""
        return float(self.theta[estimator][:, term - 1].std(ddof=1))


def experiment(layer: Layer, cycles: int) -> SimulationConfig:
    """Return the simulation of the aging experiment under a layer."""
    rule = AgingRule("area_in", "linear", -AREA_LOSS / max(cycles - 1, 1), FIRST_CYCLE + 1)
    base = replace(MODEL.simulation(), first_cycle=FIRST_CYCLE, aging=(rule,))
    settings = {"delay": layer.delay, "noise": layer.noise, "refresh": layer.refresh}
    return configure(base, {"measurement": settings})


def fit_layer(layer: Layer, cycles: int, seed: int, advance: Callable[[], None]) -> LayerFits:
    """Simulate `cycles` cycles (at least 2) under a layer and fit each with every estimator.

    Parameters
    ----------
    layer : Layer
        How the position is measured.
    cycles : int
        Cycles, at least 2 [1].
    seed : int
        Of phases and noise.
    advance : callable
        Called after each cycle.
    """
    config = experiment(layer, cycles)
    theta = {name: np.zeros((cycles, TERMS)) for name in ESTIMATORS}
    mse = {name: np.empty(cycles) for name in ESTIMATORS}
    test = {name: np.full(cycles, np.nan) for name in ESTIMATORS}
    line, growth, spectra = np.empty(cycles), np.empty(cycles), np.zeros(FREQUENCIES)
    for c, block in enumerate(simulate_cycles(config, cycles, seed)):
        frames = to_frames(block)
        rows = np.arange(LAG, len(frames))
        u, y = design(frames, rows, LAG)
        for name, terms in ESTIMATORS.items():
            theta[name][c] = _fit(name, frames, u, y, terms)
            mse[name][c] = np.mean((y - u @ theta[name][c]) ** 2)
            if c > 0:
                test[name][c] = np.mean((y - u @ theta[name][c - 1]) ** 2)
        line[c] = line_share(y - u @ theta["QP4"][c])
        spectra += power_spectrum(y - u @ theta["QP4"][c]) / cycles
        three, five = (u[:, np.asarray(ESTIMATORS[k]) - 1] for k in ("LS3", "LS5"))
        growth[c] = np.linalg.cond(five.T @ five) / np.linalg.cond(three.T @ three)
        advance()
    numbers = FIRST_CYCLE + np.arange(cycles, dtype=np.float64)
    command = block.inputs[:, 0]
    weighted = float(np.sum(command**3) / np.sum(command**2))
    truth = SimulatedValve(config).steady_gain(FIRST_CYCLE + cycles // 2, weighted)
    return LayerFits(layer, numbers, theta, mse, test, line, spectra, growth, truth)


def _fit(
    name: str, frames: Frames, u: FloatArray, y: FloatArray, terms: tuple[int, ...]
) -> FloatArray:
    """Return theta_1 ... theta_8 of least squares, or of the paper's QP, eqs. (22)-(23)."""
    columns = np.asarray(terms) - 1
    theta = np.zeros(TERMS)
    if name.startswith("LS"):
        theta[columns] = np.linalg.lstsq(u[:, columns], y, rcond=None)[0]
    else:
        limits = physical_inequalities(extended=False).part(columns.tolist())
        normal = gram(frames, np.arange(LAG, len(frames)), LAG).part(terms)
        theta[columns] = solve_qp(normal, limits).theta
    return theta


def line_share(residual: FloatArray) -> float:
    """Return the share of the power of a residual (N,) about a period of three samples [1]."""
    power = np.abs(np.fft.rfft(residual - residual.mean())) ** 2
    near = np.abs(np.fft.rfftfreq(len(residual)) - 1.0 / 3.0) <= 0.5 * LINE_BAND
    return float(power[near].sum() / power.sum())


def power_spectrum(residual: FloatArray) -> FloatArray:
    """Return the shares of the power of a residual (N,) in equal bands, (FREQUENCIES,) [1]."""
    power = np.abs(np.fft.rfft(residual - residual.mean())) ** 2
    band = np.minimum((2.0 * FREQUENCIES * np.fft.rfftfreq(len(residual))).astype(int),
                      FREQUENCIES - 1)  # fmt: skip
    shares: FloatArray = np.bincount(band, power, FREQUENCIES) / power.sum()
    return shares


def strongest(spectrum: FloatArray) -> float:
    """Return the frequency of the strongest band of a power spectrum [1/sample]."""
    return (float(np.argmax(spectrum)) + 0.5) / (2.0 * len(spectrum))


def outflow_gain(
    layer: Layer, cycles: int, seed: int, advance: Callable[[], None], *, v_ref: float = 0.3
) -> tuple[float, float]:
    """Return (mean estimate, truth) of the emptying gain at `v_ref` [1/sample].

    Kalman-whitened estimates at the right lag, delay + 1, of a valve that does not age.

    Parameters
    ----------
    layer : Layer
        How the position is measured.
    cycles : int
        Cycles [1].
    seed : int
        Of phases and noise.
    advance : callable
        Called after each cycle.
    v_ref : float
        Command at which the gain holds [1].
    """
    config = replace(experiment(layer, cycles), aging=())
    options = complete_options(
        MODEL,
        {"estimators": ["kalman"], "output_error": False, "lag": layer.delay + 1, "v_ref": v_ref},
    )
    found = []
    for number, block in enumerate(simulate_cycles(config, cycles, seed)):
        estimates = MODEL.estimate(Cycle(number, config.period_s, to_frames(block)), options)
        found.append(estimates[0].value("K_out"))
        advance()
    truth = SimulatedValve(config).steady_gain(FIRST_CYCLE, v_ref, input_index=1)
    return float(np.mean(found)), truth
