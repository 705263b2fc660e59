# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Branches of eddy currents whose gains grow with the current, from steps in the moving field.

    i = i_m + e_1 + e_2      i_m = i_s(psi, i_other, x)      t_j e_j' = k_j psi' - e_j
    k_j = gain_j (1 + growth i_m)      F = F_s(i_mA, i_mB, x)

The next order after `eddies`: two branches of constant gain fit small steps or large ones, not
both, since little flux in the steel asks for less eddy current than much. Currents and motion of
a record are given, flux linkages and force follow; what is fitted is the force. Which steps are
fitted says `FITTED`; every other one is left to judge by.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import minimise_residuals
from valve_twin.core.physics.coenergy_tables import make_tables
from valve_twin.core.physics.curves import linked_flux, locate, static_currents, static_force
from valve_twin.core.prediction import fit_percent
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.physics.curves import Curves
    from valve_twin.core.types import FloatArray
    from valve_twin.design.field import Transient

FITTED = ((0.0, 0.25), (0.0, 1.0), (0.5, -0.5))
"""Start and end of the steps that the branches are fitted to, over the way to an open port [1]."""

_START = (4e-3, 4.5e-4, 1e-2, 1e-2, 1.5)  # gain, time, gain, time [A/V], [s]; growth [1]
_LOW = (1e-5, 1e-4, 1e-5, 1e-4, 5e-3)
_HIGH = (10.0, 3e-2, 10.0, 3e-2, 5.0)
"""Growth within the largest current at rest: above, gains and growth say the same; assumed."""
_DIFFERENCE = 1e-4  # of the logarithms [1]
_ITERATIONS = 100
_NUDGE = 1e-6  # of a flux linkage, for the slope of a curve [Wb]
_PASSES, _CLOSE = 50, 1e-9  # at most over both coils; what they leave of a current [A]


@dataclass(frozen=True, slots=True)
class Growing:
    """Two branches whose gains grow.

    Attributes
    ----------
    gains, times : tuple of float
        Of the faster and the slower one, without a current [A/V], [s].
    growth : float
        Of both gains with the current that magnetises [1/A].
    force, without : float
        100 (1 - |F - shown| / |F - mean|) of the force, with them and by the static curves alone;
        the worse of the records [%].
    """

    gains: tuple[float, float]
    times: tuple[float, float]
    growth: float
    force: float
    without: float

    def numbers(self) -> tuple[float, ...]:
        """Return gain and time of the faster, then of the slower one, and the growth [SI]."""
        return self.gains[0], self.times[0], self.gains[1], self.times[1], self.growth


def fit_growing(records: Sequence[Transient], curves: CoenergyMap) -> Growing:
    """Fit two branches, alike for both coils, to the forces of records of the moving field.

    Parameters
    ----------
    records : sequence of Transient
        Of two coils, from rest, even times each.
    curves : CoenergyMap
        Static curves of the same section.

    Raises
    ------
    ValueError
        If the static curves show the force as well without any.
    """
    tables = make_tables(curves)
    scale = np.array([1.0] * 4 + [1.0 / max(float(of.currents[0].max()) for of in records)])
    weights = [1.0 / float(np.linalg.norm(of.force - of.force.mean())) for of in records]

    def missed(logarithms: FloatArray) -> FloatArray:
        numbers = tuple((scale * np.exp(logarithms)).tolist())
        return np.concatenate(
            [
                weight * (_force(numbers, tables, of) - of.force)
                for weight, of in zip(weights, records, strict=True)
            ]
        )

    best = minimise_residuals(
        missed,
        np.log(_START),
        (np.log(_LOW), np.log(_HIGH)),
        steps=np.full(len(_START), _DIFFERENCE),
        iterations=_ITERATIONS,
    )
    g1, t1, g2, t2, growth = (scale * np.exp(best.parameters)).tolist()
    (t1, g1), (t2, g2) = sorted([(t1, g1), (t2, g2)])
    numbers = (g1, t1, g2, t2, growth)
    none = (0.0, t1, 0.0, t2, 0.0)
    force, without = (
        min(fit_percent(of.force, _force(n, tables, of)) for of in records)
        for n in (numbers, none)
    )
    if not force > without:
        message = (
            f"eddy currents: the force of the steps fits {force:.1f} % with them, {without:.1f} % "
            "without; see steel.conductivity"
        )
        raise ValueError(message)
    return Growing((g1, g2), (t1, t2), growth, force, without)


