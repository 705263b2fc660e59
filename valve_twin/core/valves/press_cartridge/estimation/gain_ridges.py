# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which gains, slopes, leak and pole a fit determines singly."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.eigenvalues import extreme_eigenvalues
from valve_twin.core.estimation.solvers.identifiability import (
    Identifiability,
    IdentifiabilityOptions,
    assess_identifiability,
    information_root,
)
from valve_twin.core.estimation.solvers.least_squares import gram_condition
from valve_twin.core.estimation.solvers.small_dense import factorise, solve_lower
from valve_twin.core.types import ParameterStatus, ParameterValue
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import N_LINEAR
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.core.valves.press_cartridge.estimation.free_run import (
        OutputErrorOptions,
        Solution,
    )

RIDGE = IdentifiabilityOptions()
"""When a parameter counts as lost."""

_LEAK_SHARE = 0.05  # of the speed at the greatest command
_REGULAR = 1e-6  # least pivot of a unit diagonal from which on no other way is more exact
_FIRM = 1e-8  # share of the greatest eigenvalue below which rounding shows
_CLEAR = 0.99  # of a limit, below which rounding decides nothing
_SHARP = 1e11  # size of a parameter in standard errors from which on rounding is the noise


def gain_identifiability(
    s: Solution, fitted: IntArray, mse: float, period_s: float, options: OutputErrorOptions
) -> Identifiability:
    """Tell which of the published parameters are known singly.

    The sizes say when a parameter is lost altogether, not when it is precise: a slope that takes
    the whole gain away over the commands, a leak of a twentieth of the greatest speed, a pole of
    1.

    Parameters
    ----------
    s : Solution
        The fit.
    fitted : (F,) int64 array
        Columns that are not on a bound, the pole with them.
    mse : float
        Mean squared weighted residual [1].
    period_s : float
        Sampling time [s].
    options : OutputErrorOptions
        Where the gains are published.
    """
    quick = _known_singly(s, fitted, mse, options)
    return quick or _assessed(s, fitted, mse, period_s, options)


def _assessed(
    s: Solution, fitted: IntArray, mse: float, period_s: float, options: OutputErrorOptions
) -> Identifiability:
    """Return the same of any fit, what is not known singly among it."""
    names: list[str] = []
    rows: list[FloatArray] = []  # published parameters as combinations of the fitted ones
    sizes: list[float] = []
    speed = 0.0
    unit = np.eye(N_LINEAR + 1)[:, fitted]
    for first, name, command in ((0, "K_in", s.v_in_mean), (2, "K_out", options.v_ref)):
        weight = 2.0 * options.v_max - (command if np.isfinite(command) else 0.0)
        gain = unit[first] + weight * unit[first + 1]
        if not gain.any():
            continue
        value = float(s.linear[first] + weight * s.linear[first + 1])
        names.append(name)
        rows.append(gain)
        sizes.append(value)
        speed = max(speed, value * options.v_max)
        if unit[first].any() and unit[first + 1].any():
            names.append(f"{name}_slope")
            rows.append(-unit[first + 1])
            sizes.append(value / options.v_max)
    leak = max(float(s.linear[4]), _LEAK_SHARE * speed)
    for k, name, size in ((4, "leak", leak), (5, "pole", 1.0)):
        if unit[k].any():
            names.append(name)
            rows.append(unit[k] / period_s if name == "leak" else unit[k])
            sizes.append(size / period_s if name == "leak" else size)
    root = information_root(s.gram[np.ix_(fitted, fitted)])
    matrix = np.linalg.inv(np.array(rows)) if rows else np.zeros((0, 0))
    values = np.linalg.solve(matrix, np.append(s.linear, s.pole)[fitted]) if rows else np.zeros(0)
    return assess_identifiability(
        names,
        values,
        root @ matrix,
        float(np.sqrt(max(mse, 0.0))),
        sizes=np.array(sizes),
        options=RIDGE,
    )


def _known_singly(
    s: Solution, fitted: IntArray, mse: float, options: OutputErrorOptions
) -> Identifiability | None:
    """Return what `assess_identifiability` does where all is known singly, else nothing."""
    command = s.v_in_mean if np.isfinite(s.v_in_mean) else 0.0
    errors = np.empty(N_LINEAR + 1)
    count, condition = _relative_errors(
        s.gram,
        fitted,
        np.append(s.linear, s.pole),
        (2.0 * options.v_max - command, 2.0 * options.v_max - options.v_ref),
        options.v_max,
        mse,
        RIDGE.max_error,
        errors,
    )
    if count <= 0:
        return None
    known = np.ones(count, dtype=np.bool_)
    return Identifiability(errors[:count], known, ("",) * count, (), condition)


