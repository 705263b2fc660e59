# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the approximations behind a model change in the position: a plant may say so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Approximation:
    """One approximation.

    Attributes
    ----------
    letter : str
        Its row in an error budget, "g" or later.
    text : str
        What is approximated.
    error : (N,) array
        What the real valve does beyond the approximate one under the same commands [1].
    """

    letter: str
    text: str
    error: FloatArray


@runtime_checkable
class ApproximatedPlant(Protocol):
    """A plant that knows the approximations of its model."""

    def approximations(
        self, commands: FloatArray, period_s: float, values: Mapping[str, float]
    ) -> tuple[Approximation, ...]:
        """Return the error signals under recorded commands (N, M) of one cycle.

        `values` are the identified parameters by name.
        """
        ...
