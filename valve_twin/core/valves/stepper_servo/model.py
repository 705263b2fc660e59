# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The stepper valve's model: what is estimated from one cycle and how it predicts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from valve_twin.core.estimation.recursive import Adaptation, Structure, project_stable
from valve_twin.core.gaps import find_gaps
from valve_twin.core.types import (
    Estimate,
    EstimateStatus,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.core.valves.stepper_servo.fit import Record, end_offset
from valve_twin.core.valves.stepper_servo.outcome import Settings, mechanics, wiener
from valve_twin.core.valves.stepper_servo.parameters import (
    FITS,
    FLOW,
    MECHANICS,
    OPTIONS,
    PARAMETERS,
    THETA,
    THREAD,
    WIENER,
    number,
)
from valve_twin.core.valves.stepper_servo.predictor import (
    COEFFICIENTS,
    MAX_LAG,
    initial_state,
    predict_block,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import ByteArray, Cycle, FloatArray, Parameter
    from valve_twin.core.valves.interface import Option, Options

_NAMES = {MECHANICS: (*THREAD, *FLOW), WIENER: (*THETA, THREAD[3], *FITS)}
_LEAST_SAMPLES = 50
_QUIET = 1e-9  # change of the counted position that is none [1]
_SETTLE_SAMPLES = 5


@dataclass(frozen=True, slots=True)
class StepperServoModel:
    """Implements `ValveModel` for the stepper-driven servo-valve of paper 004."""

    name: str = "stepper_servo"
    inputs: tuple[str, ...] = ("motor_position", "flow")
    output: str = "spool_position"
    parameters: tuple[Parameter, ...] = PARAMETERS
    options: tuple[Option, ...] = OPTIONS
    trend_estimator: str = MECHANICS

    def estimate(
        self, cycle: Cycle, options: Options, earlier: Sequence[Estimate] = ()
    ) -> tuple[Estimate, ...]:
        """Estimate backlash, dead band, lost steps and the Hammerstein-Wiener model of a cycle.

        Parameters
        ----------
        cycle : Cycle
            One cycle of N samples.
        options : mapping
            The model's options, complete.
        earlier : sequence of Estimate
            Those of the cycles before: the recursive model goes on from its last parameters.

        Returns
        -------
        tuple of Estimate
            One an estimator; REFUSED with its reason where the cycle says nothing.
        """
        record, lost, bad = _record(cycle)
        chosen = cast("Sequence[object]", options["estimators"])
        names = dict.fromkeys((MECHANICS, *(str(name) for name in chosen)))
        counts = MaskCounts(int(record.used.sum()), bad=bad + lost)
        refusal = _refusal(record, options)
        if refusal:
            return tuple(_refused(self.name, name, cycle, refusal, counts) for name in names)
        values, thread = mechanics(
            record,
            cycle.period_s,
            step=number(options, "step_size"),
            max_backlash=number(options, "max_backlash"),
            max_delay=_max_delay(options, cycle.period_s),
        )
        condition = _condition(thread.hessian)
        lag = max(1, round(float(thread.parameters[3])))
        sigma = _noise(record, lag)
        done = [_accepted(self.name, MECHANICS, cycle, values, counts, (condition, lag, sigma))]
        if WIENER in names:
            lag = int(number(options, "nk")) or lag
            structure = _structure(options, lag)
            settings = Settings(
                number(options, "centre"), end_offset(thread), _adaptation(options)
            )
            learned, got = wiener(record, structure, _carried(earlier, structure), settings)
            condition = _condition(got.state.gain)
            numbers = (condition, lag, sigma)
            done.append(_accepted(self.name, WIENER, cycle, learned, counts, numbers))
        return tuple(done)

    def coefficients(
        self, values: Mapping[str, float], lag: int, period_s: float, options: Options
    ) -> FloatArray:
        """Return the 14 coefficients of `predict`; NaN where the backlash was never seen.

        The Hammerstein-Wiener model is projected to a stable one: its free run would diverge.
        """
        c = np.zeros(COEFFICIENTS)
        c[12] = number(options, "centre")
        if "a_1" in values and "backlash" not in values:
            structure = Structure(3, 3, nk=min(max(lag, 1), MAX_LAG), nl=3)
            theta = np.array([values.get(name, 0.0) for name in THETA])
            c[0], c[11] = 1.0, structure.nk
            c[1:11] = project_stable(theta, structure)
            c[13] = values.get("offset", 0.0)
            return c
        delay = values.get("delay", 0.0) / period_s
        c[1] = values.get("backlash", np.nan)
        c[2] = values.get("offset", np.nan)
        c[3] = min(max(delay, 0.0), MAX_LAG)
        return c

    def initial_state(self) -> FloatArray:
        """Return the state before the first sample."""
        return initial_state()

    def predict(
        self,
        state: FloatArray,
        coefficients: FloatArray,
        position: FloatArray,
        inputs: FloatArray,
        restart: ByteArray,
        predicted: FloatArray,
        simulated: FloatArray,
        validity: ByteArray,
    ) -> None:
        """Predict a block of samples; see `ValveModel.predict`."""
        predict_block(
            state,
            coefficients,
            np.ascontiguousarray(position),
            np.ascontiguousarray(inputs),
            restart,
            predicted,
            simulated,
            validity,
        )


def _record(cycle: Cycle) -> tuple[Record, int, int]:
    """Return the longest stretch without a gap, samples outside it, and bad ones inside."""
    frames = cycle.frames
    gaps = find_gaps(frames.stamp_ns, cycle.period_s)
    edges = np.concatenate(([0], np.flatnonzero(gaps), [len(frames)]))
    longest = int(np.argmax(np.diff(edges)))
    part = frames[int(edges[longest]) : int(edges[longest + 1])]
    used = part.valid & np.isfinite(part.position) & np.isfinite(part.inputs).all(axis=1)
    kept = np.maximum.accumulate(np.where(used, np.arange(len(part)), 0))

    def held(values: FloatArray) -> FloatArray:
        return np.ascontiguousarray(np.nan_to_num(values[kept], nan=0.0, posinf=0.0, neginf=0.0))

    record = Record(held(part.position), held(part.inputs[:, 0]), held(part.inputs[:, 1]), used)
    return record, len(frames) - len(part), int(np.sum(~used))


def _refusal(record: Record, options: Options) -> str:
    usable = int(record.used.sum())
    if usable < _LEAST_SAMPLES:
        return f"{usable} usable samples without a gap, fewer than the {_LEAST_SAMPLES} needed"
    span = float(np.ptp(record.position[record.used]))
    wanted = number(options, "min_motion")
    if span < wanted:
        return f"the position moved by {span:.3g} of the stroke, less than min_motion {wanted:g}"
    if float(np.ptp(record.motor)) == 0.0:
        return f"motor_position stayed at {record.motor[0]:.3g}: the cycle excites nothing"
    return ""


def _max_delay(options: Options, period_s: float) -> float:
    return min(max(1.0, number(options, "max_delay_s") / period_s), float(MAX_LAG - 1))


def _structure(options: Options, lag: int) -> Structure:
    na, nb, nl = (int(number(options, name)) for name in ("na", "nb", "nl"))
    return Structure(na, nb, min(lag, MAX_LAG), nl)


def _adaptation(options: Options) -> Adaptation:
    """Return a careful adaptation: a thread with play is no Hammerstein-Wiener system."""
    return Adaptation(
        forgetting=number(options, "forgetting"), start_gain=0.01, early_forgetting=1.0
    )


def _carried(earlier: Sequence[Estimate], structure: Structure) -> FloatArray | None:
    """Return the last parameters of the recursive model, where it had this structure's delay."""
    for estimate in reversed(earlier):
        usable = estimate.status is not EstimateStatus.REFUSED
        if estimate.estimator == WIENER and usable:
            theta = np.array([estimate.value(name) for name in structure.names])
            same = estimate.lag == structure.nk and bool(np.isfinite(theta).all())
            return theta if same else None
    return None


def _noise(record: Record, lag: int) -> float:
    """Return the noise of the position where the motor has stood for a while [1]."""
    moved = np.abs(np.diff(record.motor, prepend=record.motor[:1])) > _QUIET
    last = np.maximum.accumulate(np.where(moved, np.arange(len(moved)), 0))
    rest = np.arange(len(moved)) - last > lag + _SETTLE_SAMPLES
    pairs = rest[1:] & rest[:-1] & record.used[1:] & record.used[:-1]
    if np.count_nonzero(pairs) < _LEAST_SAMPLES:
        return float("nan")
    return float(np.std(np.diff(record.position)[pairs]) / np.sqrt(2.0))


def _condition(hessian: FloatArray) -> float:
    """Return the condition number after scaling of what is excited."""
    scale = np.sqrt(np.diag(hessian))
    seen = scale > 0
    if not seen.any():
        return float("nan")
    scaled = hessian[np.ix_(seen, seen)] / np.outer(scale[seen], scale[seen])
    return float(np.sqrt(np.linalg.cond(scaled)))


def _accepted(
    model: str,
    estimator: str,
    cycle: Cycle,
    values: tuple[ParameterValue, ...],
    counts: MaskCounts,
    numbers: tuple[float, int, float],
) -> Estimate:
    withheld = [v.name for v in values if v.status is ParameterStatus.NOT_EXCITED]
    condition, lag, sigma = numbers
    return Estimate(
        model=model,
        estimator=estimator,
        cycle=cycle.number,
        start_ns=cycle.start_ns,
        end_ns=cycle.end_ns,
        parameters=values,
        status=EstimateStatus.PARTIAL if withheld else EstimateStatus.ACCEPTED,
        reason=f"not excited: {', '.join(withheld)}" if withheld else "accepted",
        condition_number=condition,
        lag=lag,
        noise_sigma=sigma,
        counts=counts,
        missed_cycles=cycle.missed_cycles,
        used_by_trend=estimator == MECHANICS,
        reproducible=cycle.reproducible,
    )


def _refused(
    model: str, estimator: str, cycle: Cycle, reason: str, counts: MaskCounts
) -> Estimate:
    return Estimate(
        model=model,
        estimator=estimator,
        cycle=cycle.number,
        start_ns=cycle.start_ns,
        end_ns=cycle.end_ns,
        parameters=tuple(
            ParameterValue(name, float("nan"), ParameterStatus.REFUSED, reason)
            for name in _NAMES[estimator]
        ),
        status=EstimateStatus.REFUSED,
        reason=reason,
        counts=MaskCounts(0, bad=counts.bad),
        missed_cycles=cycle.missed_cycles,
        reproducible=cycle.reproducible,
    )


MODEL = StepperServoModel()
