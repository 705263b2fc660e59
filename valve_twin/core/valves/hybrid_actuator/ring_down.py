# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Free oscillation of the armature: damping ratio, natural frequency, mass and damping.

Paper 001, eq. (3.12): x = A exp(-xi w_n t) sin(w_d t - theta). The printed c = xi sqrt(m k) of
eq. (3.13) lacks a factor 2; both readings are returned.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.nonlinear import Curve, CurveFit, FitParameter, fit_curves

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_FEWEST_PER_PERIOD = 6.0  # samples of an oscillation that is not aliased, assumed


@dataclass(frozen=True, slots=True)
class RingDown:
    """What a free oscillation shows.

    Attributes
    ----------
    damping_ratio, natural_frequency : float
        xi [1] and w_n [rad/s].
    mass, damping : float
        k/w_n^2 [kg] and 2 xi sqrt(m k) [N s/m].
    printed_damping : float
        xi sqrt(m k), as eq. (3.13) is printed [N s/m].
    fit : CurveFit
        Amplitudes of cosine and sine, offset, decay rate and w_d with their errors.
    """

    damping_ratio: float
    natural_frequency: float
    mass: float
    damping: float
    printed_damping: float
    fit: CurveFit


def fit_ring_down(time_s: FloatArray, position: FloatArray, spring_rate: float) -> RingDown:
    """Fit a decaying oscillation to a position record.

    Parameters
    ----------
    time_s : (N,) array
        Increasing times [s].
    position : (N,) array
        Position [any unit]; its neutral position is fitted.
    spring_rate : float
        Known spring rate [N/m]: mass and damping follow from it.

    Returns
    -------
    RingDown
        See `RingDown.fit.status` for whether it may be used.

    Raises
    ------
    ValueError
        If the record holds less than one oscillation or is sampled too slowly for it.
    """
    if not (np.isfinite(spring_rate) and spring_rate > 0.0):
        message = f"spring_rate = {spring_rate!r}: must be a number above 0 [N/m]"
        raise ValueError(message)
    since = time_s - time_s[0]
    omega = _frequency(since, position)
    rate = 0.03 * omega
    columns = _basis(since, rate, omega)
    start = np.linalg.lstsq(columns, position, rcond=None)[0]
    parameters = [
        FitParameter("cosine", float(start[0])),
        FitParameter("sine", float(start[1])),
        FitParameter("offset", float(start[2])),
        FitParameter("decay", rate, 0.0, omega),
        FitParameter("frequency", omega, 0.25 * omega, 4.0 * omega),
    ]
    fit = fit_curves(oscillation, [Curve(since, position)], parameters)
    decay, damped = fit.value("decay"), fit.value("frequency")
    natural = float(np.hypot(decay, damped))
    mass = spring_rate / natural**2
    printed = decay / natural * float(np.sqrt(mass * spring_rate))
    return RingDown(decay / natural, natural, mass, 2.0 * printed, printed, fit)


def oscillation(t: FloatArray, p: FloatArray) -> FloatArray:
    """Return the fitted oscillation (N,) at times (N,) [s]; `p` (5,) as in `RingDown.fit`."""
    shown: FloatArray = _basis(t, float(p[3]), float(p[4])) @ p[:3]
    return shown


def _basis(t: FloatArray, decay: float, omega: float) -> FloatArray:
    envelope = np.exp(-decay * t)
    return np.column_stack([envelope * np.cos(omega * t), envelope * np.sin(omega * t), t * 0 + 1])


def _frequency(t: FloatArray, position: FloatArray) -> float:
    """Guess the angular frequency from the crossings of the median, noise left out."""
    off = position - np.median(position)
    level = 0.1 * float(np.max(np.abs(off)))
    side = np.where(off > level, 1, np.where(off < -level, -1, 0))
    clear = np.flatnonzero(side)
    turns = clear[1:][side[clear[1:]] != side[clear[:-1]]]
    if len(turns) < 2:
        message = "the record holds less than one oscillation"
        raise ValueError(message)
    half = float(t[turns[-1]] - t[turns[0]]) / (len(turns) - 1)
    step = float(np.median(np.diff(t)))
    if 2.0 * half < _FEWEST_PER_PERIOD * step:
        message = (
            f"sampled every {step:g} s: an oscillation of {2.0 * half:g} s needs "
            f"{2.0 * half / _FEWEST_PER_PERIOD:g} s or faster"
        )
        raise ValueError(message)
    return float(np.pi / half)
