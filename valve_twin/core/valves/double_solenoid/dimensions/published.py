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

FIRST_CYCLE = f"{FIRST}cycle"
"""First of the cycles that everything is compared with."""

COMPANIONS = ("force_gain", "friction", "spring", "supply")
"""What is fitted beside the dimensions: [1], [N], change of the preload of spring 1 less that of
spring 2 [N], all to the motion; share by which the supply is above that of the options [1]."""

FREE = ("friction", "supply")
"""Companions that may change without a cause: they have trends and causes of their own."""

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
    Parameter(FIRST_CYCLE, "1", "number of the first cycle that everything is compared with"),
    *(
        Parameter(f"{DRIFT}{c.name}", UNITS.get(c.name, "1"), f"since the first cycles: {c.text}")
        for c in _CAUSES
    ),
)
"""What the estimator may publish."""
