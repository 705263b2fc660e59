# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When a change of the features is a fault."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DetectionConfig:
    """When a change is a fault; lengths in cycles.

    Attributes
    ----------
    learn : int
        Cycles whose scatter is the valve's own, without the newest that are judged.
    least : int
        Fewest cycles of a line.
    window : int
        Most cycles of a line.
    recent : int
        Most cycles that are compared with the line at a time.
    confirm : int
        Cycles of those compared that must each show the change.
    threshold : float
        Ratio above which it is a fault: squared standard deviations [1].
    each : float
        Standard deviations by which each of the `confirm` cycles must show it [1].
    isolate : int
        Cycles behind that of the onset that name the fault.
    heal : int
        Cycles without it after which it is over.
    extrapolate : int
        Cycles since the alarm for which the line before it is a measure; what lasts longer lasts
        until maintenance.
    outlier : float
        Distance from the five cycles before at which a single cycle is left out of the lines [1].
    trust : float
        Cycles that the table's correlations count as.
    margin : float
        Factor on the own standard deviations: they come from few cycles [1].
    like : float
        Share of the change that its signature explains, below which it is unknown [1], if also
    excess : float
        chi-square over its expectation is above this [1].
    """

    learn: int = 40
    least: int = 20
    window: int = 40
    recent: int = 8
    confirm: int = 2
    threshold: float = 32.0
    each: float = 2.5
    isolate: int = 5
    heal: int = 5
    extrapolate: int = 100
    outlier: float = 8.0
    trust: float = 60.0
    margin: float = 1.1
    like: float = 0.4
    excess: float = 3.0
