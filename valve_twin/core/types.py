# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Value types shared by every room of the core: samples, frames, cycles, estimates and events.

Everything here is data. Stamps are integers in nanoseconds of the data's own clock (`*_ns`),
durations are seconds (`*_s`), positions are normalised to the stroke [1] and commands to full
scale [1] unless a signal says otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]


CONDITIONS = ("supply_pressure", "load", "temperature")
"""Signals under which a valve runs, none of which a model needs, in the order of their columns."""


class Validity(IntEnum):
    """What a prediction is worth; the numbers are those of Prediction.msg."""

    VALID = 0
    NO_MODEL = 1
    STARTING = 2
    AT_SEAT = 3
    STALE = 4
    BAD_INPUT = 5


class Restart(IntEnum):
    """What a predictor does before a sample.

    NEW_CYCLE starts the free run from the measured position and keeps the measured past; GAP (a
    gap or a jump of the clock lies before the sample) forgets the past; at BAD the sample is not
    valid and the past is held.
    """

    GO_ON = 0
    NEW_CYCLE = 1
    GAP = 2
    BAD = 3


class EstimateStatus(IntEnum):
    """Whether an estimate may be used; the numbers are those of Estimate.msg."""

    ACCEPTED = 0
    PARTIAL = 1
    REFUSED = 2


class ParameterStatus(IntEnum):
    """Whether one parameter of an estimate may be used; the numbers are those of Estimate.msg."""

    OK = 0
    AT_BOUND = 1
    NOT_EXCITED = 2
    REFUSED = 3


class CycleRule(Enum):
    """What cuts the stream into production cycles."""

    COMMANDS = "commands"
    COUNTER = "counter"
    REFERENCE = "reference"
    WINDOW = "window"


@dataclass(frozen=True, slots=True)
class Frames:
    """Position samples with the commands that were in force at their stamps.

    Attributes
    ----------
    stamp_ns : (N,) int64 array
        Acquisition time of each position sample, strictly increasing [ns].
    position : (N,) array
        Measured position, after scale and offset [1]; NaN where the input was not a finite number.
    inputs : (N, M) array
        Commands in the order of the model's `inputs`, held from the last sample at or before the
        stamp [1].
    counter : (N,) array
        Cycle counter, NaN where none is mapped.
    reference : (N,) array
        Position reference, NaN where none is mapped [1].
    valid : (N,) bool array
        False where a value was missing, not finite or outside its configured range.
    conditions : (N, 3) array, optional
        The signals `CONDITIONS`, held [unit as configured], NaN where one is not mapped or not
        believed; None where none is mapped.
    """

    stamp_ns: IntArray
    position: FloatArray
    inputs: FloatArray
    counter: FloatArray
    reference: FloatArray
    valid: BoolArray
    conditions: FloatArray | None = None

    def __len__(self) -> int:
        """Return the number of samples N."""
        return len(self.stamp_ns)

    def __getitem__(self, part: slice | BoolArray) -> Frames:
        """Return a contiguous part (views, no copies), or chosen samples."""
        return Frames(
            self.stamp_ns[part],
            self.position[part],
            self.inputs[part],
            self.counter[part],
            self.reference[part],
            self.valid[part],
            None if self.conditions is None else self.conditions[part],
        )


def join_frames(parts: list[Frames]) -> Frames:
    """Concatenate consecutive parts (at least one) in their order."""
    if len(parts) == 1:
        return parts[0]
    return Frames(
        np.concatenate([p.stamp_ns for p in parts]),
        np.concatenate([p.position for p in parts]),
        np.concatenate([p.inputs for p in parts]),
        np.concatenate([p.counter for p in parts]),
        np.concatenate([p.reference for p in parts]),
        np.concatenate([p.valid for p in parts]),
        _join_conditions(parts),
    )


