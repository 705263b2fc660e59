# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Features of a cycle in which faults are seen: which a valve has, and how they are followed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from valve_twin.core.types import FloatArray, ParameterValue

ESTIMATOR = "features"
"""Name under which the features of a cycle are stored and published."""


MOTION = "motion."
"""With what the names of the numbers begin that the valve's own motion is stored as."""

NOISE = "rest_noise"
"""Name of the feature that is the noise of the position at rest."""

UNFOLLOWED = "unfollowed"
"""Name of the feature that is the share of the commands that were not followed [1]."""

DELAYS = ("delay_in", "delay_out")
"""Names of the features that are times from a command to the motion [s]."""

TIMED = (*DELAYS, "shortfall")
"""Names of the features that change by themselves where two clocks run apart."""


RETURNS = "returns"
"""Name of the number that is the time from the start of a cycle to its return [s]."""

PERIOD = "period"
"""Name of the number that is the time between the samples of a cycle [s]."""

USUAL_PERIODS_S = (0.02, 0.04)
"""Between which the time between samples lies where a cycle does not tell it, assumed [s]."""

NEXT_CYCLE = "the next cycle"
"""Name of the check that the model of the cycles before follows a cycle better than its mean."""


@dataclass(frozen=True, slots=True)
class FeatureSet:
    """The features of a valve, and where the search for the signatures of its faults begins.

    Attributes
    ----------
    names : tuple of str
        The F features, in the order in which the valve returns them. A feature `repeats`, the
        share of samples that repeat the one before, shows a frozen sensor.
    relative : frozenset of str
        Features whose changes count relative to themselves: their logarithm is followed.
    shares : tuple of str
        Features that count samples: one sample more or less is their least deviation.
    gains : tuple of str
        Features that show by a common fall that nothing moves.
    slopes : tuple of str
        Features of a valve that may be of either sign on sound valves and differ by their size.
    first_sizes : mapping of str to float
        By fault that is named, the size at which the search for a small one begins [unit of the
        fault]; what is found does not depend on it.
    largest : mapping of str to float
        Greatest size of a fault that has one [unit of the fault].
    least : mapping of str to float
        Least standard deviation of a feature between cycles, by name [unit of the feature].
    across : mapping of str to float
        Standard deviation by which a feature changes with the product, by name [as followed];
        those not named tell nothing of another product.
    of_any_valve : bool
        Whether features that every valve has (`generic`) are among them.
    by_model : bool
        Whether their signatures are what the model sees of its simulated valve, not changes of
        the valve's own motion: those of a free run that depends on the position it begins at.
    """

    names: tuple[str, ...] = ()
    relative: frozenset[str] = frozenset()
    shares: tuple[str, ...] = ()
    first_sizes: Mapping[str, float] = field(default_factory=dict, hash=False)
    largest: Mapping[str, float] = field(default_factory=dict, hash=False)
    least: Mapping[str, float] = field(default_factory=dict, hash=False)
    across: Mapping[str, float] = field(default_factory=dict, hash=False)
    of_any_valve: bool = False
    by_model: bool = False
    gains: tuple[str, ...] = ()
    slopes: tuple[str, ...] = ()

    def vector(self, values: Iterable[ParameterValue]) -> FloatArray:
        """Return the features as they are followed, (F,) in the order of `names`.

        Relative ones as their logarithm; NaN where the cycle does not show one.
        """
        known = {p.name: p.value for p in values if p.usable}
        vector = np.array([known.get(name, np.nan) for name in self.names], dtype=np.float64)
        return self._followed(vector)

    def vectors(self, usable: Callable[[str], FloatArray]) -> FloatArray:
        """Return the features of many cycles as they are followed, (N, F), see `vector`.

        Parameters
        ----------
        usable : callable
            Returns a feature of all of them by its name, (N,); NaN where one does not show it.
        """
        return self._followed(np.column_stack([usable(name) for name in self.names]))

    def _followed(self, found: FloatArray) -> FloatArray:
        """Return features, (F,) or (N, F), relative ones as their logarithm."""
        relative = np.array([name in self.relative for name in self.names], dtype=bool)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(relative, np.log(found), found)
