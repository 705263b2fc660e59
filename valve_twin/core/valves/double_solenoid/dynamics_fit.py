# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The linear dynamics G_A and G_F from a transient field computation (paper 000, section 3.2).

A trapezoid of current in coil A, 1 A in coil B, position 0. The flux linkage that the computation
answers with is rebuilt from switched voltages; the characteristic curve makes i_stat of it, and
G_A is fitted from i_stat to the current, G_F from the force of the curves to the computed force,
both in continuous time by nonlinear least squares. Where the flux cannot be rebuilt the flanks are
too steep: they are made longer until it can.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.control.current_loop import SUB_STEPS
from valve_twin.core.control.flux_reconstruction import (
    Reconstruction,
    reachable,
    reconstruct_flux,
)
from valve_twin.core.estimation.solvers.nonlinear import Curve, CurveFit, FitParameter, fit_curves
from valve_twin.core.physics.solenoid_map import MapTables, coil_current, coil_flux, coil_force
from valve_twin.core.valves.double_solenoid.plant_kernel import STEP_S, Second, second_order
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant

BIAS_A = 1.0
"""Current of coil B, and of coil A before the trapezoid [A]; paper 000, section 3.2."""

_AMPLITUDE_A, _PLATEAU_S = 0.8, 2e-3  # of the trapezoids
_LONGER = 1.25
_TRIES = 20
_LEAD_S = 1e-3  # rest before the first flank [s], assumed
_MS = 1e-3


class FieldAnswer(NamedTuple):
    """What a transient computation gives at every sub-step of 12.5 us, (M,) each [Wb], [N]."""

    flux: FloatArray
    force: FloatArray


Bench = Callable[["FloatArray"], FieldAnswer]
"""Maps the current of coil A (M,) at every sub-step [A] to the computed flux and force."""


@dataclass(frozen=True, slots=True)
class Excitation:
    """A trapezoid of current and what came of it.

    Attributes
    ----------
    flank_s : float
        Length of a flank from -amplitude to +amplitude about the bias [s].
    current : (M,) array
        Current of coil A at every sub-step [A].
    answer : FieldAnswer
        Computed flux linkage and force.
    rebuilt : Reconstruction
        The flux linkage from switched voltages.
    tries : int
        Computations that were needed.
    reached : bool
        Whether the voltage sufficed everywhere.
    """

    flank_s: float
    current: FloatArray
    answer: FieldAnswer
    rebuilt: Reconstruction
    tries: int
    reached: bool


@dataclass(frozen=True, slots=True)
class DynamicsFit:
    """Fitted dynamics: numbers for the compiled functions, coefficients in ms, and the fit."""

    dynamics: Second
    coefficients: dict[str, float]
    rms: float
    fit: CurveFit


def trapezoid(flank_s: float, amplitude: float, plateau_s: float) -> FloatArray:
    """Return bias, up, plateau, down below, plateau, back to bias: (M,) at every sub-step [A].

    Parameters
    ----------
    flank_s : float
        Time for a change by twice the amplitude [s].
    amplitude : float
        About `BIAS_A` [A].
    plateau_s : float
        Length of either plateau [s].
    """
    lengths = (_LEAD_S, 0.5 * flank_s, plateau_s, flank_s, plateau_s, 0.5 * flank_s, 2.0 * _LEAD_S)
    corners = np.concatenate([[0.0], np.cumsum(lengths)])
    levels = BIAS_A + amplitude * np.array([0.0, 0.0, 1.0, 1.0, -1.0, -1.0, 0.0, 0.0])
    samples = int(np.ceil(corners[-1] / (SUB_STEPS * STEP_S)))
    times = STEP_S * np.arange(SUB_STEPS * samples + 1)
    current: FloatArray = np.interp(times, corners, levels)
    return current


