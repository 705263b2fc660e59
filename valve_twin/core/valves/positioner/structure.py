# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which terms of the positioner are in force, as the options say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import assumed, setting
from valve_twin.core.valves.positioner import extended as law

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.estimation.solvers.least_squares import Limits
    from valve_twin.core.types import FloatArray, IntArray

LEAST_LAG = 0.05
"""Least velocity lag tried, in sampling times: shorter counts as none [1], assumed."""

_WIDEST_GAIN, _WIDEST_REST = 1e3, 2.0  # bounds of the static curve [1], assumed


@dataclass(frozen=True, slots=True)
class Structure:
    """Options: terms beyond delay, dead band, rates and slew limits."""

    second_order: bool = setting(
        False, "the speed follows what is asked with a lag: overshoot", assumed=True
    )
    max_velocity_lag: float = assumed(1.0, "s", "longest lag of the speed", 1e-4, 60.0)
    static_curve: bool = setting(
        False, "the command acts through a dead command and a gain", assumed=True
    )
    two_delays: bool = setting(False, "a falling command has a delay of its own", assumed=True)
    slew_limits: bool = setting(True, "the speed is limited", assumed=True)
    max_stiction: float = assumed(0.0, "1", "upper bound of the stiction, 0 = none", 0.0, 1.0)
    max_backlash: float = assumed(0.0, "1", "upper bound of the backlash, 0 = none", 0.0, 1.0)

    @property
    def extended(self) -> bool:
        """Whether any of them is in force."""
        return (
            self.second_order
            or self.static_curve
            or self.two_delays
            or not self.slew_limits
            or self.max_stiction > 0.0
            or self.max_backlash > 0.0
        )

    def free(self, *, dead_command: bool, dead_band: bool) -> IntArray:
        """Return the indices of the parameters to fit, of the 12.

        Parameters
        ----------
        dead_command : bool
            Whether the record shows enough levels to find it.
        dead_band : bool
            Whether there may be one.
        """
        chosen = [0, 1, *([2, 3] if self.slew_limits else []), *([4] if dead_band else [])]
        chosen += [law.LAG] if self.second_order else []
        chosen += [law.STICTION] if self.max_stiction > 0.0 else []
        chosen += [law.BACKLASH] if self.max_backlash > 0.0 else []
        if self.static_curve:
            chosen += [
                *([law.DEAD_COMMAND] if dead_command else []),
                law.STATIC_GAIN,
                law.REST_LEVEL,
            ]
        return np.array(chosen, dtype=np.int64)

    def widen(self, limits: Limits, period_s: float) -> Limits:
        """Return the bounds (12,) each of all parameters from those (5,) of the plain law."""
        least = LEAST_LAG * period_s if self.second_order else 0.0
        lower = [least, 0.0, 0.0, 0.0, 0.0, -_WIDEST_REST, 0.0]
        upper = [
            max(self.max_velocity_lag, 2.0 * least),
            self.max_stiction,
            self.max_backlash,
            1.0,
            _WIDEST_GAIN,
            _WIDEST_REST,
            1.0,
        ]
        return np.concatenate([limits[0], lower]), np.concatenate([limits[1], upper])

    def neutral(self, period_s: float) -> FloatArray:
        """Return parameters (12,) that switch every further term off."""
        p = np.zeros(law.N_EXTENDED)
        p[2:4] = 1.0 / period_s
        p[law.STATIC_GAIN] = 1.0
        p[law.N_EXTENDED - 1] = float(self.static_curve)
        return p


def extend(plain: FloatArray, values: Mapping[str, float], structure: Structure) -> FloatArray:
    """Return the 17 coefficients of the extended prediction.

    Parameters
    ----------
    plain : (9,) array
        Coefficients of the plain law, see `kernels.predict_block`.
    values : mapping
        Parameter values by name; what is not known acts as if it were not there.
    structure : Structure
        Which terms are in force.
    """
    period_s = float(plain[5])
    lag = float(round(values.get("delay", plain[6] * period_s) / period_s))
    p = structure.neutral(period_s)
    p[:5] = plain[:5]
    p[law.LAG] = values.get("velocity_lag", 0.0)
    p[law.STICTION], p[law.BACKLASH] = values.get("stiction", 0.0), values.get("backlash", 0.0)
    dead, top = values.get("dead_command", 0.0), values.get("top_command", 1.0)
    rest = values.get("rest_level", 0.0)
    settled = (values.get("top_level", top) - rest) / max(top - dead, 1e-9)
    p[law.DEAD_COMMAND], p[law.REST_LEVEL] = dead, rest
    p[law.STATIC_GAIN] = values.get("static_gain", settled)
    falling = lag
    if structure.two_delays:
        falling = float(round(values.get("delay_falling", lag * period_s) / period_s))
    return np.array([*p, period_s, lag, falling, plain[7], plain[8]])
