# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Static curves of two coils for compiled functions, whichever tables they stand in.

`MapTables` hold one coil, whose mirror image is the other, with a constant between them;
`CoenergyTables` hold both. Which it is is settled when a function is compiled, not while it runs.
"""

# mypy: disable-error-code="arg-type, union-attr"
# numba wants one signature of all bodies of an overload; each body meets its own tables only

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from numba.extending import overload

from valve_twin.core.physics.coenergy_tables import CoenergyTables, cell, flux_in, trilinear
from valve_twin.core.physics.solenoid_map import (
    MapTables,
    coil_flux,
    column_at,
    current_at,
    force_at,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Callable

Curves: TypeAlias = MapTables | CoenergyTables
"""Static curves of a valve's coils."""

Place: TypeAlias = tuple[int, float, int, float]
"""Cells of a position in the tables of either coil."""


def locate(m: Curves, x: float) -> Place:
    """Return the cells of a position [m]; compiled functions only."""
    raise NotImplementedError


def static_currents(
    m: Curves, psi: tuple[float, float], last: tuple[float, float], place: Place
) -> tuple[float, float]:
    """Return i_s(psi, i_other, x) of both coils [A]; compiled functions only.

    Parameters
    ----------
    m : MapTables or CoenergyTables
        Curves.
    psi, last : tuple of float
        Flux linkages [Wb] and currents of the step before [A].
    place : tuple
        See `locate`.
    """
    raise NotImplementedError


def static_force(m: Curves, i_a: float, i_b: float, place: Place) -> float:
    """Return F_s(i_A, i_B, x) [N] at a place; parameters as `force_of`, compiled only."""
    raise NotImplementedError


def linked_flux(m: Curves, coil: int, own: float, other: float, x: float) -> float:
    """Return psi with i_s(psi, other, x) = own [Wb]; parameters as `flux_of`, compiled only."""
    raise NotImplementedError


def _is_map(m: object) -> bool:
    return getattr(m, "instance_class", None) is CoenergyTables


@overload(locate)
def _locate(m: Curves, x: float) -> Callable[..., object]:
    def pole(m: Curves, x: float) -> Place:
        at_a, share_a = column_at(m, x)
        at_b, share_b = column_at(m, -x)
        return at_a, share_a, at_b, share_b

    def coenergy(m: Curves, x: float) -> Place:
        k, t = cell((x + m.reach) * m.per_position, m.force.shape[2])
        return k, t, k, t

    return coenergy if _is_map(m) else pole


@overload(static_currents)
def _static_currents(
    m: Curves, psi: tuple[float, float], last: tuple[float, float], place: Place
) -> Callable[..., object]:
    def pole(
        m: Curves, psi: tuple[float, float], last: tuple[float, float], place: Place
    ) -> tuple[float, float]:
        return (
            current_at(m, psi[0], last[1], place[0], place[1]),
            current_at(m, psi[1], last[0], place[2], place[3]),
        )

    def coenergy(
        m: Curves, psi: tuple[float, float], last: tuple[float, float], place: Place
    ) -> tuple[float, float]:
        row_a, row_b = (psi[0] - m.low_flux) * m.per_flux, (psi[1] - m.low_flux) * m.per_flux
        beside_a = (last[1] - m.low_current) * m.per_other
        beside_b = (last[0] - m.low_current) * m.per_other
        return (
            trilinear(m.current_a, row_a, beside_a, place[0], place[1]),
            trilinear(m.current_b, row_b, beside_b, place[0], place[1]),
        )

    return coenergy if _is_map(m) else pole


@overload(static_force)
def _static_force(m: Curves, i_a: float, i_b: float, place: Place) -> Callable[..., object]:
    def pole(m: Curves, i_a: float, i_b: float, place: Place) -> float:
        pull_a = force_at(m, i_a, place[0], place[1])
        return pull_a - force_at(m, i_b, place[2], place[3])

    def coenergy(m: Curves, i_a: float, i_b: float, place: Place) -> float:
        row, column = (i_a - m.low_current) * m.per_current, (i_b - m.low_current) * m.per_current
        return trilinear(m.force, row, column, place[0], place[1])

    return coenergy if _is_map(m) else pole


@overload(linked_flux)
def _linked_flux(
    m: Curves, coil: int, own: float, other: float, x: float
) -> Callable[..., object]:
    def pole(m: Curves, coil: int, own: float, other: float, x: float) -> float:
        return coil_flux(m, own, other, x if coil == 0 else -x)

    def coenergy(m: Curves, coil: int, own: float, other: float, x: float) -> float:
        return flux_in(m, m.current_a if coil == 0 else m.current_b, own, other, x)

    return coenergy if _is_map(m) else pole


@njit(cache=True)
def force_of(m: Curves, i_a: float, i_b: float, x: float) -> float:
    """Return F_s(i_A, i_B, x) towards positive x [N].

    Parameters
    ----------
    m : MapTables or CoenergyTables
        Curves.
    i_a, i_b : float
        Currents [A].
    x : float
        Position [m].
    """
    return float(static_force(m, i_a, i_b, locate(m, x)))


@njit(cache=True)
def flux_of(m: Curves, coil: int, own: float, other: float, x: float) -> float:
    """Return the flux linkage of a coil [Wb].

    Parameters
    ----------
    m : MapTables or CoenergyTables
        Curves.
    coil : int
        0 = A, 1 = B.
    own, other : float
        Its current and that of the other coil [A].
    x : float
        Position, positive towards A [m].
    """
    return float(linked_flux(m, coil, own, other, x))
