# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Eddy currents of both coils in two branches, from two trapezoids: what G_A and G_F lack.

    i = i_m + e_1 + e_2      i_m = i_s(psi, i_other, x)      t_j e_j' = k_j psi' - e_j
    F = F_s(i_mA, i_mB, x)

The computed force is that of the static curves at the currents that belong to the flux linkages;
what comes late is the flux. Eddy currents are driven by the voltage d psi/dt, so gains and times
stay nearly the same at other currents and gaps, where those of G_A and G_F, which act on a current
and a force, do not. For given times the eddy currents are linear in the gains: only the two times
are searched for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import minimise_residuals
from valve_twin.core.prediction import fit_percent
from valve_twin.design.field import Trapezoid, run_transient

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.types import FloatArray
    from valve_twin.design.field import FieldModel, Transient

_SHORTEST, _LONGEST = 1e-4, 3e-2  # of the times, assumed [s]
_STARTS = (4e-4, 5e-3)
_DIFFERENCE = 1e-6  # of the logarithms of the times [1]
_ITERATIONS = 100
_SLOPE = 1e-3  # of the flanks: the voltage plays no part here, assumed [s/A]
_AROUND = ((1.0, False), (0.5, True))  # bias and swing [A], whether the second coil goes against
_PASSES = 4  # over the mutual dependence of both currents, which is weak


@dataclass(frozen=True, slots=True)
class Branches:
    """Two branches of eddy currents.

    Attributes
    ----------
    gains, times : tuple of float
        Of the faster and the slower one [A/V], [s].
    fit, without : float
        100 (1 - |i - shown| / |i - mean|) of the first coil's current, with them and by the
        static curves alone; the worse of the records [%].
    force : float
        The same of the force by the static curves at the currents that magnetise [%].
    """

    gains: tuple[float, float]
    times: tuple[float, float]
    fit: float
    without: float
    force: float

    def numbers(self) -> tuple[float, float, float, float]:
        """Return gain and time of the faster, then of the slower branch [A/V], [s]."""
        return self.gains[0], self.times[0], self.gains[1], self.times[1]


def branch_records(model: FieldModel, step: float) -> tuple[Transient, ...]:
    """Return the fields under both trapezoids that the branches are fitted to.

    Parameters
    ----------
    model : FieldModel
        The section's field problem, two coils.
    step : float
        Of the computation [s].
    """
    found = []
    for bias, against in _AROUND:
        time_s, currents = Trapezoid(bias=bias, swing=bias, slope=_SLOPE, step=step).record(2)
        if against:
            currents[:, 1] = 2.0 * bias - currents[:, 0]
        found.append(run_transient(model, time_s, currents))
    return tuple(found)


def fit_branches(records: Sequence[Transient], curves: CoenergyMap) -> Branches:
    """Fit two branches, alike for both coils, to records of the field.

    Parameters
    ----------
    records : sequence of Transient
        From rest, even times each.
    curves : CoenergyMap
        Static curves of the same section.

    Raises
    ------
    ValueError
        If a record goes beyond the map, or its eddy currents are none.
    """
    rest = [magnetising(curves, of.flux, of.currents, of.position) for of in records]
    eddy = [of.currents - i - (of.currents[0] - i[0]) for of, i in zip(records, rest, strict=True)]
    wanted = np.concatenate([e.T.ravel() for e in eddy])

    def missed(log_times: FloatArray) -> FloatArray:
        basis = _basis(records, np.exp(log_times))
        difference: FloatArray = basis @ _gains(basis, wanted) - wanted
        return difference

    start, (low, high) = np.log(_STARTS), np.log([_SHORTEST, _LONGEST])
    best = minimise_residuals(
        missed,
        start,
        (np.full_like(start, low), np.full_like(start, high)),
        steps=np.full_like(start, _DIFFERENCE),
        iterations=_ITERATIONS,
    )
    times = np.sort(np.exp(best.parameters))
    basis = _basis(records, times)
    gains = _gains(basis, wanted)
    if not gains.min() > 0.0:
        message = (
            f"eddy currents: gains {gains[0]:g} and {gains[1]:g} A/V of {1e3 * times[0]:.3g} and "
            f"{1e3 * times[1]:.3g} ms; must be above 0: see steel.conductivity"
        )
        raise ValueError(message)
    shown = np.split(basis @ gains, np.cumsum([e.size for e in eddy])[:-1])
    fits, static, force = [], [], []
    for of, i, part in zip(records, rest, shown, strict=True):
        own = of.currents[:, 0]
        fits.append(fit_percent(own, i[:, 0] + part[: len(own)]))
        static.append(fit_percent(own, i[:, 0]))
        force.append(fit_percent(of.force, curves.force(i, of.position)))
    return Branches(
        (float(gains[0]), float(gains[1])),
        (float(times[0]), float(times[1])),
        min(fits),
        min(static),
        min(force),
    )


def magnetising(
    curves: CoenergyMap, flux: FloatArray, near: FloatArray, position: FloatArray
) -> FloatArray:
    """Return the currents (T, 2) that belong to flux linkages without eddy currents [A].

    Parameters
    ----------
    curves : CoenergyMap
        Static curves of two coils.
    flux, near : (T, 2) arrays
        Flux linkages [Wb], currents to begin with [A].
    position : (T,) array
        Of the armature [m].

    Raises
    ------
    ValueError
        If a flux linkage lies beyond the map.
    """
    found: FloatArray = np.clip(near, curves.currents[0], curves.currents[-1])
    for _ in range(_PASSES):
        each = [curves.current(k, flux[:, k], found, position) for k in range(2)]
        found = np.array(each, dtype=np.float64).T
    return found


def _gains(basis: FloatArray, wanted: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(basis, wanted, rcond=None)[0], dtype=np.float64)


def _basis(records: Sequence[Transient], times: FloatArray) -> FloatArray:
    """Return what a gain of 1 makes of the flux linkages, (all values, branches) [Wb/s]."""
    from scipy.signal import lfilter

    columns = []
    for time in times:
        parts: list[FloatArray] = []
        for of in records:
            step = float(of.time_s[1] - of.time_s[0])
            left = math.exp(-step / time)
            slopes = np.diff(of.flux, axis=0) / step  # straight lines between the times are exact
            late = lfilter([1.0 - left], [1.0, -left], slopes, axis=0)
            parts += [np.concatenate([[0.0], column]) for column in late.T]
        columns.append(np.concatenate(parts))
    return np.column_stack(columns)
