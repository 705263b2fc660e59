# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""By how much a solenoid's dimensions differ from those of its design, from one cycle.

A dimension changes the coenergy by a known function dW (`table`), so to first order

    psi_k = psi_k0 + sum over dimensions of size * d(dW)/di_k
    F     = F_0    + sum over dimensions of size * d(dW)/dx

The flux balance of either coil (V summed up, less R i) is compared with psi at the currents
before the eddy currents, G_A^-1 i or those of the record, and the motion in windows of 10 ms
with the force behind G_F (`motion.py`). Both are linear in the sizes and are solved together,
with the resistances, the supply, the fluxes at the start, force gain, friction and the start of
every window as their companions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import gram_condition, unit_diagonal
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.valves.double_solenoid.coils import flux_record
from valve_twin.core.valves.double_solenoid.dimensions.published import COMPANIONS
from valve_twin.core.valves.double_solenoid.motion import (
    SUB,
    WINDOW,
    force_record,
    shift_all,
    usable_windows,
)
from valve_twin.core.valves.double_solenoid.plant_kernel import Second
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.physics.curves import Curves
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.double_solenoid.dimensions.table import DimensionTable
    from valve_twin.core.valves.double_solenoid.plant_kernel import Valve
    from valve_twin.core.valves.double_solenoid.record import Record

_SUPPLY, _FRICTION = COMPANIONS.index("supply"), COMPANIONS.index("friction")
_ROUNDS = 8
_SHOWN = 1e-2  # combinations that the motion alone hardly shows take no step [1]
_ENDED = 1.05  # what is left before a last step over that behind it [1]
_STEPS = (1e-4, 1e-3, 1e-3)  # for derivatives over the companions
_SPEED_STEP = 1e-4  # [m/s]
_FORCE_STEP = 1e-2  # size of a dimension for derivatives, of its column [1]
_FEWEST_WINDOWS = 3
_THINNED = 8  # neighbouring samples of a flux balance err alike: so many count as one, assumed
_LEAST_FLUX, _LEAST_PLACE = 1e-6, 1e-9  # of what the fits leave [Wb], [m]

UNFOLLOWED = "the motion of the cycle cannot be followed"
_FEW = Refusal(RefusalCode.NOT_EXCITED, f"{UNFOLLOWED}: too little of it is off the stops")
_ENDLESS = Refusal(RefusalCode.NO_CONVERGENCE, f"{UNFOLLOWED}: the fit comes to no end")
_SINGULAR = Refusal(RefusalCode.NOT_EXCITED, "motion and fluxes do not show every dimension")


@dataclass(frozen=True, slots=True)
class DimensionFit:
    """Sizes of D dimensions and their companions from one cycle.

    Attributes
    ----------
    values : (4 + D,) array
        Companions, then sizes [their units], [1].
    covariance : (4 + D, 4 + D) array
        As if what the fit leaves were noise.
    left : (3,) array
        What it leaves of the motion [m] and of both fluxes [Wb], rms.
    condition : float
        Of the scaled normal equations, its root [1].
    """

    values: FloatArray
    covariance: FloatArray
    left: FloatArray
    condition: float


@njit(cache=True)
def filtered(g: Second, source: FloatArray, period: float, out: FloatArray) -> None:
    """Write G s in every step between the samples, from rest at the first.

    Parameters
    ----------
    g : Second
        The transfer function.
    source : (N,) array
        Held from the sample before to its own [A] or [N].
    period : float
        Sampling time [s].
    out : (N, SUB) array
        Overwritten [A] or [N].
    """
    h = period / SUB
    z1, z2 = source[0], 0.0
    for n in range(len(source)):
        s = source[n]
        for k in range(SUB):
            out[n, k] = g.out_1 * z1 + g.out_2 * z2 + g.direct * s
            z1, z2 = z1 + h * z2, z2 + h * (g.rate_1 * (s - z1) - g.rate_2 * z2)


