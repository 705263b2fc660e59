# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the aging monitor follows, against which reference, and when it raises its voice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities, needed, quantity, records, setting

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.given.reference import FeatureReference


class Axis(Enum):
    """What aging is counted in."""

    CYCLES = "cycles"
    COUNTER = "counter"
    HOURS = "hours"


class Law(Enum):
    """How a parameter changes with use (`core.aging.laws.shapes`)."""

    LINE = "line"
    EXPONENTIAL = "exponential"
    POWER = "power"
    SATURATING = "saturating"


LAWS = tuple(law.value for law in Law)
"""Names of the laws, in their order."""


def parse_stop(text: str) -> tuple[float, int]:
    """Return what `next_stop` says: axis units ahead, or NaN and a date [ns]; NaN and 0 = none.

    Raises
    ------
    ValueError
        If it is neither a number above 0 nor a date.
    """
    if not text.strip():
        return float("nan"), 0
    try:
        ahead = float(text)
    except ValueError:
        ahead = float("nan")
    if np.isfinite(ahead) and ahead > 0.0:
        return ahead, 0
    try:
        date: np.datetime64 = np.datetime64(text.strip().removesuffix("Z"), "s")
    except ValueError:
        date = np.datetime64("NaT")
    if np.isnat(date) or not text.strip()[:4].isdigit():
        msg = (
            f'next_stop is "{text}": write how many cycles (or hours) ahead, such as 200, or a '
            "date, such as 2026-12-24 or 2026-12-24T06:00"
        )
        raise ValueError(msg)
    return float("nan"), int(date.astype(np.int64)) * 10**9


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
    """A service limit of one parameter."""

    parameter: str
    value: float = needed(
        "",
        "Change against the reference [% of it] where `relative`, else the limit "
        "itself [unit of the parameter]. NaN: this parameter has no limit.",
    )
    relative: bool = setting(
        default=True, text="Whether `value` is a change against the reference."
    )
    warning: float = assumed(
        0.0,
        "1",
        "Share of the way from the reference to the limit at which the warning limit lies; "
        "0: `aging.alert_fraction`.",
        0.0,
        1.0,
    )
    either_way: bool = setting(
        default=False,
        text="Whether a change the other way is one, too: limits at minus and plus `value`; "
        "for relative limits only.",
    )

    def sides(self) -> tuple[Threshold, ...]:
        """Return the limit, or the lower and the upper one where it stands either way."""
        if not self.either_way:
            return (self,)
        size = abs(self.value)
        return tuple(replace(self, value=v, either_way=False) for v in (-size, size))


@dataclass(frozen=True, slots=True)
class Commissioning:
    """A reference level that was recorded when the valve was commissioned."""

    parameter: str
    value: float = needed("unit of the parameter", "The level when new.")
    standard_error: float = quantity(
        0.0, "unit of the parameter", "Its standard error, 0 = exact."
    )


