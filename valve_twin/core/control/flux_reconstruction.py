# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which switched voltage makes a given flux: exhaustive search over 16 patterns a sample.

A field computation gives a smooth flux linkage; the valve's model is fed by a bridge. In every
control sample all 16 patterns are tried (paper 000, fig. 4 b). Taken is the one with the least
square of the error over the interval, as the paper has it ("regarding the current sampling
interval"), or the one that ends nearest to the given flux: then the error at the ends stays
within half a step of the means, U t_s = 0.30 mWb, where the voltage suffices. Where it does not,
the error grows, and the excitation is too steep.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.control.current_loop import PATTERNS, SAMPLE_S, STEP_S, SUB_STEPS, pattern
from valve_twin.core.prediction import fit_percent
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray


CRITERIA = ("end", "interval")
"""What is least: the error at the end of a sample, or its square over the sample."""


@dataclass(frozen=True, slots=True)
class Reconstruction:
    """A switched voltage and the flux linkage that it makes.

    Attributes
    ----------
    patterns : (N,) int64 array
        Pattern of each control sample, see `current_loop.pattern`.
    flux : (8 N + 1,) array
        Flux linkage at every sub-step [Wb].
    error : (N,) array
        Reconstructed minus given flux at the end of each control sample [Wb].
    largest : float
        Largest of it at any sub-step, the given flux on straight lines in between [Wb].
    fit : float
        Share of the given flux' scatter that is met: 100 (1 - |error|/|flux - mean|) [%].
    """

    patterns: IntArray
    flux: FloatArray
    error: FloatArray
    largest: float
    fit: float


@njit(cache=True)
def _search(
    wanted: FloatArray,
    drop: FloatArray,
    supply: float,
    over_interval: bool,
    patterns: IntArray,
    flux: FloatArray,
) -> None:
    """Take the best of 16 patterns, sample by sample."""
    flux[0] = wanted[0]
    for n in range(len(patterns)):
        begin = SUB_STEPS * n
        lowest, best = np.inf, 0
        second = np.inf
        for index in range(PATTERNS):
            start, before = pattern(index)
            psi = flux[begin]
            way = 0.0
            for k in range(SUB_STEPS):
                level = start if k < before else -start
                psi += STEP_S * (level * supply - drop[begin + k])
                straight = wanted[n] + (k + 1) / SUB_STEPS * (wanted[n + 1] - wanted[n])
                way += (psi - straight) ** 2
            off = way if over_interval else (psi - wanted[n + 1]) ** 2
            if off < lowest - 1e-18 or (off < lowest + 1e-18 and way < second):
                lowest, second, best = min(off, lowest), way, index
        patterns[n] = best
        start, before = pattern(best)
        for k in range(SUB_STEPS):
            level = start if k < before else -start
            step = STEP_S * (level * supply - drop[begin + k])
            flux[begin + k + 1] = flux[begin + k] + step


def reconstruct_flux(
    wanted: FloatArray,
    current: FloatArray,
    resistance: float,
    supply: float,
    criterion: str = CRITERIA[0],
) -> Reconstruction:
    """Return the switched voltage that follows a flux linkage.

    Parameters
    ----------
    wanted : (N + 1,) array
        Flux linkage at the ends of the control samples, every 0.1 ms [Wb].
    current : (8 N,) array
        Current at every sub-step [A].
    resistance, supply : float
        Of the coil [ohm], of the bridge [V].
    criterion : str
        One of `CRITERIA`.

    Raises
    ------
    ValueError
        If lengths do not fit, a value is not finite or there is no such criterion.
    """
    if criterion not in CRITERIA:
        message = f"criterion = '{criterion}': must be one of {', '.join(CRITERIA)}"
        raise ValueError(message)
    count = len(wanted) - 1
    if count < 1 or len(current) != SUB_STEPS * count:
        message = f"{len(wanted)} fluxes need {SUB_STEPS * count} currents, got {len(current)}"
        raise ValueError(message)
    for name, values in (("flux", wanted), ("current", current)):
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            message = f"{name}[{bad[0]}] = {values[bad[0]]}: must be a finite number"
            raise ValueError(message)
    patterns = np.zeros(count, dtype=np.int64)
    flux = np.empty(SUB_STEPS * count + 1)
    drop = resistance * np.ascontiguousarray(current, dtype=np.float64)
    given = np.ascontiguousarray(wanted, dtype=np.float64)
    _search(given, drop, supply, criterion == "interval", patterns, flux)
    straight = np.interp(np.arange(len(flux)) / SUB_STEPS, np.arange(len(given)), given)
    reached = flux[SUB_STEPS::SUB_STEPS]
    error = reached - wanted[1:]
    fit = fit_percent(wanted[1:], reached) if np.ptp(wanted[1:]) > 0.0 else 100.0
    largest = float(np.abs(flux - straight).max())
    return Reconstruction(patterns, flux, error, largest, fit)


def error_bound(supply: float) -> float:
    """Return the largest error where the voltage suffices: U t_s [Wb]; equations.md 5.3."""
    return supply * STEP_S


def reachable(
    wanted: FloatArray, current: FloatArray, resistance: float, supply: float
) -> np.typing.NDArray[np.bool_]:
    """Return where the mean voltage that the flux needs lies inside the supply, (N,).

    Parameters
    ----------
    wanted, current, resistance, supply : (N + 1,) array, (8 N,) array, float, float
        As in `reconstruct_flux`.
    """
    mean = current.reshape(-1, SUB_STEPS).mean(axis=1)
    needed: FloatArray = np.diff(wanted) / SAMPLE_S + resistance * mean
    inside: np.typing.NDArray[np.bool_] = np.abs(needed) <= supply
    return inside