def inverse(g: Second) -> Second:
    """Return 1/G of a transfer function with a gain of 1 at rest."""
    a2, b2 = 1.0 / g.rate_1, g.direct / g.rate_1
    a1 = g.rate_2 * a2
    b1 = g.out_2 + g.direct * a1
    direct = a2 / b2
    return Second(1.0 / b2, b1 / b2, 1.0 - direct, a1 - direct * b1, direct)


def fit_dimensions(
    record: Record,
    v: Valve,
    m: Curves,
    table: DimensionTable,
    start: FloatArray,
) -> DimensionFit | Refusal:
    """Fit all dimensions to a cycle, or say why that cannot be done.

    Parameters
    ----------
    record : Record
        Motion, voltages and currents, every sample known.
    v, m : Valve, Curves
        The valve of the design.
    table : DimensionTable
        How dimensions change the coenergy.
    start : (3,) array
        Force gain, friction and preload of spring 1 of `fit_motion` [1], [N], [N].
    """
    firsts = usable_windows(record, v.stop)
    if len(firsts) < _FEWEST_WINDOWS:
        return _FEW
    motion = _motion_rows(record, v, m, table, (firsts, start))
    if isinstance(motion, Refusal):
        return motion
    blocks = [motion]
    blocks += [_flux_rows(record, v, m, table, coil) for coil in (0, 1)]
    return _solve(blocks, len(table.names))


def _solve(
    blocks: list[tuple[FloatArray, FloatArray, float]], count: int
) -> DimensionFit | Refusal:
    """Weigh the blocks by what each leaves alone, and solve them together."""
    size = len(COMPANIONS) + count
    normal, right, left = np.zeros((size, size)), np.zeros(size), []
    for rows, values, least in blocks:
        if not (np.isfinite(rows).all() and np.isfinite(values).all()):
            return _ENDLESS
        found = np.linalg.lstsq(rows, values, rcond=1e-10)[0]
        sigma = max(float(np.sqrt(np.mean((values - rows @ found) ** 2))), least)
        left.append(sigma)
        normal += rows.T @ rows / sigma**2
        right += rows.T @ values / sigma**2
    scaled, scale = unit_diagonal(normal)
    if not (np.isfinite(scale).all() and np.diag(normal).all()):
        return _SINGULAR
    covariance = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True) / np.outer(scale, scale)
    return DimensionFit(covariance @ right, covariance, np.array(left), gram_condition(normal))


def _motion_rows(
    record: Record,
    v: Valve,
    m: Curves,
    table: DimensionTable,
    begin: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, float] | Refusal:
    """Return rows and values of the motion, whose solution are companions and sizes.

    A refusal where the steps do not come to an end or the motion is no longer one of the law.
    """
    firsts, companions = begin
    count, period = len(record.x), record.period_s
    force = np.empty((count, SUB))
    force_record(v, m, record.x, record.current_a, record.current_b, period, force)
    middle = 0.5 * (record.x + np.concatenate([record.x[:1], record.x[:-1]]))
    currents = np.column_stack([record.current_a, record.current_b])
    more = np.empty((len(table.names), count, SUB))
    for k, change in enumerate(table.forces(currents, middle)):
        filtered(v.force, np.ascontiguousarray(change), period, more[k])
    places = firsts.astype(np.int64)[:, None] + np.arange(WINDOW)
    measured = record.x[places]
    slope = np.polyfit(np.arange(8) * period, measured[:, :8].T, 1)
    starts = np.ascontiguousarray(np.stack([slope[1], slope[0]], axis=1))
    values = np.concatenate([companions, [0.0], np.zeros(len(more))])  # no supply in the motion
    spring = np.concatenate(
        [[0.0, 0.0, v.preload_1, 0.0], np.zeros(len(more))]
    )  # its change is told

    def positions(at: FloatArray, whole: FloatArray, speed: float) -> FloatArray:
        moved = v._replace(force_gain=at[0], friction=max(at[1], 0.0), preload_1=at[2])
        out: FloatArray = np.empty_like(measured)
        shift_all(moved, whole, record.x, firsts, starts, speed, period, WINDOW, out)
        return out

    rows = np.zeros((*measured.shape, len(values)))
    own = np.ones((*measured.shape, 2))
    for _ in range(_ROUNDS):
        whole = force + np.tensordot(values[len(COMPANIONS) :], more, axes=1)
        here = positions(values, whole, 0.0)
        for j, step in enumerate(_STEPS):
            aside = values.copy()
            aside[j] += step
            rows[:, :, j] = (positions(aside, whole, 0.0) - here) / step
        for k, change in enumerate(more):
            off = positions(values, whole + _FORCE_STEP * change, 0.0) - here
            rows[:, :, len(COMPANIONS) + k] = off / _FORCE_STEP
        own[:, :, 1] = (positions(values, whole, _SPEED_STEP) - here) / _SPEED_STEP
        residual = measured - here
        basis = np.linalg.qr(own)[0]
        left = (rows - basis @ (basis.transpose(0, 2, 1) @ rows)).reshape(-1, len(values))
        rest = residual - (basis @ (basis.transpose(0, 2, 1) @ residual[:, :, None]))[:, :, 0]
        scale = np.linalg.norm(left, axis=0)
        scale[_SUPPLY] = 1.0
        if not np.isfinite(scale).all():
            return _ENDLESS
        if not scale.all():
            return _without_effect(values, table, scale)
        change = np.linalg.lstsq(left / scale, rest.ravel(), rcond=_SHOWN)[0] / scale
        off = residual - rows @ change
        move = np.linalg.solve(own.transpose(0, 2, 1) @ own,
                               own.transpose(0, 2, 1) @ off[:, :, None])[:, :, 0]  # fmt: skip
        about = values - spring
        target = left @ about + rest.ravel()
        starts, values = starts + move, values + change
        before, after = np.linalg.norm(rest), np.linalg.norm(rest.ravel() - left @ change)
        if before <= _ENDED * after:
            return left, target, _LEAST_PLACE
    return _ENDLESS


