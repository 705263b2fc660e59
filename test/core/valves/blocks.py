# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A record predicted by a model, in one block or many."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.core.types import Restart

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray

_UNWRITTEN = 99
"""What no sample holds that a model has predicted."""


def marked(count, codes=None) -> ByteArray:
    """Return the restart marks of `count` samples: a gap before the first, others as told."""
    restart = np.full(count, Restart.GO_ON, np.uint8)
    for where, code in ({0: Restart.GAP} | (codes or {})).items():
        restart[where] = code
    return restart


def predict(
    model, coefficients, frames: Any, restart, cuts=(), position=None
) -> tuple[FloatArray, FloatArray, ByteArray]:
    """Predict samples in blocks cut where told; return prediction, free run and validity."""
    position = frames.position if position is None else position
    inputs, count = np.ascontiguousarray(frames.inputs), len(position)
    state, validity = model.initial_state(), np.full(count, _UNWRITTEN, np.uint8)
    predicted, simulated = np.full((2, count), float(_UNWRITTEN))
    for a, b in pairwise((0, *sorted(cuts), count)):
        given = position[a:b], inputs[a:b], restart[a:b]
        model.predict(state, coefficients, *given, predicted[a:b], simulated[a:b], validity[a:b])
    for written in (predicted, simulated, validity):  # else equal blocks would say nothing
        assert not np.any(written == _UNWRITTEN)
    return predicted, simulated, validity


def free_run(model, values, period_s, inputs, start=0.0) -> FloatArray:
    """Return the free run of the prediction from a new cycle on that starts at a position."""
    frames = SimpleNamespace(position=np.full(len(inputs), start), inputs=inputs)
    c = model.coefficients(values, 0, period_s, model.options)
    return predict(model, c, frames, marked(len(inputs), {0: Restart.NEW_CYCLE}))[1]
