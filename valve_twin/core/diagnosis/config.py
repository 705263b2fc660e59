# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When a change of the features is a fault."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from valve_twin.core.quantity import check_quantities, quantity

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.features import FeatureSet


@dataclass(frozen=True, slots=True)
class DetectionConfig:
    """When a change is a fault; lengths in cycles, distances in standard deviations."""

    learn: int = quantity(
        40, "1", "Cycles whose scatter is the valve's own, without the newest judged.", lower=1
    )
    least: int = quantity(8, "1", "Fewest cycles of a line.", lower=2)
    window: int = quantity(40, "1", "Most cycles of a line.", lower=2)
    recent: int = quantity(
        8, "1", "Most cycles that are compared with the line at a time.", lower=1
    )
    confirm: int = quantity(
        2, "1", "Cycles of those compared that must each show the change.", lower=1
    )
    threshold: float = quantity(
        32.0, "1", "Ratio above which it is a fault: squared standard deviations.", lower=0.0
    )
    each: float = quantity(
        2.5, "1", "Distance by which each of the `confirm` cycles must show it.", lower=0.0
    )
    alone: float = quantity(
        0.0,
        "1",
        "Chance with which a healthy cycle may be beyond what raises an alarm by itself; 0: none "
        "does.",
        lower=0.0,
        upper=0.01,
    )
    beyond: float = quantity(
        0.0,
        "1",
        "Factor on how far off some cycles must each lie that are all beyond any before; 0: this "
        "raises no alarm.",
        lower=0.0,
    )
    young: int = quantity(
        0,
        "1",
        "Cycles before which a likelihood ratio raises no alarm: how the valve scatters is not "
        "known.",
        lower=0,
    )
    departs: float = quantity(
        4.0,
        "1",
        "Distance from the line before at which the newest cycle is not ok before one more came; "
        "0: no matter how far.",
        lower=0.0,
    )
    settled: int = quantity(
        20,
        "1",
        "Cycles of a product from which on nothing found means that nothing changed.",
        lower=2,
    )
    isolate: int = quantity(
        5, "1", "Cycles behind that of the onset that name the fault.", lower=1
    )
    heal: int = quantity(5, "1", "Cycles without it after which it is over.", lower=1)
    extrapolate: int = quantity(
        100,
        "1",
        "Cycles since the alarm for which the line before it is a measure; what lasts longer "
        "lasts until maintenance.",
        lower=1,
    )
    outlier: float = quantity(
        8.0,
        "1",
        "Distance from the five cycles before at which a cycle is left out of the lines.",
        lower=0.0,
    )
    trust: float = quantity(60.0, "1", "Cycles that the table's correlations count as.", lower=0.0)
    apart: float = quantity(
        0.0,
        "1",
        "Share of the scatter beyond the table's that has correlations of its own: 0 = those of "
        "the table hold for all of it, 1 = for what is noise alone.",
        lower=0.0,
        upper=1.0,
    )
    margin: float = quantity(
        1.1, "1", "Factor on the own standard deviations: they come from few cycles.", lower=1.0
    )
    quiet: float = quantity(
        1.0,
        "1",
        "Least standard deviation of a feature, in that of the table: a run of one sample more "
        "changes what no noise hides.",
        lower=0.0,
    )
    like: float = quantity(
        0.4,
        "1",
        "Share of the change that its signature explains, below which it is unknown if also "
        "`excess` is passed.",
        lower=0.0,
        upper=1.0,
    )
    unlike: float = quantity(
        0.3,
        "1",
        "Share of a change by which a valve may differ from the signature of the simulated one.",
        lower=0.0,
    )
    varies: float = quantity(
        0.0,
        "1",
        "Share of a change by which the same fault shows more or less from cycle to cycle.",
        lower=0.0,
    )
    excess: float = quantity(
        3.0, "1", "chi-square over its expectation above which it is unknown.", lower=0.0
    )

    def __post_init__(self) -> None:
        """Refuse a number outside its range."""
        check_quantities(self)


OF_A_MODEL = DetectionConfig()
"""For features that a model has of its own."""

OF_ANY_VALVE = DetectionConfig(alone=1e-4, beyond=1.0, young=20, departs=0.0, varies=0.25)
"""For features of any valve."""

BY_A_MODEL = replace(OF_ANY_VALVE, apart=1.0, beyond=0.0, young=0)
"""For those whose signatures are what the model sees: cycles scatter by what it does not know."""


def detection_of(features: FeatureSet) -> DetectionConfig:
    """Return when to speak of the features of a valve.

    Parameters
    ----------
    features : FeatureSet
        Which they are.
    """
    if not features.of_any_valve:
        return OF_A_MODEL
    return BY_A_MODEL if features.by_model else OF_ANY_VALVE
