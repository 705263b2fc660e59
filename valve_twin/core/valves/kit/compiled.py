# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A model that predicts with one compiled kernel."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from valve_twin.core.estimation.cycle.plausibility import normalised_fault
from valve_twin.core.valves.interface import ValveModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import ByteArray, Cycle, FloatArray
    from valve_twin.core.valves.interface import Options

    Kernel = Callable[..., None]


class CompiledModel(ValveModel):
    """A model whose `predict` is a compiled kernel of the same arguments.

    Attributes
    ----------
    kernel : callable
        Predicts a block in place; `kernel_of` where it depends on the coefficients.
    state_size : int
        Numbers of its state, all 0 before the first sample [1].
    follows : str
        The input that the output of a `normalised` valve follows; empty = none.
    reach_s : float
        Longest delay between the two that the check of the signals tries [s], assumed.
    """

    __slots__ = ()

    kernel: ClassVar[Kernel]
    state_size: ClassVar[int]
    follows: ClassVar[str] = ""
    reach_s: ClassVar[float] = 0.0

    def input_fault(self, cycle: Cycle, options: Options) -> str:
        """Return why the signals cannot be what is configured, as `ValveModel.input_fault`."""
        del options
        if not self.normalised:
            return ""
        names = (self.output, *self.inputs)
        return normalised_fault(names, cycle, follows=self.follows, reach_s=self.reach_s)

    def initial_state(self) -> FloatArray:
        """Return the state before the first sample."""
        return np.zeros(self.state_size)

    def kernel_of(self, coefficients: FloatArray) -> Kernel:
        """Return the kernel that takes these coefficients (K,)."""
        del coefficients
        return type(self).kernel

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
        run = self.kernel_of(coefficients)
        run(state, coefficients, position, inputs, restart, predicted, simulated, validity)