@dataclass(frozen=True, slots=True)
class AgingConfig:
    """Rules of the aging monitor; `reference` is what was read of `feature_reference`."""

    label: str = setting(
        "",
        "What the cycles differ in where their order is not aging, such as "
        '"by load at equal stroke, not aging"; trends carry it, and no verdict is given. '
        "Empty = aging.",
    )
    axis: Axis = setting(
        Axis.CYCLES,
        "What aging is counted in: cycles seen (and known to be missed), the cycle "
        "counter, or hours of data time.",
    )
    parameters: tuple[str, ...] = setting(
        (), "Parameters to follow; empty = all whose `Parameter.trend` is set."
    )
    thresholds: tuple[Threshold, ...] = records(Threshold)
    default_percent: float = quantity(
        20.0,
        "%",
        "Limits at minus and plus this change for a parameter without an entry in "
        "`thresholds`; 0 = none. 20 is the limit of the remaining-life study in "
        "docs/developers/equations.md 2.5.",
        lower=0.0,
    )
    commissioning: tuple[Commissioning, ...] = records(Commissioning)
    feature_reference: str = setting(
        "",
        "File of a stored reference (`valve-twin reference`) that the features of the first "
        "cycles are held against, so that a fault that begins in them is told. Empty = none.",
    )
    reference: FeatureReference | None = None
    reference_cycles: int = assumed(
        10,
        "1",
        "Accepted estimates whose mean is the reference where no record is given.",
        lower=2,
    )
    significance: float = assumed(
        0.05,
        "1",
        'Error probability of the word "drifting" for one parameter at one time.',
        1e-09,
        1.0,
    )
    min_samples: int = assumed(
        10, "1", "Accepted estimates that the present segment needs before it is judged.", lower=4
    )
    min_segment: int = assumed(
        8,
        "1",
        "Least number of estimates in a segment that is found (not forced). A change "
        "is reported this many cycles after it happened at the earliest; fewer would "
        "let a few bad estimates look like a change.",
        lower=4,
    )
    max_segments: int = assumed(12, "1", "Most segments between two maintenance events.", 1, 100)
    max_candidates: int = assumed(
        500,
        "1",
        "Places tried for a change between two maintenance events; up to this many "
        "estimates every place is tried (exact), above it every g-th, g = "
        "ceil(samples / max_candidates), and the places found are then refined.",
        20,
        4000,
    )
    penalty_scale: float = quantity(
        1.0, "1", "Factor on the calibrated penalty of a segment; larger finds fewer.", lower=0.0
    )
    outlier_sigma: float = assumed(
        4.5,
        "1",
        "An estimate farther than this from its neighbours [robust standard "
        "deviations] is left out.",
        lower=2.0,
    )
    window: int = quantity(
        0,
        "1",
        "Newest accepted estimates that are segmented; 0 = the whole history. The "
        "reference is always taken from the whole history.",
        lower=0,
    )
    laws: tuple[str, ...] = setting(
        (),
        "Laws of aging that the forecast may follow: line, exponential, power, saturating; "
        "empty = all. They are averaged over by their evidence.",
        choices=LAWS,
    )
    next_stop: str = setting(
        "",
        "When the plant stops next: so many axis units ahead (200), or a date (2026-12-24, "
        "2026-12-24T06:00, UTC). Every trend then has the probability that its limit is "
        "reached before. Empty = not asked.",
    )
    rate_cycles: int = assumed(
        50, "1", "Newest accepted estimates that give the cycle rate.", lower=2
    )
    alert_fraction: float = assumed(
        0.5,
        "1",
        "Share of the way from reference to threshold at which the warning limit lies: the "
        "verdict is raised where it is exceeded beyond doubt (`verdict_significance`).",
        0.01,
        1.0,
    )
    hysteresis: float = assumed(
        0.1,
        "1",
        "Share of the way from reference to threshold by which a level must come back within the "
        "warning limit, or the threshold, before it counts as within again.",
        0.0,
        1.0,
    )
    horizon: float = assumed(
        50.0,
        "axis unit",
        "Remaining life below which the verdict is raised, if the slope is beyond "
        "doubt and the drift has covered half of `alert_fraction`.",
        lower=0.0,
    )
    verdict_significance: float = assumed(
        0.001,
        "1",
        'Error probability of "beyond doubt"; stricter than `significance`, because every '
        "cycle tests anew.",
        1e-09,
        1.0,
    )
    stroke_test_days: float = quantity(
        0.0,
        "d",
        "Most days between two stroke tests (`valve-twin stroke-test --url`): report and fleet "
        "then say when the next one is due. 0 = not asked.",
        lower=0.0,
    )
    covariates: tuple[str, ...] = setting(
        (),
        "Conditions whose linear effect is taken out of every parameter before its "
        "trend is judged, such as stroke, supply_pressure, load or temperature; or a "
        "parameter that the estimate publishes. The effect and its doubt stand in the"
        " trend's reason.",
    )
    binned: tuple[str, ...] = setting(
        (),
        'Conditions, each with the width of a bin behind it ("load 500"), whose effect need '
        "not be linear: every bin gets a level of its own.",
    )

    def warning_share(self, threshold: Threshold) -> float:
        """Return where on the way to a threshold its warning limit lies [1]."""
        return threshold.warning or self.alert_fraction

    def __post_init__(self) -> None:
        """Refuse values that cannot work.

        Raises
        ------
        ValueError
            With the name of the field, its value and what it must be.
        """
        check_quantities(self)
        for text in self.binned:
            parse_bin(text)
        parse_stop(self.next_stop)
        for limit in self.thresholds:
            if limit.either_way and not limit.relative:
                msg = (
                    f"the limit of {limit.parameter} is absolute and either_way; a limit has "
                    "two sides only where it is a change: write relative: true"
                )
                raise ValueError(msg)
        for record in self.commissioning:
            if not (np.isfinite(record.value) and record.standard_error >= 0.0):
                msg = (
                    f"the commissioning record of {record.parameter} is {record.value} "
                    f"with standard error {record.standard_error}; "
                    "both must be finite numbers, the error not negative"
                )
                raise ValueError(msg)
