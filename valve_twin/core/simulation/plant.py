# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a valve has to bring to be simulated: a plant that runs blocks of samples.

A plant is a frozen dataclass of quantities (`core.quantity`); an aged plant is the same
dataclass with replaced numbers. It holds no state: the state is an array that `run` writes in
place.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Drive:
    """What acts on the plant during a block of N samples.

    Attributes
    ----------
    reference : (N * K,) array
        Position reference at every controller tick, K = `Plant.ticks_per_sample` [1].
    hold : (N * K,) bool array
        Whether the reference stands still at that tick.
    commands : (N, M) array or None
        Commands from outside, each held for one sample [1]; None = the plant's own controller
        runs.
    disturbance : (N,) array
        Displacement that the process noise adds over each sample while the spindle moves [1].
    leak_rate : float
        Extra leak fault: loss of stroke per second [1/s].
    stuck : bool
        Stuck fault: the spindle does not move.
    frozen : bool
        Sensor freeze fault: the controller goes on with the last position it has read.
    sensor_gain, sensor_offset : float
        Sensor faults: the controller reads gain * position + offset [1].
    freezes : (N,) bool array or None
        Samples at which alone the sensor freezes; None = none.
    lost_commands : (N,) bool array or None
        Samples whose command does not reach the valve; None = none.
    seed : int
        Seed of the simulation, for the noise of sensors inside the plant.
    """

    reference: FloatArray
    hold: BoolArray
    commands: FloatArray | None
    disturbance: FloatArray
    leak_rate: float = 0.0
    stuck: bool = False
    frozen: bool = False
    sensor_gain: float = 1.0
    sensor_offset: float = 0.0
    freezes: BoolArray | None = None
    lost_commands: BoolArray | None = None
    seed: int = 0

    def forcing(self, inputs: int) -> Forcing:
        """Return what acts on a plant of M `inputs`, for its compiled functions."""
        samples = len(self.disturbance)
        never = np.zeros(samples, dtype=np.bool_)
        commands = np.zeros((0, inputs)) if self.commands is None else self.commands
        return Forcing(
            reference=np.ascontiguousarray(self.reference),
            hold=np.ascontiguousarray(self.hold),
            external=self.commands is not None,
            commands=np.ascontiguousarray(commands, dtype=np.float64),
            disturbance=np.ascontiguousarray(self.disturbance),
            leak_rate=float(self.leak_rate),
            stuck=bool(self.stuck),
            frozen=bool(self.frozen),
            freezes=never if self.freezes is None else self.freezes,
            lost=never if self.lost_commands is None else self.lost_commands,
        )


class Forcing(NamedTuple):
    """A `Drive` as compiled functions take it: same names, nothing left out.

    `external` says whether `commands`, then (N, M), are from outside; `lost` are `lost_commands`.
    """

    reference: FloatArray
    hold: BoolArray
    external: bool
    commands: FloatArray
    disturbance: FloatArray
    leak_rate: float
    stuck: bool
    frozen: bool
    freezes: BoolArray
    lost: BoolArray


class Response(NamedTuple):
    """What the plant did during a block of N samples.

    Attributes
    ----------
    position : (N,) array
        True position at the stamps of the samples [1].
    inputs : (N, M) array
        Commands in force from the stamps on [1].
    """

    position: FloatArray
    inputs: FloatArray

    @classmethod
    def empty(cls, samples: int, inputs: int) -> Response:
        """Return room for N samples of M inputs, for a compiled function to fill."""
        return cls(np.empty(samples), np.empty((samples, inputs)))


class Plant(Protocol):
    """A simulated valve with its local controller.

    Implementations are frozen dataclasses that inherit from it; their quantities can be replaced,
    aged and scattered by name.

    Attributes
    ----------
    inputs : tuple of str
        Names of the M commands, as in the valve's model.
    command_range : tuple of float
        Least and greatest command that is taken from outside [1].
    fault_kinds : tuple of str
        Kinds of faults that it takes beyond those that every simulated valve takes.
    constants : mapping
        Its numbers that stand for known constants of the model that have other names.
    """

    inputs: ClassVar[tuple[str, ...]]
    command_range: ClassVar[tuple[float, float]] = (0.0, 1.0)
    fault_kinds: ClassVar[tuple[str, ...]] = ()
    constants: ClassVar[Mapping[str, str]] = MappingProxyType({})

    def ticks_per_sample(self, period_s: float) -> int:
        """Return how often the controller runs in a sample; ValueError if periods do not fit."""
        del period_s
        return 1

    def initial_state(self) -> FloatArray:
        """Return the (S,) state at rest."""
        ...

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples; `state` (S,) is written in place, same bits for any block length.

        Parameters
        ----------
        state : (S,) array
            State of the plant, written in place [unit by state].
        drive : Drive
            What acts on it during N samples.
        period_s : float
            Sampling time [s].
        """
        ...

    def steady_rate(self, inputs: FloatArray) -> float:
        """Return the speed in mid-stroke under constant commands (M,), leak included [1/s].

        0 where the valve holds a position: no constant command keeps it moving.
        """
        del inputs
        return 0.0

    def failure(self, state: FloatArray) -> str:
        """Return when and in what state (S,) the integration failed, empty if it did not."""
        del state
        return ""

    def with_fault(self, kind: str, severity: float) -> Plant:
        """Return the plant with a fault that is other numbers of it; `kind` in `fault_kinds`."""
        del kind, severity
        return self


def whole_ratio(whole: float, part: float, whole_name: str, part_name: str) -> int:
    """Return how many parts a whole takes, or refuse where it is no whole number of them.

    Parameters
    ----------
    whole, part : float
        Both times [s].
    whole_name, part_name : str
        Their names in the configuration.

    Raises
    ------
    ValueError
        If the whole is no multiple of the part.
    """
    count = round(whole / part)
    if count < 1 or abs(count * part - whole) > 1e-9 * whole:
        message = (
            f"{whole_name} = {whole!r}: must be a whole multiple of {part_name} = {part!r} [s]"
        )
        raise ValueError(message)
    return count


def failure_text(failed: float, time_s: float, where: str) -> str:
    """Return when and in what state an integration failed, empty if it did not.

    Parameters
    ----------
    failed, time_s : float
        Whether it did, 0 = no [1]; when [s].
    where : str
        The state, in words.
    """
    return f"integration failed at {time_s:.6f} s: {where}" if failed else ""
