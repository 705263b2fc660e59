# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Run a valve's model over frames: for the live prediction and for judging an estimate alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.gaps import gap_ns
from valve_twin.core.types import Restart, Validity
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, ByteArray, FloatArray, Frames, IntArray
    from valve_twin.core.valves.interface import ValveModel

_NO_MODEL = int(Validity.NO_MODEL)


@dataclass(frozen=True, slots=True)
class ModelRun:
    """One-step prediction, free run [1] and `Validity` of N samples, (N,) each."""

    predicted: FloatArray
    simulated: FloatArray
    validity: ByteArray


def restart_marks(
    frames: Frames, period_s: float, *, before_ns: int | None = None, opens: bool = False
) -> ByteArray:
    """Tell a predictor where a cycle, a gap or an unusable sample begins.

    Parameters
    ----------
    frames : Frames
        N samples, N >= 1.
    period_s : float
        Nominal sampling time [s].
    before_ns : int, optional
        Stamp of the sample before them [ns]; None = there is none.
    opens : bool
        Whether the first sample opens a cycle.

    Returns
    -------
    (N,) uint8 array
        One `Restart` a sample.
    """
    restart = np.empty(len(frames), dtype=np.uint8)
    before = int(frames.stamp_ns[0]) - 1 if before_ns is None else before_ns
    _mark_restarts(frames.stamp_ns, frames.valid, before, gap_ns(period_s), restart)
    if before_ns is None and frames.valid[0]:
        restart[0] = Restart.GAP
    elif opens and restart[0] == Restart.GO_ON:
        restart[0] = Restart.NEW_CYCLE
    return restart


@njit(cache=True)
def _mark_restarts(
    stamp_ns: IntArray, valid: BoolArray, before_ns: int, limit_ns: float, restart: ByteArray
) -> None:
    last = before_ns
    for n in range(len(stamp_ns)):
        step = stamp_ns[n] - last
        last = stamp_ns[n]
        if not valid[n]:
            restart[n] = Restart.BAD
        elif step > limit_ns or step <= 0:
            restart[n] = Restart.GAP
        else:
            restart[n] = Restart.GO_ON


@njit(cache=True)
def _finite(inputs: FloatArray, out: FloatArray) -> None:
    for n in range(inputs.shape[0]):
        for j in range(inputs.shape[1]):
            value = inputs[n, j]
            out[n, j] = value if np.isfinite(value) else 0.0


@njit(cache=True)
def _subtract(
    valid: BoolArray, position: FloatArray, predicted: FloatArray, out: FloatArray
) -> None:
    for n in range(len(position)):
        out[n] = position[n] - predicted[n] if valid[n] else np.nan


def residuals(frames: Frames, run: ModelRun) -> FloatArray:
    """Return measured - predicted, (N,), NaN where a sample is not valid [1]."""
    out = np.empty(len(frames))
    _subtract(frames.valid, frames.position, run.predicted, out)
    return out


def run_model(
    model: ValveModel,
    state: FloatArray,
    coefficients: FloatArray | None,
    frames: Frames,
    restart: ByteArray,
) -> ModelRun:
    """Predict N samples.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    state : (S,) array
        Its state, written in place [unit by state].
    coefficients : (K,) array or None
        Of its `predict`; None = no model is in force: all NaN and NO_MODEL.
    frames : Frames
        The samples.
    restart : (N,) uint8 array
        See `restart_marks`.
    """
    n = len(frames)
    run = ModelRun(
        predicted=np.full(n, np.nan),
        simulated=np.full(n, np.nan),
        validity=np.full(n, _NO_MODEL, dtype=np.uint8),
    )
    if coefficients is not None:
        inputs = np.empty_like(frames.inputs)
        _finite(frames.inputs, inputs)
        model.predict(
            state,
            coefficients,
            np.ascontiguousarray(frames.position),
            inputs,
            restart,
            run.predicted,
            run.simulated,
            run.validity,
        )
    return run


def fit_percent(y: FloatArray, simulated: FloatArray, *, least: int = 1) -> float:
    """Return 100 (1 - |y - simulated| / |y - mean(y)|) over the samples that both have [%].

    Parameters
    ----------
    y, simulated : (N,) arrays
        Measured and simulated [same unit]; NaN where not known.
    least : int
        Fewer known samples, or a constant y, give NaN.
    """
    known = np.isfinite(y) & np.isfinite(simulated)
    if np.count_nonzero(known) < least:
        return float("nan")
    y = y[known]
    spread = float(np.sqrt(np.sum((y - y.mean()) ** 2)))
    miss = float(np.sqrt(np.sum((y - simulated[known]) ** 2)))
    return percent(miss, spread)


def percent(miss: float, spread: float) -> float:
    """Return the fit of the roots of the squares of what is missed and of what there is [%]."""
    return 100.0 * (1.0 - miss / spread) if spread > 0.0 else float("nan")