def excite(
    bench: Bench, *, resistance: float, supply: float, flank_s: float = 0.6e-3
) -> Excitation:
    """Run the trapezoid, with flatter flanks until the bridge can make the flux.

    Parameters
    ----------
    bench : callable
        The transient field computation.
    resistance, supply : float
        Of the coil [ohm], of the bridge [V].
    flank_s : float
        Of the first trapezoid, see `trapezoid` [s].

    Returns
    -------
    Excitation
        `reached` is False where even the last, 70 times longer flanks were too steep.
    """
    for tries in range(1, _TRIES + 1):
        current = trapezoid(flank_s, _AMPLITUDE_A, _PLATEAU_S)
        answer = bench(current)
        wanted = answer.flux[::SUB_STEPS]
        steps = current[:-1]
        rebuilt = reconstruct_flux(wanted, steps, resistance, supply)
        reached = bool(reachable(wanted, steps, resistance, supply).all())
        if reached or tries == _TRIES:
            break
        flank_s *= _LONGER
    return Excitation(flank_s, current, answer, rebuilt, tries, reached)


@njit(cache=True)
def _filtered(g: Second, values: FloatArray, out: FloatArray) -> None:
    """Write the output of a transfer function, from rest, with classic Runge-Kutta steps."""
    h = STEP_S
    z1, z2 = values[0], 0.0
    for n in range(len(values)):
        out[n] = g.out_1 * z1 + g.out_2 * z2 + g.direct * values[n]
        after = values[min(n + 1, len(values) - 1)]
        middle = 0.5 * (values[n] + after)
        a1, a2 = z2, g.rate_1 * (values[n] - z1) - g.rate_2 * z2
        b1 = z2 + 0.5 * h * a2
        b2 = g.rate_1 * (middle - z1 - 0.5 * h * a1) - g.rate_2 * b1
        c1 = z2 + 0.5 * h * b2
        c2 = g.rate_1 * (middle - z1 - 0.5 * h * b1) - g.rate_2 * c1
        d1 = z2 + h * c2
        d2 = g.rate_1 * (after - z1 - h * c1) - g.rate_2 * d1
        z1, z2 = (
            z1 + h / 6.0 * (a1 + 2 * b1 + 2 * c1 + d1),
            z2 + h / 6.0 * (a2 + 2 * b2 + 2 * c2 + d2),
        )


def filtered(g: Second, values: FloatArray) -> FloatArray:
    """Return the output (M,) of a transfer function that was at rest at the first value.

    Parameters
    ----------
    g : Second
        The transfer function.
    values : (M,) array
        Input at every sub-step of 12.5 us.
    """
    out = np.empty(len(values))
    _filtered(g, np.ascontiguousarray(values, dtype=np.float64), out)
    return out


def second_order_ms(p: FloatArray) -> Second:
    """Return a transfer function from b1, b2, a1, a2 (4,) in ms and ms^2."""
    return second_order(p[0] * _MS, p[1] * _MS**2, p[2] * _MS, p[3] * _MS**2)


def _answer(values: FloatArray, p: FloatArray) -> FloatArray:
    return filtered(second_order_ms(p), values)


def refined(values: FloatArray, every: int) -> FloatArray:
    """Return values (N,) with `every` sub-steps in between, on straight lines."""
    index = np.arange(len(values))
    fine: FloatArray = np.interp(np.arange(every * (len(values) - 1) + 1) / every, index, values)
    return fine


def fit_coarse_dynamics(source: FloatArray, answer: FloatArray, every: int) -> CurveFit:
    """Fit b1, b2, a1, a2 [ms, ms^2] between signals sampled every `every` sub-steps of 12.5 us.

    Parameters
    ----------
    source, answer : (N,) arrays
        Input and output, from rest, the input on straight lines in between: both [A] or both [N].
    every : int
        Sub-steps in a sample.
    """
    fine = refined(source, every)
    parameters = _starts(("b1", "b2", "a1", "a2"))
    return fit_curves(lambda _, p: _answer(fine, p)[::every], [Curve(source, answer)], parameters)


