# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Resistance of a coil from the flux balance of a cycle.

Voltage and current are means over the samples, so paper 000, eq. (1) summed up is exact:

    sum of V T = R sum of i T + psi(t) - psi(0)

with psi by the characteristic curves from current and position. The sums of a cycle are tens of
times the flux, so what eddy currents do to psi hardly shows in R.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics.curves import flux_of
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.physics.curves import Curves
    from valve_twin.core.types import FloatArray

_MISFIT = 0.1  # of the largest flux that the balance may leave [1], assumed
_MIN_CHARGE = 3.0
"""Least resistance times charge over the largest flux that shows a resistance [1], assumed."""


@dataclass(frozen=True, slots=True)
class CoilFit:
    """Resistance [ohm] of one coil; NaN, with a reason, if there is none or it is refused."""

    resistance: float
    reason: str = ""
    refused: bool = False


@njit(cache=True)
def flux_record(
    m: Curves, coil: int, own: FloatArray, other: FloatArray, x: FloatArray, out: FloatArray
) -> None:
    """Write the flux linkage (N,) at N samples, by the curves.

    Parameters
    ----------
    m : MapTables or CoenergyTables
        Curves.
    coil : int
        0 = A, 1 = B.
    own, other : (N,) arrays
        Currents of the coil and of the other one, means over the samples before [A].
    x : (N,) array
        Position, positive towards A [m].
    out : (N,) array
        Overwritten [Wb].
    """
    last = len(own) - 1
    for n in range(len(own)):
        after = min(n + 1, last)
        i, j = 0.5 * (own[n] + own[after]), 0.5 * (other[n] + other[after])
        out[n] = flux_of(m, coil, i, j, x[n])


def fit_resistance(
    voltage: FloatArray, current: FloatArray, flux: FloatArray, period_s: float
) -> CoilFit:
    """Estimate the resistance of a coil.

    Parameters
    ----------
    voltage, current : (N,) arrays
        Means over the samples before their stamps [V], [A].
    flux : (N,) array
        Flux linkage at the stamps, by the curves [Wb].
    period_s : float
        Sampling time [s].
    """
    charge = np.cumsum(current[1:]) * period_s
    applied = np.cumsum(voltage[1:]) * period_s
    change = flux[1:] - flux[0]
    largest = float(np.abs(flux).max())
    if largest == 0.0 or abs(applied[-1]) < _MIN_CHARGE * largest:
        return CoilFit(
            float("nan"),
            f"voltage and time of the cycle make {abs(applied[-1]):.3g} Wb, too little beside "
            f"{largest:.3g} Wb of flux",
        )
    rows = np.column_stack([charge, change, np.ones(len(charge))])
    scale = np.sqrt(np.sum(rows**2, axis=0))
    if not (np.isfinite(scale).all() and np.isfinite(applied).all()):
        return CoilFit(float("nan"), "voltage or current beyond all measure")
    if scale[0] == 0.0:
        return CoilFit(float("nan"), "voltage without current")
    used = scale > 1e-9 * scale[0]
    found = np.linalg.lstsq(rows[:, used] / scale[used], applied, rcond=None)[0] / scale[used]
    left = float(np.sqrt(np.mean((applied - rows[:, used] @ found) ** 2)))
    if not found[0] > 0.0:
        return CoilFit(float("nan"), f"resistance {found[0]:.3g} ohm: check the signs")
    if left > _MISFIT * largest:
        return CoilFit(
            float("nan"),
            f"the flux balance leaves {1e3 * left:.2g} of {1e3 * largest:.2g} mWb: "
            "voltage and current exchanged, or scales or curves wrong",
            refused=True,
        )
    return CoilFit(float(found[0]))
