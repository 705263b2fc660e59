# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the aging monitor follows, against which reference, and when it raises its voice."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import Enum
from typing import TypeVar

import numpy as np

_Number = TypeVar("_Number", int, float)


def _limited(default: _Number, *, lower: float, upper: float = np.inf, unit: str = "1") -> _Number:
    """Return a field with the limits that a configuration must keep and its unit."""
    metadata: dict[str, object] = {"lower": lower, "upper": upper, "unit": unit}
    made: _Number = field(default=default, metadata=metadata)
    return made


class Axis(Enum):
    """What aging is counted in."""

    CYCLES = "cycles"
    COUNTER = "counter"
    HOURS = "hours"


def parse_bin(text: str) -> tuple[str, float]:
    """Return name and width of a binned condition, written as "load 500".

    Raises
    ------
    ValueError
        If it is written otherwise.
    """
    name, _, width = text.strip().partition(" ")
    try:
        size = float(width)
    except ValueError:
        size = np.nan
    if not (name and np.isfinite(size) and size > 0.0):
        msg = f'binned is "{text}": write a condition and the width of its bins, e.g. "load 500"'
        raise ValueError(msg)
    return name, size


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

    Attributes
    ----------
    parameter : str
        Name of the parameter.
    value : float
        The level when new [unit of the parameter].
    standard_error : float
        Its standard error, 0 = exact [unit of the parameter].
    """

    parameter: str
    value: float
    standard_error: float = 0.0


@dataclass(frozen=True, slots=True)
class AgingConfig:
    """Rules of the aging monitor; every default is our assumption unless a source is named.

    Numbers are dimensionless where no unit is named.

    Attributes
    ----------
    label : str
        What the cycles differ in where their order is not aging, such as "by load at equal stroke,
        not aging"; trends carry it, and no verdict is given. Empty = aging.
    axis : Axis
        What aging is counted in: cycles seen (and known to be missed), the cycle counter, or
        hours of data time.
    parameters : tuple of str
        Parameters to follow; empty = all whose `Parameter.trend` is set.
    thresholds : tuple of Threshold
        Service limits; several for one parameter are allowed (say one below and one above), the
        one expected to be reached first is reported.
    default_percent : float
        Limits at minus and plus this change for a parameter without an entry in `thresholds`;
        0 = none. 20 is the limit of the remaining-life study in docs/developers/equations.md 2.5.
    commissioning : tuple of Commissioning
        Reference levels on record. A maintenance event with `new_reference` replaces them.
    reference_cycles : int
        Accepted estimates whose mean is the reference where no record is given.
    significance : float
        Error probability of the word "drifting" for one parameter at one time.
    min_samples : int
        Accepted estimates that the present segment needs before it is judged.
    min_segment : int
        Least number of estimates in a segment that is found (not forced). A change is
        reported this many cycles after it happened at the earliest; fewer would let a few bad
        estimates look like a change.
    max_segments : int
        Most segments between two maintenance events.
    max_candidates : int
        Places tried for a change between two maintenance events; up to this many estimates
        every place is tried (exact), above it every g-th, g = ceil(samples / max_candidates), and
        the places found are then refined.
    penalty_scale : float
        Factor on the calibrated penalty of a segment; larger finds fewer.
    outlier_sigma : float
        An estimate farther than this from its neighbours [robust standard deviations] is left
        out.
    window : int
        Newest accepted estimates that are segmented; 0 = the whole history. The reference is
        always taken from the whole history.
    rate_cycles : int
        Newest accepted estimates that give the cycle rate.
    alert_fraction : float
        Share of the way from reference to threshold that raises the verdict when it is
        exceeded with 95 % confidence.
    horizon : float
        Remaining life below which the verdict is raised, if the slope is beyond doubt
        and the drift has covered half of `alert_fraction`.
    verdict_significance : float
        Error probability of "beyond doubt"; stricter than `significance`, because every cycle
        tests anew.
    covariates : tuple of str
        Conditions whose linear effect is taken out of every parameter before its trend is judged,
        such as stroke, supply_pressure, load or temperature; or a parameter that the estimate
        publishes. The effect and its doubt stand in the trend's reason.
    binned : tuple of str
        Conditions, each with the width of a bin behind it ("load 500"), whose effect need not be
        linear: every bin gets a level of its own.
    """

    label: str = ""
    axis: Axis = Axis.CYCLES
    parameters: tuple[str, ...] = ()
    thresholds: tuple[Threshold, ...] = ()
    default_percent: float = _limited(20.0, lower=0.0, unit="%")
    commissioning: tuple[Commissioning, ...] = ()
    reference_cycles: int = _limited(10, lower=2)
    significance: float = _limited(0.05, lower=1e-9, upper=1.0)
    min_samples: int = _limited(10, lower=4)
    min_segment: int = _limited(8, lower=4)
    max_segments: int = _limited(12, lower=1, upper=100)
    max_candidates: int = _limited(500, lower=20, upper=4000)
    penalty_scale: float = _limited(1.0, lower=0.0)
    outlier_sigma: float = _limited(4.5, lower=2.0)
    window: int = _limited(0, lower=0)
    rate_cycles: int = _limited(50, lower=2)
    alert_fraction: float = _limited(0.5, lower=0.01, upper=1.0)
    horizon: float = _limited(50.0, lower=0.0, unit="axis unit")
    verdict_significance: float = _limited(0.001, lower=1e-9, upper=1.0)
    covariates: tuple[str, ...] = ()
    binned: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse values that cannot work.

        Raises
        ------
        ValueError
            With the name of the field, its value and what it must be.
        """
        for item in fields(self):
            value, lower = getattr(self, item.name), item.metadata.get("lower")
            upper = item.metadata.get("upper", np.inf)
            if lower is not None and not lower <= value <= upper:
                upto = f" and at most {upper:g}" if upper < np.inf else ""
                msg = f"{item.name} is {value}, it must be at least {lower:g}{upto}"
                raise ValueError(msg)
        for text in self.binned:
            parse_bin(text)
        for record in self.commissioning:
            if not (np.isfinite(record.value) and record.standard_error >= 0.0):
                msg = (
                    f"the commissioning record of {record.parameter} is {record.value} "
                    f"with standard error {record.standard_error}; "
                    "both must be finite numbers, the error not negative"
                )
                raise ValueError(msg)