def _without_effect(values: FloatArray, table: DimensionTable, scale: FloatArray) -> Refusal:
    """Return why a fit ends whose motion does not answer to one of its numbers."""
    if values[_FRICTION] < 0.0:
        text = (
            f"{UNFOLLOWED}: it asks for a friction of {values[_FRICTION]:.2g} N; curves, G_A or "
            f"G_F are not those of this valve"
        )
        return Refusal(RefusalCode.MISFIT, text)
    name = (*COMPANIONS, *table.names)[int(np.argmin(scale))]
    return Refusal(RefusalCode.NOT_EXCITED, f"{UNFOLLOWED}: it does not answer to {name}")


def _flux_rows(
    record: Record, v: Valve, m: Curves, table: DimensionTable, coil: int
) -> tuple[FloatArray, FloatArray, float]:
    """Return rows and values of a coil's flux balance: its solution is the supply and sizes."""
    period = record.period_s
    both = np.column_stack([record.current_a, record.current_b])
    own = np.ascontiguousarray(both[:, coil])
    if v.eddies.gain_1 == 0.0:
        early = np.empty((len(both), SUB))
        filtered(inverse(v.current), own, period, early)
        own = early.mean(axis=1)
    other = np.ascontiguousarray(both[:, 1 - coil])
    flux = np.empty(len(both))
    flux_record(m, coil, own, other, record.x, flux)
    at = both.copy()
    at[:, coil] = own
    at = 0.5 * (at + np.concatenate([at[1:], at[-1:]]))
    charge = np.concatenate([[0.0], np.cumsum(record.drawn[1:, coil])]) * period
    applied = np.concatenate([[0.0], np.cumsum(record.volts[1:, coil])]) * period
    beside = np.column_stack([charge, np.ones(len(both))])
    rows = np.zeros((len(both), len(COMPANIONS) + len(table.names)))
    rows[:, _SUPPLY] = -applied
    rows[:, len(COMPANIONS) :] = table.fluxes(at, record.x, coil).T
    part = slice(_THINNED, -1, _THINNED)
    basis = np.linalg.qr(beside[part])[0]
    rows, values = rows[part], (applied - flux)[part]
    return rows - basis @ (basis.T @ rows), values - basis @ (basis.T @ values), _LEAST_FLUX
