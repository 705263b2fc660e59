# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Value types shared by every room of the core: samples, frames, cycles, estimates and events.

Everything here is data. Stamps are integers in nanoseconds of the data's own clock (`*_ns`),
durations are seconds (`*_s`), positions are normalised to the stroke [1] and commands to full
scale [1] unless a signal says otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from enum import Enum, IntEnum
from operator import attrgetter
from typing import TYPE_CHECKING, Annotated, TypedDict, TypeVar

import numpy as np
from numpy import concatenate, ndarray
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from _typeshed import DataclassInstance

    Block = TypeVar("Block", bound=DataclassInstance)

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
    """What a predictor does at a sample: start the free run anew, forget the past or hold it."""

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


_READERS: dict[type, attrgetter[tuple[object, ...]]] = {}


def _values(block: DataclassInstance) -> tuple[object, ...]:
    read = _READERS.get(type(block))
    if read is None:
        read = _READERS[type(block)] = attrgetter(*(f.name for f in fields(block)))
    return read(block)


def cut_block(block: Block, part: slice | BoolArray) -> Block:
    """Return a contiguous part of a block of samples (views, no copies), or chosen samples."""
    return type(block)(*[v[part] if isinstance(v, ndarray) else v for v in _values(block)])


def join_blocks(parts: Sequence[Block]) -> Block:
    """Concatenate consecutive blocks of samples (at least one) in their order.

    An array that one lacks (None) is left out; a flag holds if all do; the rest is the last one's.
    """
    if len(parts) == 1:
        return parts[0]
    return type(parts[0])(*map(_join, zip(*map(_values, parts), strict=True)))


def _join(values: tuple[object, ...]) -> object:
    arrays = [v for v in values if isinstance(v, ndarray)]
    if arrays:
        return concatenate(arrays) if len(arrays) == len(values) else None
    return all(values) if isinstance(values[0], bool) else values[-1]


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
        Commands as the model orders them, held from the last sample at or before the stamp [1].
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
        return cut_block(self, part)


def join_frames(parts: Sequence[Frames]) -> Frames:
    """Concatenate consecutive parts (at least one); conditions that one lacks are NaN there."""
    if len({p.conditions is None for p in parts}) > 1:
        none = np.full((1, len(CONDITIONS)), np.nan)
        parts = [
            replace(p, conditions=none.repeat(len(p), 0)) if p.conditions is None else p
            for p in parts
        ]
    return join_blocks(parts)


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
    number, since : int
        Cycle number, counted on from the history or read from the counter topic; the first cycle
        of new references after maintenance, 0 = there was none.
    period_s : float
        Nominal sampling time of the position [s].
    frames : Frames
        The samples of the cycle.
    lost, missed_cycles : int
        Position samples known to be missing inside the cycle (gaps over 1.5 periods); cycles
        missed before this one, -1 = unknown.
    accepted, reason, reproducible : bool, str, bool
        Whether the cycle is handed to estimation, and why in one line; whether all inputs carried
        header stamps and none was lost.
    """

    number: int
    period_s: float
    frames: Frames
    lost: int = 0
    missed_cycles: int = 0
    accepted: bool = True
    reason: str = ""
    reproducible: bool = True
    since: int = 0

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
    lower, upper, trend, resolution : float, float, bool, float
        Physical bounds, whether aging follows it, by what a drift is wider on both sides [unit].
    fall, sided : tuple of str
        Names: its change over the command, and where it is given (`core.aging.cutting.falls`);
        where another one is the same of another direction: what, and which direction this is.
    """

    name: str
    unit: str
    description: str
    lower: float = -np.inf
    upper: float = np.inf
    trend: bool = False
    resolution: float = 0.0
    fall: tuple[str, ...] = ()
    sided: tuple[str, str] | tuple[()] = ()


@dataclass(frozen=True, slots=True)
class ParameterValue:
    """One parameter of one estimate.

    `value` is NaN where `status` is NOT_EXCITED or REFUSED; `standard_error`, `lower_95` and
    `upper_95` are NaN where they are not calibrated. Units as in the model's `Parameter` of the
    same name.
    """

    name: Annotated[str, "names"]
    value: Annotated[float, "values"]
    status: Annotated[ParameterStatus, "parameter_status"] = ParameterStatus.OK
    reason: Annotated[str, "parameter_reason"] = ""
    standard_error: Annotated[float, "standard_errors"] = np.nan
    lower_95: float = np.nan
    upper_95: float = np.nan

    @property
    def usable(self) -> bool:
        """Whether a trend may use the value."""
        return self.status is ParameterStatus.OK


