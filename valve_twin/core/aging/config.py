# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the aging monitor follows, against which reference, and when it raises its voice."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np


class Axis(Enum):
    """What aging is counted in."""

    CYCLES = "cycles"
    COUNTER = "counter"
    HOURS = "hours"


@dataclass(frozen=True, slots=True)
class Threshold:
    """A service limit of one parameter.

    Attributes
    ----------
    parameter : str
        Name of the parameter.
    value : float
        Change against the reference [% of it] where `relative`, else the limit itself [unit of
        the parameter]. NaN: this parameter has no limit.
    relative : bool
        Whether `value` is a change against the reference.
    """

    parameter: str
    value: float
    relative: bool = True


@dataclass(frozen=True, slots=True)
class Commissioning:
    """A reference level that was recorded when the valve was commissioned.

    `value` and its `standard_error` (0 = exact) carry the unit of the parameter.
    """

    parameter: str
    value: float
    standard_error: float = 0.0


@dataclass(frozen=True, slots=True)
class AgingConfig:
    """Rules of the aging monitor; every default is our assumption unless a source is named.

    Attributes
    ----------
    axis : Axis
        What aging is counted in: cycles seen (and known to be missed), the cycle counter, or
        hours of data time.
    parameters : tuple of str
        Parameters to follow; empty = all whose `Parameter.trend` is set.
    thresholds : tuple of Threshold
        Service limits; several for one parameter are allowed (say one below and one above), the
        one expected to be reached first is reported.
    default_percent : float
        Limits at minus and plus this change [%] for a parameter without an entry in `thresholds`;
        0 = none. 20 is the limit of the remaining-life study in equations.md 2.5.
    commissioning : tuple of Commissioning
        Reference levels on record. A maintenance event with `new_reference` replaces them.
    reference_cycles : int
        Accepted estimates whose mean is the reference where no record is given [1].
    significance : float
        Error probability of the word "drifting" for one parameter at one time [1].
    min_samples : int
        Accepted estimates that the present segment needs before it is judged [1].
    min_segment : int
        Least number of estimates in a segment that is found (not forced) [1]. A change is
        reported this many cycles after it happened at the earliest; fewer would let a few bad
        estimates look like a change.
    max_segments : int
        Most segments between two maintenance events [1].
    max_candidates : int
        Places tried for a change between two maintenance events [1]; up to this many estimates
        every place is tried (exact), above it every g-th, g = ceil(samples / max_candidates), and
        the places found are then refined.
    penalty_scale : float
        Factor on the calibrated price of a segment [1]; larger finds fewer.
    outlier_sigma : float
        An estimate farther than this from its neighbours [robust standard deviations] is left
        out.
    window : int
        Newest accepted estimates that are segmented [1]; 0 = the whole history. The reference is
        always taken from the whole history.
    rate_cycles : int
        Newest accepted estimates that give the cycle rate [1].
    alert_fraction : float
        Share of the way from reference to threshold [1] that raises the verdict when it is
        exceeded with 95 % confidence.
    horizon : float
        Remaining life [axis unit] below which the verdict is raised, if the slope is beyond doubt
        and the drift has covered half of `alert_fraction`.
    verdict_significance : float
        Error probability of "beyond doubt" [1]; stricter than `significance`, because every cycle
        tests anew.
    """

    axis: Axis = Axis.CYCLES
    parameters: tuple[str, ...] = ()
    thresholds: tuple[Threshold, ...] = ()
    default_percent: float = 20.0
    commissioning: tuple[Commissioning, ...] = ()
    reference_cycles: int = 10
    significance: float = 0.05
    min_samples: int = 10
    min_segment: int = 8
    max_segments: int = 12
    max_candidates: int = 500
    penalty_scale: float = 1.0
    outlier_sigma: float = 4.5
    window: int = 0
    rate_cycles: int = 50
    alert_fraction: float = 0.5
    horizon: float = 50.0
    verdict_significance: float = 0.001

    def __post_init__(self) -> None:
        """Refuse values that cannot work.

        Raises
        ------
        ValueError
            With the name of the field, its value and what it must be.
        """
        for name, least in _LEAST.items():
            value = getattr(self, name)
            if not value >= least:
                msg = f"aging: {name} is {value}, it must be at least {least}"
                raise ValueError(msg)
        for name in ("significance", "verdict_significance", "alert_fraction"):
            value = getattr(self, name)
            if not 0.0 < value <= 1.0:
                msg = f"aging: {name} is {value}, it must lie above 0 and not above 1"
                raise ValueError(msg)
        for record in self.commissioning:
            if not (np.isfinite(record.value) and record.standard_error >= 0.0):
                msg = (
                    f"aging: the commissioning record of {record.parameter} is {record.value} "
                    f"with standard error {record.standard_error}; "
                    "both must be finite numbers, the error not negative"
                )
                raise ValueError(msg)


_LEAST: dict[str, float] = {
    "default_percent": 0.0,
    "reference_cycles": 2,
    "min_samples": 4,
    "min_segment": 4,
    "max_segments": 1,
    "max_candidates": 20,
    "penalty_scale": 0.0,
    "outlier_sigma": 2.0,
    "window": 0,
    "rate_cycles": 2,
    "horizon": 0.0,
}
