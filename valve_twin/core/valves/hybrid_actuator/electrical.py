# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Resistance and inductance of a coil from its current transients.

The flux balance of a pulse, from its first sample on, is linear in what is sought:

    integral of V = R integral of i + s (change of the coil's flux) + q (change of the magnet's)

with the fluxes of the data sheet's kernel at measured current and gap. No derivative is taken,
and the motion of the armature during the pulse is in the fluxes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.hybrid_actuator.magnetics import flux_linkage, magnet_flux
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray
    from valve_twin.core.valves.hybrid_actuator.magnetics import Magnetics

_FEWEST = 12  # fewest samples with current, assumed
_ROUNDINGS = 10  # of the currents, drawn to see what their steps do
_SEED = 1  # of these draws
_NO_STEP = 1e-9  # a smaller change of a current is none [A]
_LONGEST_S = 0.03  # longest transient that is used [s]
_MIN_EXCITATION = 0.02  # of the resistance's column that the others leave [1], assumed
_NOT_APART = "voltage and flux do not tell the resistance apart"


@dataclass(frozen=True, slots=True)
class CoilFit:
    """Resistance [ohm] and inductance at the seat [H] of one coil; NaN, with a reason, if not.

    `rounding` holds their standard errors from the steps of the current sensor, alike in every
    cycle: the same pulse is rounded the same way [ohm], [H].
    """

    resistance: float
    inductance: float
    reason: str = ""
    rounding: tuple[float, float] = (0.0, 0.0)


def pulses(voltage: FloatArray, current: FloatArray, rest: float, period_s: float) -> list[slice]:
    """Return the transients: from the first voltage to the sample where the current has died.

    Parameters
    ----------
    voltage, current : (N,) arrays
        Voltage [V] and current [A].
    rest : float
        Current that counts as none [A].
    period_s : float
        Sampling time [s].
    """
    active = (np.abs(voltage) > 0.0) | (np.abs(current) > rest)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], active, [False])).astype(np.int8)))
    longest = round(_LONGEST_S / period_s)
    return [
        slice(int(a), int(min(b, a + longest)))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
        if np.abs(voltage[a]) > 0.0 and b - a >= 4
    ]


def integrate(values: FloatArray, switches: BoolArray, period_s: float) -> FloatArray:
    """Return the running integral (N,) of samples, of third order between switching instants.

    Parameters
    ----------
    values : (N,) array
        Samples of a curve with kinks at the switching instants only [unit of the curve].
    switches : (N,) bool array
        Samples at which the curve has a kink.
    period_s : float
        Sampling time [s].
    """
    n = len(values)
    share = np.zeros(n)
    kinks = np.flatnonzero(switches[1:-1]) + 1 if n > 2 else np.zeros(0, dtype=np.int64)
    edges = [0, *(int(k) for k in kinks), n - 1]
    for a, b in pairwise(edges):
        y = values[a : b + 1]
        if len(y) < 4:
            share[a + 1 : b + 1] = 0.5 * (y[1:] + y[:-1])
            if len(y) == 3:
                share[a + 1] = (5.0 * y[0] + 8.0 * y[1] - y[2]) / 12.0
                share[a + 2] = (-y[0] + 8.0 * y[1] + 5.0 * y[2]) / 12.0
            continue
        share[a + 2 : b] = (13.0 * (y[1:-2] + y[2:-1]) - y[:-3] - y[3:]) / 24.0
        share[a + 1] = (9.0 * y[0] + 19.0 * y[1] - 5.0 * y[2] + y[3]) / 24.0
        share[b] = (9.0 * y[-1] + 19.0 * y[-2] - 5.0 * y[-3] + y[-4]) / 24.0
    return np.cumsum(share) * period_s


@njit(cache=True)
def _fluxes(m: Magnetics, current: FloatArray, gap: FloatArray, out: FloatArray) -> None:
    for n in range(len(current)):
        own = magnet_flux(m, gap[n])
        out[n, 0] = flux_linkage(m, current[n], gap[n]) - own
        out[n, 1] = own


