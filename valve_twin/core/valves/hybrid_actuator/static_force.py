# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Kernel of the solenoid from static force curves: force over gap at several held currents.

Paper 001, section 4.3: all curves are fitted together, the kernel's parameters are shared. Here a
zero error of the load cell may be fitted with them, one for each curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.nonlinear import (
    Curve,
    CurveFit,
    FitParameter,
    Method,
    fit_curves,
)
from valve_twin.core.valves.hybrid_actuator.magnetics import (
    FIT,
    KERNELS,
    LINEAR,
    Magnetics,
    coil_force,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray

_POLE_ROOM = 0.9  # how near to the smallest gap the pole of the reading "fit" may come [1]


@dataclass(frozen=True, slots=True)
class ForceCurve:
    """Forces [N] measured over gaps [m], (N,) each, at one held current [A]."""

    gap: FloatArray
    force: FloatArray
    current: float


@njit(cache=True)
def _forces(m: Magnetics, gap: FloatArray, current: FloatArray, out: FloatArray) -> None:
    for n in range(len(gap)):
        out[n] = coil_force(m, current[n], gap[n])


def forces(m: Magnetics, gap: FloatArray, current: FloatArray) -> FloatArray:
    """Return the forces of the coil (N,) [N].

    Parameters
    ----------
    m : Magnetics
        The solenoid.
    gap, current : (N,) arrays
        Physical gaps [m] and currents [A].
    """
    out = np.empty(len(gap))
    _forces(m, np.ascontiguousarray(gap), np.ascontiguousarray(current, dtype=np.float64), out)
    return out


def fit_static_force(
    curves: Sequence[ForceCurve],
    kernel: str,
    *,
    method: Method = Method.TRUST_REGION,
    force_offsets: bool = False,
) -> CurveFit:
    """Fit a kernel to static force curves.

    Parameters
    ----------
    curves : sequence of ForceCurve
        Two or more currents where the kernel saturates.
    kernel : str
        One of `KERNELS`.
    method : Method
        Levenberg-Marquardt keeps no bounds.
    force_offsets : bool
        Whether each curve has a force offset of its own, `force_offset[k]` [N].

    Returns
    -------
    CurveFit
        Parameters in SI units by the names of the plant: beta and kappa, or saturation_flux, c1,
        c2 and c3.

    Raises
    ------
    ValueError
        If the kernel is unknown or a gap is not positive.
    """
    if kernel not in KERNELS:
        message = f"kernel = {kernel!r}: must be one of {', '.join(KERNELS)}"
        raise ValueError(message)
    smallest = min(float(np.min(c.gap)) for c in curves)
    if smallest <= 0.0:
        message = f"gap = {smallest!r}: must be a number above 0 [m]"
        raise ValueError(message)
    kind = KERNELS.index(kernel)
    parameters = _starts(kind, curves, smallest, bounded=method is Method.TRUST_REGION)
    if force_offsets:
        parameters.append(FitParameter("force_offset", 0.0, local=True))

    def function(x: FloatArray, p: FloatArray) -> FloatArray:
        force = forces(_kernel(kind, p), x[:, 0], x[:, 1])
        return force + p[-1] if force_offsets else force

    measured = [
        Curve(np.column_stack([c.gap, np.full(len(c.gap), c.current)]), c.force) for c in curves
    ]
    return fit_curves(function, measured, parameters, method=method)


def fitted_forces(kernel: str, fit: CurveFit, gap: FloatArray, current: float) -> FloatArray:
    """Return the forces (N,) of a fit without offsets [N].

    Parameters
    ----------
    kernel : str
        One of `KERNELS`.
    fit : CurveFit
        Of `fit_static_force`.
    gap : (N,) array
        Physical gaps [m].
    current : float
        Held current [A].
    """
    m = _kernel(KERNELS.index(kernel), fit.values)
    return forces(m, gap, np.full(len(gap), current))


def _kernel(kind: int, p: FloatArray) -> Magnetics:
    """Return the solenoid of a parameter vector."""
    values = [float(v) for v in p]
    if kind == LINEAR:
        return Magnetics(kind, values[0], values[1], 1.0, 1.0, 0.0, 0.0, 0.0, 1e-3, 0.0)
    flux, c1, c2, c3 = values[:4]
    return Magnetics(kind, 1.0, 0.0, flux, c1, c2, c3, 0.0, 1e-3, 0.0)


def _starts(
    kind: int, curves: Sequence[ForceCurve], smallest: float, *, bounded: bool
) -> list[FitParameter]:
    """Guess the force constant from the law F = beta i^2/g^2 of the weakest curve."""
    weak = min(curves, key=lambda c: abs(c.current))
    beta = float(np.median(weak.force * weak.gap**2)) / max(weak.current**2, 1e-12)
    beta = max(beta, 1e-12)
    none, inf = (0.0, np.inf) if bounded else (-np.inf, np.inf)
    if kind == LINEAR:
        return [
            FitParameter("beta", beta, none, inf),
            FitParameter("kappa", 0.02 * smallest, none, inf),
        ]
    strongest = max(float(np.max(c.force * c.gap)) / max(abs(c.current), 1e-12) for c in curves)
    flux = max(strongest, 1e-6)
    pole = _POLE_ROOM * smallest if kind == FIT and bounded else inf
    return [
        FitParameter("saturation_flux", flux, none, inf),
        FitParameter("c1", beta / flux, none, inf),
        FitParameter("c2", 0.1 * smallest, none, pole),
        FitParameter("c3", 1e-4, none, inf),
    ]
