# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A model that predicts with one compiled kernel, and the words of its outcome."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from valve_twin.core.types import EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.core.valves.interface import ValveModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from valve_twin.core.types import ByteArray, FloatArray


class CompiledModel(ValveModel):
    """A model whose `predict` is a compiled kernel of the same arguments.

    Attributes
    ----------
    kernel : callable
        Predicts a block in place.
    state_size : int
        Numbers of its state, all 0 before the first sample [1].
    """

    __slots__ = ()

    kernel: ClassVar[Callable[..., None]]
    state_size: ClassVar[int]

    def initial_state(self) -> FloatArray:
        """Return the state before the first sample."""
        return np.zeros(self.state_size)

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
        """Predict a block of samples as `ValveModel.predict` says."""
        position, inputs = np.ascontiguousarray(position), np.ascontiguousarray(inputs)
        run = type(self).kernel
        run(state, coefficients, position, inputs, restart, predicted, simulated, validity)


def blank(
    names: Iterable[str], reason: str, status: ParameterStatus = ParameterStatus.REFUSED
) -> tuple[ParameterValue, ...]:
    """Return parameters without a value.

    Parameters
    ----------
    names : iterable of str
        Their names.
    reason : str
        Why there is none, in one line.
    status : ParameterStatus
        Whether they were refused or not excited.
    """
    return tuple(ParameterValue(name, np.nan, status, reason) for name in names)


def at_zero(name: str, value: float) -> ParameterValue:
    """Return a parameter that cannot be negative, marked where it rests on 0."""
    if value <= 0.0:
        return ParameterValue(name, float(value), ParameterStatus.AT_BOUND, "rests on 0")
    return ParameterValue(name, float(value))


def verdict(missing: list[str], word: str) -> tuple[EstimateStatus, str]:
    """Return status and reason of an estimate that lacks some parameters, "WORD: their names"."""
    if not missing:
        return EstimateStatus.ACCEPTED, "accepted"
    return EstimateStatus.PARTIAL, f"{word}: {', '.join(missing)}"