def fit_coil(
    voltage: FloatArray,
    current: FloatArray,
    gap: FloatArray,
    known: BoolArray,
    solenoid: Magnetics,
    *,
    period_s: float,
    rest: float,
    seat_gap: float,
    rounded: bool = True,
) -> CoilFit:
    """Estimate resistance and inductance of a coil from all transients of a record.

    Parameters
    ----------
    voltage : (N,) array
        Voltage, held from each sample to the next [V].
    current, gap : (N,) arrays
        Current [A] and gap [m] at the samples.
    known : (N,) bool array
        Samples that can be used; a transient with others is left out.
    solenoid : Magnetics
        Kernel of the data sheet.
    period_s, rest, seat_gap : float
        Sampling time [s], current that counts as none [A], gap at the seat [m].
    rounded : bool
        Whether to find what the steps of the current sensor do.
    """
    parts = [p for p in pulses(voltage, current, rest, period_s) if known[p].all()]
    fit = _fit_parts(parts, voltage, current, gap, solenoid, (period_s, seat_gap))
    if fit.reason or not rounded:
        return fit
    step, draw = _step(current), np.random.default_rng(_SEED)
    found = []
    for _ in range(_ROUNDINGS):
        off_step = draw.uniform(-0.5 * step, 0.5 * step, len(current))
        other = np.where(current != 0.0, current + off_step, 0.0)
        again = _fit_parts(parts, voltage, other, gap, solenoid, (period_s, seat_gap))
        found.append((again.resistance - fit.resistance, again.inductance - fit.inductance))
    off = np.sqrt(np.nanmean(np.square(found), axis=0))
    return replace(fit, rounding=(float(off[0]), float(off[1])))


def _step(current: FloatArray) -> float:
    """Return the steps in which a current is told: its smallest change [A]."""
    steps = np.abs(np.diff(current))
    steps = steps[steps > _NO_STEP]
    return float(steps.min()) if len(steps) else 0.0


def _fit_parts(
    parts: list[slice],
    voltage: FloatArray,
    current: FloatArray,
    gap: FloatArray,
    solenoid: Magnetics,
    settings: tuple[float, float],
) -> CoilFit:
    period_s, seat_gap = settings
    rows, targets = [], []
    for part in parts:
        v, i = voltage[part], current[part]
        switches = np.concatenate(([False], v[1:] != v[:-1]))
        flux = np.empty((len(v), 2))
        _fluxes(solenoid, i, np.ascontiguousarray(gap[part]), flux)
        held = np.concatenate(([0.0], np.cumsum(v[:-1]) * period_s))
        columns = np.column_stack([integrate(i, switches, period_s), flux - flux[0]])
        rows.append(columns[1:])
        targets.append(held[1:])
    count = sum(len(t) for t in targets)
    if count < _FEWEST:
        nothing = float("nan")
        return CoilFit(nothing, nothing, f"{count} samples with current, fewer than {_FEWEST}")
    return _solved(np.concatenate(rows), np.concatenate(targets), solenoid, seat_gap)


def _solved(matrix: FloatArray, target: FloatArray, m: Magnetics, seat_gap: float) -> CoilFit:
    scale = np.sqrt(np.sum(matrix**2, axis=0))
    used = scale > 1e-12  # of a column that is not finite, too: it tells nothing
    if not used[0]:
        nothing = float("nan")
        return CoilFit(nothing, nothing, _NOT_APART)
    columns = matrix[:, used] / scale[used]
    left = (
        columns[:, 0]
        - columns[:, 1:] @ np.linalg.lstsq(columns[:, 1:], columns[:, 0], rcond=None)[0]
    )
    if float(np.sqrt(left @ left)) < _MIN_EXCITATION:
        nothing = float("nan")
        return CoilFit(nothing, nothing, _NOT_APART)
    solution = np.zeros(3)
    solution[used] = np.linalg.lstsq(columns, target, rcond=None)[0] / scale[used]
    small = 1e-3
    slope = (flux_linkage(m, small, seat_gap) - magnet_flux(m, seat_gap)) / small
    if solution[0] <= 0.0 or solution[1] <= 0.0:
        nothing = float("nan")
        return CoilFit(nothing, nothing, f"resistance {solution[0]:.3g} ohm: check the signs")
    return CoilFit(float(solution[0]), float(solution[1] * slope))