def _join_conditions(parts: list[Frames]) -> FloatArray | None:
    if all(p.conditions is None for p in parts):
        return None
    return np.concatenate(
        [
            np.full((len(p), len(CONDITIONS)), np.nan) if p.conditions is None else p.conditions
            for p in parts
        ]
    )


class Origin(TypedDict):
    """The fields of an `Estimate` that come from its cycle."""

    cycle: int
    start_ns: int
    end_ns: int
    missed_cycles: int
    reproducible: bool


@dataclass(frozen=True, slots=True)
class Cycle:
    """One production cycle.

    Attributes
    ----------
    number : int
        Cycle number, counted on from the history or read from the counter topic.
    period_s : float
        Nominal sampling time of the position [s].
    frames : Frames
        The samples of the cycle.
    lost : int
        Position samples known to be missing inside the cycle (gaps over 1.5 periods).
    missed_cycles : int
        Cycles missed before this one; -1 = unknown.
    accepted : bool
        Whether the cycle is handed to estimation.
    reason : str
        Why it was accepted or refused, one line.
    reproducible : bool
        All inputs carried header stamps and none was lost.
    """

    number: int
    period_s: float
    frames: Frames
    lost: int = 0
    missed_cycles: int = 0
    accepted: bool = True
    reason: str = ""
    reproducible: bool = True

    @property
    def start_ns(self) -> int:
        """Stamp of the first sample [ns]."""
        return int(self.frames.stamp_ns[0])

    @property
    def end_ns(self) -> int:
        """Stamp of the last sample [ns]."""
        return int(self.frames.stamp_ns[-1])

    @property
    def origin(self) -> Origin:
        """What an `Estimate` of the cycle takes over from it."""
        return Origin(
            cycle=self.number,
            start_ns=self.start_ns,
            end_ns=self.end_ns,
            missed_cycles=self.missed_cycles,
            reproducible=self.reproducible,
        )


@dataclass(frozen=True, slots=True)
class Parameter:
    """What a published parameter is.

    Attributes
    ----------
    name, unit, description : str
        Name as published, SI unit ("1" = dimensionless), one line with the source.
    lower, upper : float
        Physical bounds, unit of the parameter; infinite where there is none.
    trend : bool
        Whether the aging monitor follows it by default.
    resolution : float
        What a fit leaves that does not average out over cycles [unit of the parameter]; the
        intervals of a drift are wider by it on both sides.
    """

    name: str
    unit: str
    description: str
    lower: float = -np.inf
    upper: float = np.inf
    trend: bool = False
    resolution: float = 0.0


@dataclass(frozen=True, slots=True)
class ParameterValue:
    """One parameter of one estimate.

    `value` is NaN where `status` is NOT_EXCITED or REFUSED; `standard_error`, `lower_95` and
    `upper_95` are NaN where they are not calibrated. Units as in the model's `Parameter` of the
    same name.
    """

    name: str
    value: float
    status: ParameterStatus = ParameterStatus.OK
    reason: str = ""
    standard_error: float = np.nan
    lower_95: float = np.nan
    upper_95: float = np.nan

    @property
    def usable(self) -> bool:
        """Whether a trend may use the value."""
        return self.status is ParameterStatus.OK


@dataclass(frozen=True, slots=True)
class MaskCounts:
    """How many samples a fit used and how many each mask took out."""

    used: int
    seat: int = 0
    stuck: int = 0
    stale: int = 0
    bad: int = 0


@dataclass(frozen=True, slots=True)
class Guard:
    """One check of an estimate: a value with a reason, whether it passed or not.

    Attributes
    ----------
    name : str
        What is checked, such as "identifiability" or "structure: level of v_in".
    passed : bool
        Whether the estimate stands the check.
    value, limit : float
        What was found and what is allowed [unit by check]; NaN = could not be told, no limit.
    reason : str
        The finding in one line.
    """

    name: str
    passed: bool
    value: float
    limit: float
    reason: str


@dataclass(frozen=True, slots=True)
class Condition:
    """Under what a cycle ran: name and value, such as the stroke [1]."""

    name: str
    value: float


