# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""G_A and G_F of paper 000, eq. (4), from a field with eddy currents.

    i_A = G_A i_s(psi_A, i_B, x)      F = G_F F_s(i_A, i_B, x)
    G(s) = (1 + b1 s + b2 s^2) / ((1 + s/p1) (1 + s/p2)),   G(0) = 1

The gain at rest is 1 because static curves hold at rest; a record of tens of milliseconds cannot
show it, and left free it runs to its bound. For given poles the output is linear in b1 and b2, so
only the two poles are searched for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.prediction import fit_percent
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.types import FloatArray
    from valve_twin.design.field.transient import Transient

_SLOWEST, _FASTEST = 8.0, 3000.0  # of the poles, assumed [Hz]
_STARTS = 3  # places on that range, in pairs
_EVEN = 1e-6  # to which the steps of a record have to be equal [1]


@dataclass(frozen=True, slots=True)
class Dynamics:
    """A transfer function with two real poles and a gain of 1 at rest.

    Attributes
    ----------
    b1, b2, a1, a2 : float
        (1 + b1 s + b2 s^2)/(1 + a1 s + a2 s^2) [s], [s^2].
    poles_hz : tuple of float
        The slower and the faster [Hz].
    fit : float
        100 (1 - |y - y_fit| / |y - mean y|) on the record [%].
    without : float
        The same for G = 1: the static curves alone [%].
    """

    b1: float
    b2: float
    a1: float
    a2: float
    poles_hz: tuple[float, float]
    fit: float
    without: float

    @property
    def fast_gain(self) -> float:
        """Gain at high frequency, b2/a2 [1]: above 1 it differentiates, below it delays."""
        return self.b2 / self.a2


def identify(found: Transient, curves: CoenergyMap) -> tuple[Dynamics, Dynamics]:
    """Return G_A of the first coil and G_F.

    Parameters
    ----------
    found : Transient
        Field with eddy currents; even times.
    curves : CoenergyMap
        Static curves of the same section.

    Raises
    ------
    ValueError
        If the record goes beyond the map or shows nothing.
    """
    static = curves.current(0, found.flux[:, 0], found.currents, found.position)
    force = curves.force(found.currents, found.position)
    return (
        fit_dynamics(found.time_s, static, found.currents[:, 0]),
        fit_dynamics(found.time_s, force, found.force),
    )


def fit_dynamics(time_s: FloatArray, source: FloatArray, answer: FloatArray) -> Dynamics:
    """Fit a transfer function with a gain of 1 at rest between changes of two signals.

    By SciPy: of 84 searches `minimise` ended 1 % or more higher in 12 %, and took twice as long.

    Parameters
    ----------
    time_s : (T,) array
        Even times [s].
    source, answer : (T,) arrays
        At rest in the first row; both in one unit [A] or [N].

    Raises
    ------
    ValueError
        If the times are not even or a signal stands still.
    """
    from scipy.optimize import least_squares

    steps = np.diff(time_s)
    if len(time_s) < 10 or not steps.min() > 0.0 or np.ptp(steps) > _EVEN * steps[0]:
        message = f"time_s: {len(time_s)} times; must be 10 or more with even steps"
        raise ValueError(message)
    u, y = source - source[0], answer - answer[0]
    for name, values in (("source", u), ("answer", y)):
        if not np.ptp(values) > 0.0:
            message = f"{name} stands still: it tells nothing of the dynamics"
            raise ValueError(message)
    low, high = (math.log(2.0 * math.pi * hz) for hz in (_SLOWEST, _FASTEST))

    def missed(log_poles: FloatArray) -> FloatArray:
        difference: FloatArray = _response(log_poles, time_s, u, y)[1] - y
        return difference

    places = np.linspace(low, high, _STARTS + 2)[1:-1]
    tried = [
        least_squares(missed, np.array(start), bounds=(low, high))
        for start in combinations_with_replacement(places, 2)
    ]
    best = min(tried, key=lambda found: float(found.cost))
    (b1, b2), shown = _response(best.x, time_s, u, y)
    slow, fast = sorted(np.exp(best.x).tolist())
    return Dynamics(
        b1=b1,
        b2=b2,
        a1=1.0 / slow + 1.0 / fast,
        a2=1.0 / (slow * fast),
        poles_hz=(slow / (2.0 * math.pi), fast / (2.0 * math.pi)),
        fit=fit_percent(y, shown),
        without=fit_percent(y, u),
    )


def _response(
    log_poles: FloatArray, time_s: FloatArray, u: FloatArray, y: FloatArray
) -> tuple[tuple[float, float], FloatArray]:
    """Return b1 and b2 that fit best with these poles, and the response with them."""
    from scipy.linalg import expm

    p, q = np.exp(log_poles).tolist()
    step = float(time_s[1] - time_s[0])
    # two lags in a row and straight lines between the times, exact: w1, w2, u, its slope
    rate = np.zeros((4, 4))
    rate[0, [0, 2]], rate[1, :2], rate[2, 3] = (-p, p), (q, -q), 1.0 / step
    lags = np.zeros((len(u), 2))
    _follow(expm(step * rate), u, lags)
    first, second = lags.T
    speed = q * (first - second)
    basis = np.column_stack([speed, q * (p * (u - first) - speed)])  # s/D and s^2/D
    scale = np.linalg.norm(basis, axis=0)
    best = np.linalg.lstsq(basis / scale, y - second, rcond=None)[0] / scale
    return (float(best[0]), float(best[1])), second + basis @ best


@njit(cache=True)
def _follow(over: FloatArray, u: FloatArray, lags: FloatArray) -> None:
    """Write what both lags show of a signal; no filter of polynomials, which rounds to 1e-6."""
    for n in range(1, len(u)):
        rise = u[n] - u[n - 1]
        for k in range(2):
            lags[n, k] = (
                over[k, 0] * lags[n - 1, 0]
                + over[k, 1] * lags[n - 1, 1]
                + over[k, 2] * u[n - 1]
                + over[k, 3] * rise
            )