def _starts(names: tuple[str, str, str, str]) -> list[FitParameter]:
    starts = (0.4, 0.03, 0.5, 0.05)
    return [
        FitParameter(names[0], starts[0], 0.0, 50.0),
        FitParameter(names[1], starts[1], 0.0, 100.0),
        FitParameter(names[2], starts[2], 1e-2, 50.0),
        FitParameter(names[3], starts[3], 1e-3, 100.0),
    ]


def fit_dynamics(
    source: FloatArray, answer: FloatArray, names: tuple[str, str, str, str]
) -> DynamicsFit:
    """Fit (1 + b1 s + b2 s^2)/(1 + a1 s + a2 s^2) between two signals.

    The gain at rest is 1: the curves are exact there.

    Parameters
    ----------
    source, answer : (M,) arrays
        Input and output at every sub-step of 12.5 us, from rest: both [A] or both [N].
    names : tuple of str
        Names of b1, b2, a1, a2.
    """
    fit = fit_curves(_answer, [Curve(source, answer)], _starts(names))
    p = fit.values
    return DynamicsFit(
        dynamics=second_order_ms(p),
        coefficients={n: float(v) for n, v in zip(names, p, strict=True)},
        rms=float(np.sqrt(fit.residual_sum / len(answer))),
        fit=fit,
    )


def _pull(m: MapTables, current: FloatArray) -> FloatArray:
    """Return the force of the curves with coil B at its bias, position 0 (M,) [N]."""
    other = coil_force(m, BIAS_A, 0.0)
    return np.array([coil_force(m, i, 0.0) - other for i in current])


def fit_current_dynamics(
    excitation: Excitation, m: MapTables, *, rebuilt: bool = True
) -> DynamicsFit:
    """Fit G_A from i_stat, by the curve from the flux, to the current of the excitation.

    Parameters
    ----------
    excitation : Excitation
        See `excite`.
    m : MapTables
        Curves of the coil.
    rebuilt : bool
        Take the flux of the switched voltages, as the paper does; else the computed flux.
        The ripple of the switching is noise of i_stat: the inverse of G_A is then fitted, from
        the smooth current to i_stat, because noise in the input of a fit takes gain away.
    """
    flux = excitation.rebuilt.flux if rebuilt else excitation.answer.flux
    static = np.array([coil_current(m, psi, BIAS_A, 0.0) for psi in flux])
    if not rebuilt:
        return fit_dynamics(static, excitation.current, ("b1", "b2", "a1", "a2"))
    inverse = fit_dynamics(excitation.current, static, ("a1", "a2", "b1", "b2"))
    c = inverse.coefficients
    g = second_order(c["b1"] * _MS, c["b2"] * _MS**2, c["a1"] * _MS, c["a2"] * _MS**2)
    return DynamicsFit(g, c, inverse.rms, inverse.fit)


def fit_force_dynamics(excitation: Excitation, m: MapTables) -> DynamicsFit:
    """Fit G_F from the force of the curves at the excitation's current to the computed force.

    Parameters
    ----------
    excitation : Excitation
        See `excite`.
    m : MapTables
        Curves of the coil.
    """
    static = _pull(m, excitation.current)
    return fit_dynamics(static, excitation.answer.force, ("f1", "f2", "d1", "d2"))


def model_bench(plant: DoubleSolenoidPlant) -> Bench:
    """Return the model itself in the place of a field computation, with known dynamics.

    Parameters
    ----------
    plant : DoubleSolenoidPlant
        The valve.
    """
    m = plant.pole_tables()
    inverse = second_order(plant.current_a1, plant.current_a2, plant.current_b1, plant.current_b2)

    def bench(current: FloatArray) -> FieldAnswer:
        static = filtered(inverse, current)
        flux = np.array([coil_flux(m, i, BIAS_A, 0.0) for i in static])
        return FieldAnswer(flux, filtered(plant.force_dynamics(), _pull(m, current)))

    return bench