@dataclass(frozen=True, slots=True)
class Disagreement:
    """How far two estimators of the same cycle lie apart in one parameter.

    Attributes
    ----------
    estimator : str
        The other estimator.
    parameter : str
        Name of the parameter that both publish.
    difference : float
        This estimate's value minus the other's [unit of the parameter].
    standard_errors : float
        The same in standard errors of the difference as if the two were independent [1]; they
        share the noise, so that beyond 2 is rare where both are right. NaN = not calibrated.
    """

    estimator: str
    parameter: str
    difference: float
    standard_errors: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """Parameters of one cycle by one estimator and what is known about them.

    Attributes
    ----------
    model, estimator : str
        Which valve model and which estimator.
    cycle : int
        Cycle number.
    start_ns, end_ns : int
        First and last stamp of the cycle [ns].
    parameters : tuple of ParameterValue
        In the fixed order of the estimator.
    status, reason : EstimateStatus, str
        Whether it may be used, and why in one line.
    mse_test, fit_test : float
        One-step mean squared error [1] and free-run fit [%] of the model in force before, on this
        cycle.
    mse_train, fit_train : float
        The same of this estimate on this cycle.
    condition_number : float
        Of the column-scaled regressor or sensitivity matrix [1].
    lag : int
        Command to position lag [samples].
    noise_sigma : float
        Position noise measured at rest [1]; NaN without rest.
    counts : MaskCounts
        Samples used and masked.
    missed_cycles : int
        Cycles missed before this one; -1 = unknown.
    used_by_trend : bool
        Whether this estimator feeds the trend.
    reproducible : bool
        All inputs had header stamps and none was lost: offline gives the same bits.
    trend_reason : str
        Which estimator feeds the trend and why, one line; empty where there is only one.
    disagreements : tuple of Disagreement
        Against the other estimators of the cycle.
    guards : tuple of Guard
        What was checked.
    conditions : tuple of Condition
        Under what the cycle ran.
    """

    model: str
    estimator: str
    cycle: int
    start_ns: int
    end_ns: int
    parameters: tuple[ParameterValue, ...]
    status: EstimateStatus
    reason: str
    mse_test: float = np.nan
    mse_train: float = np.nan
    fit_test: float = np.nan
    fit_train: float = np.nan
    condition_number: float = np.nan
    lag: int = 0
    noise_sigma: float = np.nan
    counts: MaskCounts = field(default_factory=lambda: MaskCounts(0))
    missed_cycles: int = 0
    used_by_trend: bool = False
    reproducible: bool = True
    trend_reason: str = ""
    disagreements: tuple[Disagreement, ...] = ()
    guards: tuple[Guard, ...] = ()
    conditions: tuple[Condition, ...] = ()

    def value(self, name: str) -> float:
        """Return the value of a parameter, NaN where it is refused or unknown."""
        return next((p.value for p in self.parameters if p.name == name), float("nan"))


@dataclass(frozen=True, slots=True)
class Prediction:
    """Predictions for a block of samples of one cycle.

    Attributes
    ----------
    cycle : int
        Number of the running cycle, 0 before the first.
    stamp_ns : (N,) int64 array
        Stamps of the measured samples [ns].
    measured, predicted, simulated, residual : (N,) arrays
        Measurement, one-step prediction, free-run simulation since the start of the cycle,
        measured - predicted [1].
    residual_sigma : float
        Expected standard deviation of the residual [1]; NaN = unknown.
    validity : (N,) uint8 array
        One `Validity` a sample.
    """

    cycle: int
    stamp_ns: IntArray
    measured: FloatArray
    predicted: FloatArray
    simulated: FloatArray
    residual: FloatArray
    residual_sigma: float
    validity: ByteArray


@dataclass(frozen=True, slots=True)
class Maintenance:
    """A maintenance event: the trend starts a new segment at `cycle`."""

    stamp_ns: int
    cycle: int
    note: str
    new_reference: bool = False
