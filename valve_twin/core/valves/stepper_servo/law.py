# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The law of the stepper valve as a step of one sample: the free run behind its thread.

The state holds the position and the motor position of the sample before: whole samples of the
delay are a matter of who runs the law, the rest of it is here. The flow moves nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.valves.kit.law import Law, Lawful, parameter, published
from valve_twin.core.valves.stepper_servo.kernels import play_step
from valve_twin.core.valves.stepper_servo.parameters import PARAMETERS
from valve_twin.core.valves.stepper_servo.predictor import MAX_LAG
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray


@njit(cache=True)
def step(x: FloatArray, u: FloatArray, p: FloatArray, period_s: float) -> None:
    """Advance the state, as `Law.step`.

    Parameters
    ----------
    x : (2,) array
        Position and last motor position, written in place [1].
    u : (2,) array
        Counted motor position and flow, held [1].
    p : (3,) array
        In the order of `LAW.parameters`.
    period_s : float
        Sampling time [s].
    """
    motor = u[0] + p[2] * (x[1] - u[0])
    x[0] = play_step(x[0], motor, p[0], p[1])
    x[1] = u[0]


@njit(cache=True)
def rest(x: FloatArray, u: FloatArray, p: FloatArray) -> None:
    """Let the motor have stood where it is, as `Law.rest`.

    Parameters
    ----------
    x, u, p : (2,), (2,), (3,) arrays
        As of `step`.
    """
    x[1] = u[0]


LAW = Law(
    step=step,
    states=2,
    parameters=(
        published(PARAMETERS, "backlash", 0.01, lower=0.0, upper=1.0),
        published(PARAMETERS, "offset", 0.0, lower=-10.0, upper=10.0),
        parameter("delay_part", 0.0, "1", "delay beyond whole samples", lower=0.0, upper=1.0),
    ),
    rest=rest,
)


def delay_of(values: Mapping[str, float], period_s: float) -> float:
    """Return the delay from counted step to position, as far as the line goes [samples].

    Parameters
    ----------
    values : mapping
        Known parameters by name [unit of each].
    period_s : float
        Sampling time [s].
    """
    return min(max(values.get("delay", 0.0) / period_s, 0.0), MAX_LAG)


class AsLaw(Lawful):
    """What of the model makes it one by a law."""

    __slots__ = ()
    law = LAW

    def law_lag(self, values: Mapping[str, float], lag: int, period_s: float) -> int:
        """Return the whole samples of the delay, as `Lawful.law_lag`.

        Parameters
        ----------
        values : mapping
            Known parameters by name [unit of each].
        lag : int
            What the scan found [samples].
        period_s : float
            Sampling time [s].
        """
        del lag
        return int(delay_of(values, period_s))

    def law_values(self, values: Mapping[str, float], period_s: float) -> Mapping[str, float]:
        """Return the delay's rest, as `Lawful.law_values`.

        Parameters
        ----------
        values : mapping
            Known ones by name [unit of each].
        period_s : float
            Sampling time [s].
        """
        delay = delay_of(values, period_s)
        return {"delay_part": delay % 1.0 if delay >= 1.0 else 0.0}
