# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Run a valve's model over frames: for the live prediction and for judging an estimate alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.gaps import find_gaps
from valve_twin.core.types import Validity

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray, Frames
    from valve_twin.core.valves.interface import ValveModel

_NEW_CYCLE, _GAP, _NOT_VALID = 1, 2, 3  # the codes of `ValveModel.predict`


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
        Codes of `ValveModel.predict`.
    """
    restart = np.zeros(len(frames), dtype=np.uint8)
    restart[0] = _NEW_CYCLE if opens else 0
    before = frames.stamp_ns[0] - 1 if before_ns is None else before_ns
    gaps = find_gaps(np.concatenate(([before], frames.stamp_ns)), period_s)
    restart[gaps[1:]] = _GAP
    if before_ns is None:
        restart[0] = _GAP
    restart[~frames.valid] = _NOT_VALID
    return restart


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
        Its state, written in place.
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
        validity=np.full(n, int(Validity.NO_MODEL), dtype=np.uint8),
    )
    if coefficients is not None:
        model.predict(
            state,
            coefficients,
            np.ascontiguousarray(frames.position),
            np.nan_to_num(frames.inputs, nan=0.0, posinf=0.0, neginf=0.0),
            restart,
            run.predicted,
            run.simulated,
            run.validity,
        )
    return run