@dataclass(frozen=True, slots=True)
class MaskCounts:
    """How many samples a fit used and how many each mask took out."""

    used: Annotated[int, "samples_used"]
    seat: Annotated[int, "samples_masked_seat"] = 0
    stuck: Annotated[int, "samples_masked_stuck"] = 0
    stale: Annotated[int, "samples_masked_stale"] = 0
    bad: Annotated[int, "samples_masked_bad"] = 0


@dataclass(frozen=True, slots=True)
class Guard:
    """One check of an estimate: a value with a reason, whether it passed or not.

    Attributes
    ----------
    name, passed : str, bool
        What is checked, such as "structure: level of v_in", and whether the estimate stands it.
    value, limit : float
        What was found and what is allowed [unit by check]; NaN = unknown, no limit.
    reason : str
        The finding in one line.
    """

    name: Annotated[str, "guard_names"]
    passed: Annotated[bool, "guard_passed"]
    value: Annotated[float, "guard_values"]
    limit: Annotated[float, "guard_limits"]
    reason: Annotated[str, "guard_reasons"]


@dataclass(frozen=True, slots=True)
class Condition:
    """Under what a cycle ran: name and value, such as the stroke [1]."""

    name: Annotated[str, "condition_names"]
    value: Annotated[float, "condition_values"]


@dataclass(frozen=True, slots=True)
class Disagreement:
    """How far two estimators of the same cycle lie apart in one parameter.

    Attributes
    ----------
    estimator, parameter : str
        The other estimator, and the parameter that both publish.
    difference : float
        This estimate's value minus the other's [unit of the parameter].
    standard_errors : float
        The same in standard errors of the difference as if the two were independent [1]; they
        share the noise, so that beyond 2 is rare where both are right. NaN = not calibrated.
    """

    estimator: Annotated[str, "disagreement_estimator"]
    parameter: Annotated[str, "disagreement_parameter"]
    difference: Annotated[float, "disagreement"]
    standard_errors: Annotated[float, "disagreement_errors"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """Parameters of one cycle by one estimator and what is known about them.

    All its formats are derived from its fields (`core.records`).

    Attributes
    ----------
    model, estimator : str
        Which valve model and which estimator.
    cycle, start_ns, end_ns : int
        Cycle number, its first and last stamp [ns].
    parameters : tuple of ParameterValue
        In the fixed order of the estimator.
    status, reason, reason_code : EstimateStatus, str, str
        Whether it may be used, why in one line; of a refusal its `core.refusal.RefusalCode`.
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
    used_by_trend, trend_reason : bool, str
        Whether this estimator feeds the trend; which does and why, empty where there is only one.
    disagreements : tuple of Disagreement
        Against the other estimators of the cycle.
    guards, conditions : tuple of Guard, tuple of Condition
        What was checked; under what the cycle ran.
    reproducible : bool
        All inputs had header stamps and none was lost: offline gives the same bits.
    """

    model: str
    estimator: str
    cycle: int
    start_ns: int
    end_ns: int
    parameters: tuple[ParameterValue, ...]
    status: EstimateStatus
    reason: str
    reason_code: str = ""
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
    trend_reason: str = ""
    disagreements: tuple[Disagreement, ...] = ()
    guards: tuple[Guard, ...] = ()
    conditions: tuple[Condition, ...] = ()
    reproducible: bool = True

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
        Measurement, one-step prediction, free run of the cycle, measured - predicted [1].
    residual_sigma : float
        Expected standard deviation of the residual [1]; NaN = unknown.
    validity : (N,) uint8 array
        One `Validity` a sample.
    reproducible : bool
        False where the cycle began without the estimate that it was due, see `Twin.go_on`.
    """

    cycle: int
    stamp_ns: IntArray
    measured: FloatArray
    predicted: FloatArray
    simulated: FloatArray
    residual: FloatArray
    residual_sigma: float
    validity: ByteArray
    reproducible: bool = True


@dataclass(frozen=True, slots=True)
class Maintenance:
    """A maintenance event: the trend starts a new segment at `cycle`, unless it is withdrawn."""

    stamp_ns: int
    cycle: int
    note: str
    new_reference: bool = False
    withdrawn: bool = False
    withdrawn_note: str = ""
