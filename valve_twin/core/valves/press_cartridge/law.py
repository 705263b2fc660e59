# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The law of the press cartridge valve as a step of one sample: the free run of its prediction.

The state holds the position, its last increment, and the two commands of the sample before: whole
samples of the delay are a matter of who runs the law, the rest of it is here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.kit.law import Law, Lawful, parameter, published
from valve_twin.core.valves.press_cartridge.parameters import PARAMETERS
from valve_twin.core.valves.press_cartridge.predictor import (
    COEFFICIENTS,
    GAINS,
    HIGH_SEAT,
    LOW_SEAT,
    MAX_LAG,
    write_gains,
)
from valve_twin.core.valves.press_cartridge.predictor import step as ahead_of
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.press_cartridge.parameters import PressCartridgeOptions

_gains = njit(cache=True)(write_gains)

_OWN = "not estimated: the usual option, set the valve's own"


@njit(cache=True)
def step(x: FloatArray, u: FloatArray, p: FloatArray, period_s: float) -> None:
    """Advance the state x (4,) [1] under held commands u (2,) [1], as `Law` says."""
    c = np.zeros(COEFFICIENTS)
    _gains(c, p, p[8], period_s)
    c[LOW_SEAT], c[HIGH_SEAT] = p[9], p[10]
    part = p[7]
    v_in, v_out = max(u[0] - p[11], 0.0), max(u[1] - p[12], 0.0)
    acting_in = (1.0 - part) * v_in + part * x[2]
    acting_out = (1.0 - part) * v_out + part * x[3]
    ahead = ahead_of(c, acting_in, acting_out, x[0], x[1])
    x[1] = ahead - x[0]
    x[0] = ahead
    x[2], x[3] = v_in, v_out


LAW = Law(
    step=step,
    states=4,
    parameters=(
        *(
            published(PARAMETERS, name, value, lower=lower, upper=upper)
            for name, (value, lower, upper) in zip(
                GAINS,
                (
                    (0.5, 0.0, 1.0),
                    (0.01, 0.0, 10.0),
                    (0.0, -10.0, 0.0),
                    (0.5, 0.0, 1.0),
                    (0.01, 0.0, 10.0),
                    (0.0, -10.0, 10.0),
                    (0.0, 0.0, 100.0),
                ),
                strict=True,
            )
        ),
        parameter("delay_part", 0.0, "1", "delay beyond whole samples", lower=0.0, upper=1.0),
        parameter("v_ref", 0.3, "1", f"command of K_out, {_OWN}", lower=0.0, upper=1.0),
        parameter("lower_seat", 0.0, "1", f"lower seat, {_OWN}", lower=-1.0, upper=2.0),
        parameter("upper_seat", 1.0, "1", f"upper seat, {_OWN}", lower=-1.0, upper=2.0),
        parameter(
            "v_offset_in", 0.0, "1", f"v_in that opens nothing, {_OWN}", lower=0.0, upper=0.5
        ),
        parameter("v_offset_out", 0.0, "1", f"the same of v_out, {_OWN}", lower=0.0, upper=0.5),
    ),
)


def delay_of(values: Mapping[str, float], lag: float) -> float:
    """Return the delay from command to position, as far as the delay line goes [samples].

    Parameters
    ----------
    values : mapping
        Known parameters by name [unit of each].
    lag : float
        What stands for one that is not known [samples].
    """
    return min(max(values.get("delay", lag), 0.0), MAX_LAG)


class AsLaw(Lawful):
    """What of the model makes it one by a law."""

    __slots__ = ()
    options: PressCartridgeOptions
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
        del period_s
        return int(delay_of(values, lag))

    def law_values(self, values: Mapping[str, float], period_s: float) -> Mapping[str, float]:
        """Return the delay's rest, seats and offsets, as `Lawful.law_values`.

        Parameters
        ----------
        values : mapping
            Known ones by name [unit of each].
        period_s : float
            Sampling time [s].
        """
        delay, options = delay_of(values, 0), self.options
        return {
            **{name: value for name, value in GAINS.items() if np.isfinite(value)},
            "delay_part": delay % 1.0 if delay >= 1.0 else 0.0,
            "v_ref": options.v_ref,
            "lower_seat": options.lower_seat,
            "upper_seat": options.upper_seat,
            "v_offset_in": options.v_offset_in,
            "v_offset_out": options.v_offset_out,
        }
