# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Model predictive trajectory set control: a few constant inputs, each predicted, the best taken.

Paper 000, section 2.2, names it and says: sub-optimal, 10 kHz, three parameters, all states. How
the set is built is not in the text. Assumed here from the name: every candidate is one input held
over the horizon; the set is the input of the last sample, changes of it from small to large, and
both limits. With 7 candidates (2 sizes of change), 32 samples of horizon and 4 model steps a
sample a decision takes 896 model steps.

The smallest change decides on what is left at rest: an input that is better by less is not in the
set. Sizes far apart leave nothing between: the valve then hesitates on its way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from valve_twin.core.quantity import assumed, check_quantities, compiled
from valve_twin.kernels import njit

HORIZON = 32
"""Control samples that a candidate is predicted where nothing else is said, assumed."""

MODEL_STEPS = 4
"""Model steps a control sample: 25 us, well below the limit of 160 us, assumed."""


class TrajectoryWeights(NamedTuple):
    """Numbers of `TrajectorySetConfig` as the compiled controller takes them."""

    overshoot: float
    speed_time: float
    effort: float
    change: float
    small: float
    sizes: int
    horizon: int


@dataclass(frozen=True, slots=True)
class TrajectorySetConfig:
    """The three parameters of the controller, and how far its set reaches."""

    overshoot: float = assumed(
        5.0,
        "1",
        "Weight of squared errors beyond the target over those before it",
        1.0,
        1e4,
        ages=False,
    )
    speed_time: float = assumed(
        5e-4,
        "s",
        "Time by which the speed at the end of the horizon counts as error",
        0.0,
        1.0,
        ages=False,
    )
    effort: float = assumed(
        1e-6, "1", "Weight of a squared change of the input", 0.0, 1.0, ages=False
    )
    change: float = assumed(0.2, "1", "Large change among the candidates", 0.02, 1.0, ages=False)
    small: float = assumed(0.02, "1", "Small change among them", 1e-4, 0.02, ages=False)
    sizes: int = assumed(2, "1", "Sizes of change from small to large", 2, 10, ages=False)
    horizon: int = assumed(
        HORIZON, "1", "Control samples that a candidate is predicted", 4, 100, ages=False
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_quantities(self)

    def weights(self) -> TrajectoryWeights:
        """Return the numbers for the compiled controller."""
        return compiled(TrajectoryWeights, self)


@njit(cache=True)
def candidate(w: TrajectoryWeights, index: int, last: float) -> float:
    """Return one input of the set, -1..1 [1].

    Parameters
    ----------
    w : TrajectoryWeights
        Holds the changes.
    index : int
        Which, 0 .. 2 + 2 sizes; 0 is the last input.
    last : float
        Input of the last sample [1].
    """
    if index > 2 * w.sizes:
        return 1.0 if index == 2 * w.sizes + 2 else -1.0
    if index == 0:
        return last
    size = (index - 1) // 2
    change = w.small
    if size + 1 == w.sizes:
        change = w.change
    elif size > 0:
        change *= (w.change / w.small) ** (size / (w.sizes - 1))
    return min(max(last + (change if index % 2 == 1 else -change), -1.0), 1.0)


@njit(cache=True)
def error_cost(w: TrajectoryWeights, first: float, error: float) -> float:
    """Return the cost of an error [1] of a trajectory that started with the error `first` [1].

    Parameters
    ----------
    w : TrajectoryWeights
        Weights.
    first, error : float
        Error at the start and now [1].
    """
    return error * error * (w.overshoot if error * first < 0.0 else 1.0)


@njit(cache=True)
def end_cost(w: TrajectoryWeights, speed: float, change: float) -> float:
    """Return the cost of the speed at the end [1/s] and of the change of the input [1].

    Parameters
    ----------
    w : TrajectoryWeights
        Weights.
    speed : float
        Speed at the end [1/s].
    change : float
        Change of the input [1].
    """
    rest = w.speed_time * speed
    return rest * rest + w.effort * change * change
