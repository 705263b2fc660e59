# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Magnetic circuit of one solenoid: coil, saturation and permanent magnet as one energy function.

With g the gap and d the kernel distance, the coil follows paper 001, eqs. (4.13)-(4.21):

    linear       d = g + kappa     flux = 2 beta i/d            force = beta i^2/d^2
    saturating   f = 2 C1/d + C3   flux = lam_s (1 - exp(-f i))   force from its co-energy

The saturating kernel has two readings. "regular": d = g + C2, without a pole. "fit": d = g - C2
and f = 2 C1/d - C3, the coordinate in which the paper's static curves were fitted; it reproduces
the paper's forces and has a pole at g = C2.

The permanent magnet is absent from the paper's equations: without current they give no force. It
enters here as a force F_pm(g) = F_0 ((g_0 + b)/(g + b))^2 through the two forces that the paper
measured, and as a flux linkage M(g) of the coil, so that an inverse current weakens it
(assumed):

    force = force of the coil + F_pm(g) - M'(g) i,    flux = flux of the coil + M(g)
    -M'(g) = coupling 2 sqrt(beta F_pm)/(g + kappa)

With coupling 1 and the linear kernel the force is the square (sqrt(F_pm) + sqrt(beta) i/d)^2.
All of it derives from one co-energy, so nothing creates energy.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from valve_twin.kernels import njit

LINEAR, REGULAR, FIT = 0, 1, 2
KERNELS = ("linear", "saturating", "saturating_fit")
"""Names of the kernels, in the order of their numbers."""

MAGNET_GAP = 0.5e-3
"""Gap at which the magnet's force is given [m] (paper 001, static table)."""

_FULL = 1.0 - 1e-12  # greatest share of the saturation flux that has a finite current
_SMALL = 1e-3  # below it the force is a series: no cancellation


class Magnetics(NamedTuple):
    """Numbers of one solenoid for the compiled functions, SI units.

    `kernel` is the index in `KERNELS`; `magnet_force` F_0 at `MAGNET_GAP`, `magnet_length` b.
    """

    kernel: int
    beta: float
    kappa: float
    saturation_flux: float
    c1: float
    c2: float
    c3: float
    magnet_force: float
    magnet_length: float
    coupling: float


@njit(cache=True)
def severity(m: Magnetics, gap: float) -> tuple[float, float]:
    """Return f [1/A] of the saturating kernel and how fast it grows as the gap closes [1/(A m)].

    Parameters
    ----------
    m : Magnetics
        The solenoid.
    gap : float
        Physical gap, above C2 in the reading "fit" [m].
    """
    if m.kernel == FIT:
        d = gap - m.c2
        return 2.0 * m.c1 / d - m.c3, 2.0 * m.c1 / (d * d)
    d = gap + m.c2
    return 2.0 * m.c1 / d + m.c3, 2.0 * m.c1 / (d * d)


@njit(cache=True)
def magnet_force(m: Magnetics, gap: float) -> float:
    """Return the force of the permanent magnet alone, towards the pole [N]."""
    ratio = (MAGNET_GAP + m.magnet_length) / (gap + m.magnet_length)
    return m.magnet_force * ratio * ratio


@njit(cache=True)
def magnet_flux(m: Magnetics, gap: float) -> float:
    """Return the flux linkage that the permanent magnet puts into the coil [Wb]."""
    if m.coupling == 0.0 or m.magnet_force == 0.0:
        return 0.0
    scale = 2.0 * m.coupling * math.sqrt(m.beta * m.magnet_force)
    scale *= (MAGNET_GAP + m.magnet_length) / (m.magnet_length - m.kappa)
    return scale * math.log((gap + m.magnet_length) / (gap + m.kappa))


@njit(cache=True)
def magnet_pull(m: Magnetics, gap: float) -> float:
    """Return -M'(g): force of the magnet's flux on one ampere in the coil [N/A]."""
    return 2.0 * m.coupling * math.sqrt(m.beta * magnet_force(m, gap)) / (gap + m.kappa)


@njit(cache=True)
def coil_current(m: Magnetics, flux: float, gap: float) -> float:
    """Return the current that belongs to a flux linkage [A]; odd without magnet.

    Parameters
    ----------
    m : Magnetics
        The solenoid.
    flux : float
        Flux linkage of the coil, that of the magnet included [Wb].
    gap : float
        Physical gap [m].
    """
    own = flux - magnet_flux(m, gap)
    if m.kernel == LINEAR:
        return own * (gap + m.kappa) / (2.0 * m.beta)
    share = min(abs(own) / m.saturation_flux, _FULL)
    return math.copysign(-math.log1p(-share) / severity(m, gap)[0], own)


@njit(cache=True)
def flux_linkage(m: Magnetics, current: float, gap: float) -> float:
    """Return the flux linkage of the coil, that of the magnet included [Wb].

    Parameters
    ----------
    m, current, gap : Magnetics, float, float
        The solenoid, current in its coil, positive with the magnet [A], and physical gap [m].
    """
    if m.kernel == LINEAR:
        return 2.0 * m.beta * current / (gap + m.kappa) + magnet_flux(m, gap)
    own = -m.saturation_flux * math.expm1(-severity(m, gap)[0] * abs(current))
    return math.copysign(own, current) + magnet_flux(m, gap)


@njit(cache=True)
def coil_force(m: Magnetics, current: float, gap: float) -> float:
    """Return the force of the coil alone, towards the pole, even in the current [N].

    Parameters
    ----------
    m, current, gap : Magnetics, float, float
        The solenoid, current in its coil [A], and physical gap [m].
    """
    if m.kernel == LINEAR:
        ratio = current / (gap + m.kappa)
        return m.beta * ratio * ratio
    f, slope = severity(m, gap)
    u = f * abs(current)
    form = 1.0 - (1.0 + u) * math.exp(-u)
    if u < _SMALL:
        form = u * u * (0.5 - u / 3.0 + u * u / 8.0)
    return m.saturation_flux * slope / (f * f) * form


@njit(cache=True)
def force(m: Magnetics, current: float, gap: float) -> float:
    """Return the force on the armature, towards the pole [N].

    Parameters
    ----------
    m : Magnetics
        The solenoid.
    current : float
        Current in its coil, positive with the magnet [A].
    gap : float
        Physical gap [m].
    """
    pull = 0.0 if m.magnet_force == 0.0 else magnet_pull(m, gap) * current
    return coil_force(m, current, gap) + magnet_force(m, gap) + pull


@njit(cache=True)
def field_energy(m: Magnetics, flux: float, gap: float) -> float:
    """Return the energy of the field and of the magnet; that of the magnet is negative [J].

    Parameters
    ----------
    m, flux, gap : Magnetics, float, float
        The solenoid, flux linkage of its coil, that of the magnet included [Wb], and physical gap
        [m].
    """
    own = flux - magnet_flux(m, gap)
    far = MAGNET_GAP + m.magnet_length
    magnet = -m.magnet_force * far * far / (gap + m.magnet_length)
    if m.kernel == LINEAR:
        return own * own * (gap + m.kappa) / (4.0 * m.beta) + magnet
    share = min(abs(own) / m.saturation_flux, _FULL)
    form = (1.0 - share) * math.log1p(-share) + share
    return m.saturation_flux / severity(m, gap)[0] * form + magnet
