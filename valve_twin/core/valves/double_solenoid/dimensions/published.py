# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Names of what is told of the dimensions of a designed solenoid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from valve_twin.core.types import Parameter

if TYPE_CHECKING:
    from collections.abc import Sequence

ESTIMATOR = "dimensions"
"""Name under which the dimensions are stored and published."""

CYCLE, FIRST, DRIFT = "cycle.", "first.", "drift."
"""What names of parameters begin with: of this cycle, mean of the first ones, named change."""

COMPANIONS = ("force_gain", "friction", "spring")
"""What is fitted to the motion beside the dimensions: [1], [N], change of the preload of spring 1
less that of spring 2 [N]."""

DIMENSIONS = {
    "gap_a": "working gap A wider, share of it",
    "gap_b": "as gap_a, side B",
    "rim_a": "rim of pole A worn off, share of its length",
    "rim_b": "as rim_a, side B",
    "turns_a": "turns of coil A shorted, share of them",
    "turns_b": "as turns_a, coil B",
    "steel": "steel magnetically aged: field strengths of its knee higher by this share",
}
"""What the map of a design tells of."""

FORCE_GAIN = "force_gain"
"""Cause that is no dimension: oil, place of the armature in its tube."""


@dataclass(frozen=True, slots=True)
class Cause:
    """What could have changed: a place among the fitted values, and its direction.

    Attributes
    ----------
    name, text : str
        Name and what it is.
    place : int
        Place among the values of a fit.
    sign : float
        1 = it can only rise, -1 = only fall, 0 = either.
    """

    name: str
    text: str
    place: int
    sign: float


def causes_of(names: Sequence[str]) -> tuple[Cause, ...]:
    """Return what can have changed.

    Parameters
    ----------
    names : sequence of str
        Dimensions, in the order of the fit.
    """
    first = len(COMPANIONS)
    return (
        *(Cause(n, DIMENSIONS[n], first + k, 1.0) for k, n in enumerate(names)),
        Cause("spring_1", "spring 1 set: less preload [N]", COMPANIONS.index("spring"), -1.0),
        Cause("spring_2", "spring 2 set: less preload [N]", COMPANIONS.index("spring"), 1.0),
        Cause(
            FORCE_GAIN, "all magnetic force, flux as before", COMPANIONS.index("force_gain"), 0.0
        ),
    )


_CAUSES = causes_of(tuple(DIMENSIONS))
UNITS = {"friction": "N", "spring": "N", "spring_1": "N", "spring_2": "N"}
TOLD = {c.name: c.text for c in _CAUSES}
_FITTED = (*COMPANIONS, *DIMENSIONS)

PUBLISHED = (
    *(
        Parameter(f"{prefix}{n}", UNITS.get(n, "1"), f"{text}: {n}, all fitted together")
        for prefix, text in ((CYCLE, "of this cycle"), (FIRST, "mean of the first cycles"))
        for n in _FITTED
    ),
    *(
        Parameter(f"{DRIFT}{c.name}", UNITS.get(c.name, "1"), f"since the first cycles: {c.text}")
        for c in _CAUSES
    ),
)
"""What the estimator may publish."""
