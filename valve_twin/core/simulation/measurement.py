# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The measurement layer: sensor delay, refresh, noise, quantisation and offsets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities, quantity

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

RANDOM_PHASE = -1


@dataclass(frozen=True, slots=True)
class MeasurementConfig:
    """Numbers of the measurement layer; every field carries its unit, range and description."""

    delay: int = assumed(1, "samples", "Delay of the position sensor", 0, 1000)
    refresh: int = assumed(
        1, "samples", "The sensor gives a new value every that many samples", 1, 1000
    )
    refresh_phase: int = quantity(
        RANDOM_PHASE,
        "samples",
        "Sample of a cycle that gets the first new value, -1 = drawn at random for each cycle",
        RANDOM_PHASE,
        999,
    )
    noise: float = assumed(1e-3, "1", "Standard deviation of the white position noise", 0.0, 1.0)
    quantum: float = assumed(0.0, "1", "Step of the position's quantisation, 0 = none", 0.0, 1.0)
    position_offset: float = assumed(0.0, "1", "Offset of the measured position", -1.0, 1.0)
    command_offsets: tuple[float, ...] = assumed(
        (), "1", "Offset of each logged command, in input order", -1.0, 1.0
    )
    process_noise: float = assumed(
        0.0,
        "1",
        "Standard deviation of the displacement that the process adds in one sample of motion",
        0.0,
        0.1,
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_quantities(self)
        if self.refresh_phase >= self.refresh:
            message = (
                f"MeasurementConfig.refresh_phase = {self.refresh_phase!r}: "
                f"must be below refresh = {self.refresh!r} [samples]"
            )
            raise ValueError(message)


@dataclass(frozen=True, slots=True)
class SensorState:
    """What the sensor remembers: its last `delay` positions (D,) and its last value [1]."""

    past: FloatArray
    held: float


def start_sensor(config: MeasurementConfig, position: float) -> SensorState:
    """Return the state of a sensor that has always seen `position` [1]."""
    return SensorState(np.full(config.delay, position), position + config.position_offset)


def measure(
    state: SensorState,
    config: MeasurementConfig,
    position: FloatArray,
    noise: FloatArray,
    phase: int,
    *,
    frozen: bool | BoolArray,
    gain: float = 1.0,
    offset: float = 0.0,
) -> tuple[SensorState, FloatArray]:
    """Measure N positions.

    Parameters
    ----------
    state : SensorState
        What the sensor remembers.
    config : MeasurementConfig
        Numbers of the layer.
    position, noise : (N,) arrays
        True position [1] and standard normal numbers.
    phase : int
        Samples until the next new value, counted from the first of the N.
    frozen : bool or (N,) bool array
        The sensor repeats its last value, always or at these samples.
    gain, offset : float
        A faulty sensor gives gain * position + offset [1].

    Returns
    -------
    SensorState, (N,) array
        What the sensor remembers then, and the measured positions [1].
    """
    count = len(position)
    history = np.concatenate([state.past, position])
    value = gain * history[:count] + (config.position_offset + offset) + config.noise * noise
    if config.quantum > 0.0:
        value = np.round(value / config.quantum) * config.quantum
    index = np.arange(count)
    fresh = (index - phase) % config.refresh == 0
    fresh &= ~np.asarray(frozen)
    last = np.maximum.accumulate(np.where(fresh, index, -1))
    measured = np.where(last >= 0, value[last], state.held)
    held = float(measured[-1]) if count else state.held
    return SensorState(history[count:], held), measured
