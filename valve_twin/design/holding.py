# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Static force of a pole with coil and magnet: over m.m.f. and gap, and over every dimension."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import describe, suggest
from valve_twin.design.field import make_model, solve_field
from valve_twin.design.field.tangent import Tangent

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.design.geometry.hybrid_pole import HybridPole

TURNS = (0.0, 500.0, 1000.0, 1500.0)
"""M.m.f. of paper 001's static tests [A]."""

GAPS = (0.5e-3, 1e-3, 2e-3, 3e-3, 4e-3)
"""Among those of its tests, 0.5 to 4 mm [m]."""

NEAR, FAR = 0.5e-3, 4e-3
"""Gaps at which it prints forces [m]."""

PUBLISHED: Mapping[tuple[float, float], float] = {
    (NEAR, 0.0): 128.0,
    (FAR, 0.0): 8.7,
    (NEAR, 500.0): 423.5,
    (NEAR, 1000.0): 611.0,
    (NEAR, 1500.0): 730.5,
}
"""Measured forces by gap [m] and m.m.f. [A], paper 001, section 4.3.3 [N]."""

SHARE = 0.1
"""Usual change of a dimension [1]."""


@dataclass(frozen=True, slots=True)
class Change:
    """What the paper says that more of a dimension does to the holding force.

    Attributes
    ----------
    by : float
        By how much it grew, from where is not printed [m]; 0 = not printed.
    effect : float
        Change of the force [1].
    """

    by: float
    effect: float


STUDIED: Mapping[str, Change] = {
    "armature_width": Change(7e-3, 0.7375),
    "armature_thickness": Change(3e-3, 0.4543),
    "magnet_height": Change(40e-3, 0.9629),
    "magnet_thickness": Change(4e-3, 0.6136),
    "yoke_height": Change(13.5e-3, 0.0952),
    "yoke_width": Change(4e-3, 0.0051),
    "base_width": Change(12e-3, 0.0882),
    "base_thickness": Change(3e-3, 0.0245),
    "cover_width": Change(8.5e-3, 0.5229),
    "cover_thickness": Change(7e-3, 0.2152),
    "gap_1": Change(0.0, 0.663),
    "gap_2": Change(0.0, -0.0488),
    "gap_3": Change(0.0, -0.1255),
    "gap_4": Change(0.0, -0.0304),
}
"""The dimensions of section 3.3 with its statements; 12 mm and 3 mm of the base plate are read as
width and thickness, in the order in which the chosen values are printed."""

UNPRINTED = ("hole", "core", "base_from", "shoe", "magnet.remanence")
"""Numbers that the paper leaves out; their effect is told beside."""

ZERO_STEP = 0.1e-3
"""Change of a dimension that is 0 [m]."""


@dataclass(frozen=True, slots=True)
class Effect:
    """Forces at the near gap with one number changed alone.

    Attributes
    ----------
    name : str
        The number.
    values : tuple of float
        The lower and the higher value [its unit].
    forces : (2, M) array
        At both, over the m.m.f.; NaN = the parts do not fit [N].
    error : str
        Why a force is missing; empty = none is.
    """

    name: str
    values: tuple[float, float]
    forces: FloatArray
    error: str = ""


def holding_forces(
    pole: HybridPole, gap: float, turns: Sequence[float] = TURNS, fine: float = 1.0
) -> FloatArray:
    """Return forces towards the pole (M,) at a gap [N].

    Parameters
    ----------
    pole : HybridPole
        The geometry.
    gap : float
        Working gap [m].
    turns : sequence of float
        M.m.f. of the coil (M,) [A].
    fine : float
        Elements along a line over those of the default mesh [1].

    Raises
    ------
    ValueError
        If the parts do not fit, or no field is found.
    """
    model, start, found = make_model(replace(pole, gap=gap).section(), fine), None, []
    tangent = Tangent(model)
    for current in turns:
        field = solve_field(model, [current], start=start, tangent=tangent)
        start = field.potential
        found.append(-field.force)
    return np.array(found)


def value_of(pole: HybridPole, name: str) -> float:
    """Return a number of the pole by its dotted name [its unit]."""
    owner, _, inner = name.rpartition(".")
    return float(getattr(getattr(pole, owner) if owner else pole, inner))


def changed(pole: HybridPole, name: str, value: float) -> HybridPole:
    """Return the pole with another number.

    Parameters
    ----------
    pole : HybridPole
        The geometry.
    name : str
        Dotted name of the number.
    value : float
        What it is to be [its unit].

    Raises
    ------
    ValueError
        If it is outside its range.
    """
    owner, _, inner = name.rpartition(".")
    if owner:
        return replace(pole, **{owner: replace(getattr(pole, owner), **{inner: value})})
    return replace(pole, **{inner: value})  # type: ignore[arg-type]


def one_dimension(
    pole: HybridPole,
    name: str,
    share: float = SHARE,
    turns: Sequence[float] = TURNS,
    fine: float = 1.0,
) -> Effect:
    """Change one number alone, down and up.

    Parameters
    ----------
    pole : HybridPole
        The geometry.
    name : str
        Of the number; one that is 0 goes up by `ZERO_STEP` only.
    share : float
        Change to either side [1].
    turns : sequence of float
        M.m.f. of the coil [A].
    fine : float
        As of `holding_forces` [1].
    """
    own = value_of(pole, name)
    low, high = ((1.0 - share) * own, (1.0 + share) * own) if own else (0.0, ZERO_STEP)
    forces, error = np.full((2, len(turns)), np.nan), ""
    for k, value in enumerate((low, high)):
        try:
            forces[k] = holding_forces(changed(pole, name, value), NEAR, turns, fine)
        except ValueError as err:
            error = str(err)
    return Effect(name, (low, high), forces, error)


def study(
    pole: HybridPole,
    names: Sequence[str],
    share: float = SHARE,
    fine: float = 1.0,
    advance: Callable[[], None] = lambda: None,
) -> tuple[Effect, ...]:
    """Change every number alone.

    Parameters
    ----------
    pole : HybridPole
        The geometry.
    names : sequence of str
        Numbers.
    share, fine : float
        As of `one_dimension` [1].
    advance : callable
        Called once a number.

    Raises
    ------
    ValueError
        If there is no such number; the gap is none, forces are told at `NEAR`.
    """
    known = [item.name for item in describe(pole)
             if isinstance(item.default, float) and item.name != "gap"]  # fmt: skip
    for name in names:
        if name not in known:
            message = f"'{name}' is no number of the pole; {suggest(name, known)}"
            raise ValueError(message)
    found = []
    for name in names:
        found.append(one_dimension(pole, name, share, fine=fine))
        advance()
    return tuple(found)