@njit(cache=True, error_model="numpy")
def _relative_errors(
    gram: FloatArray,
    fitted: IntArray,
    p: FloatArray,
    weights: tuple[float, float],
    v_max: float,
    variance: float,
    limit: float,
    errors: FloatArray,
) -> tuple[int, float]:
    """Fill the standard errors in units of the sizes; return how many, and the condition number.

    Both 0 where a parameter is not known clearly, or the equations are near to singular.
    """
    sizes = np.zeros((N_LINEAR + 1, N_LINEAR + 1))
    count = _fill_sizes(fitted, p, weights, v_max, sizes)
    unit, lower = _information(gram, sizes, count), np.zeros((count, count))
    alone = np.sqrt(np.diag(unit) / variance)
    for i in range(count):
        if not 1.0 < _CLEAR * alone[i] * limit < _SHARP:
            return 0, 0.0
    for i in range(count):
        for j in range(count):
            unit[i, j] /= alone[i] * alone[j] * variance
    if not factorise(unit, lower) > _REGULAR:
        return 0, 0.0
    errors[:count] = 0.0
    side = np.empty(count)
    for i in range(count):
        side[:] = 0.0
        side[i] = 1.0
        solve_lower(lower, side, count)
        for j in range(count):
            errors[i] += side[j] * side[j]
    for i in range(count):
        errors[i] = np.sqrt(errors[i]) / alone[i]
        if not errors[i] < _CLEAR * limit:
            return 0, 0.0
    least, greatest = extreme_eigenvalues(unit)
    return count, np.sqrt(greatest / least)


@njit(cache=True, error_model="numpy")
def _fill_sizes(
    fitted: IntArray,
    p: FloatArray,
    weights: tuple[float, float],
    v_max: float,
    sizes: FloatArray,
) -> int:
    """Fill what each published parameter, a column, is of the fitted ones; return how many."""
    on = np.zeros(N_LINEAR + 1, dtype=np.bool_)
    on[fitted] = True
    count, speed = 0, 0.0
    for k in range(2):
        first, weight = 2 * k, weights[k]
        if not on[first] and not on[first + 1]:
            continue
        value = p[first] + weight * p[first + 1]
        speed = max(speed, value * v_max)
        if on[first]:
            sizes[first, count] = value
        else:
            sizes[first + 1, count] = value / weight
        count += 1
        if on[first] and on[first + 1]:
            sizes[first, count] = weight * value / v_max
            sizes[first + 1, count] = -value / v_max
            count += 1
    if on[4]:
        sizes[4, count] = max(p[4], _LEAK_SHARE * speed)
        count += 1
    if on[N_LINEAR]:
        sizes[N_LINEAR, count] = 1.0
        count += 1
    return count


@njit(cache=True)
def _information(gram: FloatArray, sizes: FloatArray, count: int) -> FloatArray:
    """Return the normal equations of parameters that are the leading columns of `sizes`."""
    size = len(sizes)
    half, found = np.zeros((size, count)), np.zeros((count, count))
    for i in range(size):
        for j in range(count):
            for k in range(size):
                half[i, j] += gram[i, k] * sizes[k, j]
    for i in range(count):
        for j in range(count):
            for k in range(size):
                found[i, j] += sizes[k, i] * half[k, j]
    return found


def gain_condition(gram: FloatArray) -> float:
    """Return the condition number of column-scaled sensitivities as `gram_condition` does [1].

    Parameters
    ----------
    gram : (P, P) array
        Their normal equations.
    """
    least, greatest = extreme_eigenvalues(gram)
    if least > _FIRM * greatest:
        return float(np.sqrt(greatest / least))
    return gram_condition(gram)


def refuse_ridges(
    parameters: tuple[ParameterValue, ...], found: Identifiability
) -> tuple[ParameterValue, ...]:
    """Refuse what lies on a ridge; what is merely weak has its own reason already.

    Parameters
    ----------
    parameters : tuple of ParameterValue
        As published.
    found : Identifiability
        What was found of them.
    """
    on = {name for ridge in found.ridges for name in ridge}
    return tuple(
        ParameterValue(p.name, float("nan"), ParameterStatus.REFUSED, found.reason)
        if p.name in on
        else p
        for p in parameters
    )