def force_with(numbers: tuple[float, ...], curves: CoenergyMap, of: Transient) -> FloatArray:
    """Return the force (T,) that the branches make of a record's currents and motion [N].

    Parameters
    ----------
    numbers : tuple of float
        As of `Growing.numbers`; without the fifth the gains do not grow.
    curves : CoenergyMap
        Static curves of two coils.
    of : Transient
        The record.
    """
    return _force((*numbers, 0.0)[:5], make_tables(curves), of)


def _force(numbers: tuple[float, ...], tables: Curves, of: Transient) -> FloatArray:
    out = np.empty(len(of.time_s))
    step = float(of.time_s[1] - of.time_s[0])
    _follow(np.array(numbers), tables, of.currents, of.position, step, out)
    return out


@njit(cache=True)
def _follow(
    numbers: FloatArray, m: Curves, currents: FloatArray, x: FloatArray, step: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write the force; straight flux linkages between the times are exact."""
    left = (math.exp(-step / numbers[1]), math.exp(-step / numbers[3]))
    share = (numbers[0] * (1.0 - left[0]) / step, numbers[2] * (1.0 - left[1]) / step)
    growth, both = numbers[4], share[0] + share[1]
    i_a, i_b = currents[0, 0], currents[0, 1]
    psi_a, psi_b = linked_flux(m, 0, i_a, i_b, x[0]), linked_flux(m, 1, i_b, i_a, x[0])
    fast_a, slow_a, fast_b, slow_b = 0.0, 0.0, 0.0, 0.0
    out[0] = static_force(m, i_a, i_b, locate(m, x[0]))
    for n in range(1, len(out)):
        place = locate(m, x[n])
        before_a, before_b, old_a, old_b = psi_a, psi_b, i_a, i_b
        rest_a = currents[n, 0] - left[0] * fast_a - left[1] * slow_a
        rest_b = currents[n, 1] - left[0] * fast_b - left[1] * slow_b
        grown_a, grown_b = 1.0, 1.0
        for _ in range(_PASSES):
            last, nudged = (i_a, i_b), (psi_a + _NUDGE, psi_b + _NUDGE)
            i_a, i_b = static_currents(m, (psi_a, psi_b), last, place)
            beside = static_currents(m, nudged, last, place)
            grown_a = 1.0 + growth * max(0.5 * (i_a + old_a), 0.0)
            grown_b = 1.0 + growth * max(0.5 * (i_b + old_b), 0.0)
            off_a = rest_a - i_a - both * grown_a * (psi_a - before_a)
            off_b = rest_b - i_b - both * grown_b * (psi_b - before_b)
            psi_a += off_a / ((beside[0] - i_a) / _NUDGE + both * grown_a)
            psi_b += off_b / ((beside[1] - i_b) / _NUDGE + both * grown_b)
            if max(abs(off_a), abs(off_b)) < _CLOSE:
                break
        rise_a, rise_b = grown_a * (psi_a - before_a), grown_b * (psi_b - before_b)
        fast_a, slow_a = left[0] * fast_a + share[0] * rise_a, left[1] * slow_a + share[1] * rise_a
        fast_b, slow_b = left[0] * fast_b + share[0] * rise_b, left[1] * slow_b + share[1] * rise_b
        out[n] = static_force(m, i_a, i_b, place)
