# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The position controller of the press: P(I), gains per direction, off in hold in a dead band."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities, compiled
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray


class PlcSettings(NamedTuple):
    """Numbers of `PlcConfig` as the compiled controller takes them, same names and units."""

    period_s: float
    gain_in: float
    integral_in: float
    gain_out: float
    integral_out: float
    limit: float
    band_off: float
    band_on: float


@dataclass(frozen=True, slots=True)
class PlcConfig:
    """Numbers of the position controller; every field carries its unit, range and description."""

    period_s: float = assumed(0.01, "s", "Task period of the controller", 1e-4, 1.0)
    gain_in: float = assumed(6.0, "1", "Command per position error, opening", 0.0, 1e3)
    integral_in: float = assumed(
        2.0, "1/s", "Command per integral of the error, opening", 0.0, 1e3
    )
    gain_out: float = assumed(3.0, "1", "Command per position error, closing", 0.0, 1e3)
    integral_out: float = assumed(
        0.5, "1/s", "Command per integral of the error, closing", 0.0, 1e3
    )
    limit: float = assumed(0.8, "1", "Largest command in either direction", 0.0, 1.0)
    band_off: float = assumed(
        0.002, "1", "Error below which the output goes off in hold", 0.0, 1.0
    )
    band_on: float = assumed(
        0.02, "1", "Error above which the output comes on again in hold", 0.0, 1.0
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_quantities(self)
        if self.band_on < self.band_off:
            message = (
                f"PlcConfig.band_on = {self.band_on!r}: "
                f"must not be below band_off = {self.band_off!r} [1]"
            )
            raise ValueError(message)

    def settings(self) -> PlcSettings:
        """Return the numbers for `plc_step`."""
        return compiled(PlcSettings, self)


def initial_state() -> FloatArray:
    """Return integral of the error [s] and latch "output is off" [0 or 1], (2,): it is off."""
    return np.array([0.0, 1.0])


@njit(cache=True)
def plc_step(state: FloatArray, plc: PlcSettings, error: float, hold: bool) -> float:
    """Run one task period of the controller.

    Parameters
    ----------
    state : (2,) array
        Integral of the error [s] and latch "output is off"; written in place.
    plc : PlcSettings
        Numbers of the controller.
    error : float
        Reference minus position [1].
    hold : bool
        Whether the reference stands still.

    Returns
    -------
    float
        Signed command [1]: positive opens (v_in), negative closes (v_out).
    """
    band = plc.band_on if state[1] > 0.5 else plc.band_off
    if hold and abs(error) <= band:
        state[0] = 0.0
        state[1] = 1.0
        return 0.0
    state[1] = 0.0
    if state[0] * error < 0.0:
        state[0] = 0.0
    gain = plc.gain_in if error > 0.0 else plc.gain_out
    integral_gain = plc.integral_in if error > 0.0 else plc.integral_out
    integral = state[0] + error * plc.period_s
    command = gain * error + integral_gain * integral
    if abs(command) > plc.limit:
        return float(plc.limit) if command > 0.0 else -float(plc.limit)
    state[0] = integral
    return float(command)
