# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A designed solenoid as a valve takes it: what was computed of it, and what stands around it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from valve_twin.core.quantity import assumed, check_quantities
from valve_twin.core.valves.registry import get_model, model_names

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What stands around a double-stroke solenoid; no source gives the numbers."""

    spring_rate: float = assumed(1e4, "N/m", "Of either spring", 1.0, 1e6)
    preload: float = assumed(20.0, "N", "Of either spring in the middle", 0.0, 1e3)
    rubbing: float = assumed(4.0, "N", "Coulomb friction, peak to peak", 0.0, 500.0)
    steepness: float = assumed(200.0, "s/m", "Of the smoothed friction", 1.0, 5e3)
    viscous: float = assumed(15.0, "N s/m", "Damping", 0.0, 1e4)
    supply: float = assumed(24.0, "V", "Of the bridges, + and -", 1.0, 100.0)
    power: float = assumed(15.0, "W", "Most that a coil may take at rest", 0.1, 1e4)
    bias: float = assumed(0.5, "A", "Of both coils at no output", 0.0, 10.0)
    span: float = assumed(2.5, "A", "Change of the current at full output", 0.01, 100.0)
    opened: float = assumed(0.8 / 0.9, "1", "Stroke to an open port over that of the solenoid",
                            0.1, 1.0)  # fmt: skip
    overshoot: float = assumed(
        10.0, "1", "Controller: weight of errors beyond the target", 1.0, 1e4
    )
    speed_time: float = assumed(2e-4, "s", "Controller: time of the speed at the end", 0.0, 1.0)
    effort: float = assumed(1e-6, "1", "Controller: weight of a change of the input", 0.0, 1.0)
    change: float = assumed(0.5, "1", "Controller: large change among its inputs", 0.02, 1.0)
    small: float = assumed(3e-3, "1", "Controller: small change among them", 1e-4, 0.02)
    sizes: int = assumed(4, "1", "Controller: sizes of change from small to large", 2, 10)
    horizon: int = assumed(32, "1", "Controller: samples of 0.1 ms that it looks ahead", 4, 100)

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        check_quantities(self)


@dataclass(frozen=True, slots=True)
class Designed:
    """What was computed of a double-stroke solenoid.

    Attributes
    ----------
    curves : CoenergyMap
        Static curves of both coils.
    resistance : float
        Of a coil at 20 degrees Celsius [ohm].
    mass : float
        All that moves [kg].
    stroke : float
        To either side [m].
    current_dynamics, force_dynamics : tuple of float
        b1, b2, a1, a2 of G_A and G_F [s], [s^2].
    around : Surroundings
        What is not the solenoid's.
    eddies : tuple of float
        Gain and time of the faster and the slower branch of eddy currents, which simulated valve
        and twin then have in place of G_A and G_F [A/V], [s], and where they grow with the
        current by how much [1/A]; empty = none.
    """

    curves: CoenergyMap
    resistance: float
    mass: float
    stroke: float
    current_dynamics: tuple[float, float, float, float]
    force_dynamics: tuple[float, float, float, float]
    around: Surroundings
    eddies: tuple[float, ...] = ()

    @property
    def largest_current(self) -> float:
        """Largest reference: by the power limit, within the map [A]."""
        by_power = math.sqrt(self.around.power / self.resistance)
        return min(float(self.curves.currents[-1]), by_power)


@dataclass(frozen=True, slots=True)
class Numbers:
    """A designed valve by the names of a model's options.

    Attributes
    ----------
    shared : mapping
        Numbers of the data sheet, alike for valve and twin.
    own : mapping
        Settings of the simulated valve alone.
    """

    shared: Mapping[str, object]
    own: Mapping[str, object]


@dataclass(frozen=True, slots=True)
class Wear:
    """A dimension of a solenoid that may wear.

    Attributes
    ----------
    name : str
        Of the dimension, as the model knows it.
    change : CoenergyMap
        Change of the coenergy for a size of 1 [J].
    """

    name: str
    change: CoenergyMap


@dataclass(frozen=True, slots=True)
class Apart:
    """Which causes the signals of a cycle tell apart.

    Attributes
    ----------
    causes : tuple of str
        Names of K causes, the dimensions first.
    leaves : (K, K) array
        Share of the change by cause k (row) that cause j leaves [1].
    together : tuple of tuple of str
        Causes that leave too little of each other to be told apart.
    """

    causes: tuple[str, ...]
    leaves: FloatArray
    together: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Loop:
    """A step of a designed valve in its position loop.

    Attributes
    ----------
    time_s : (N,) array
        Since the step [s].
    rows : tuple
        Signals to show together: label with unit, and by name (N,) arrays [of the label]; A and B
        are of the coils.
    rise_s, overshoot, settling_s : float
        10 to 90 % [s], beyond the step over the step [1], until it stays within 2 % [s].
    graded_s : float
        Mean of the times until it stays within bands from 1 to 4 % [s].
    error : float
        What is left at the end, over the step [1].
    loss : float
        Mean heat of the copper until then [W].
    """

    time_s: FloatArray
    rows: tuple[tuple[str, Mapping[str, FloatArray]], ...]
    rise_s: float
    overshoot: float
    settling_s: float
    graded_s: float
    error: float
    loss: float


@runtime_checkable
class Designable(Protocol):
    """A model whose valve is moved by a double-stroke solenoid."""

    name: str

    def of_design(self, found: Designed) -> Numbers:
        """Return a designed solenoid's numbers by the names of the model's options."""
        ...

    def loop(
        self,
        numbers: Numbers,
        share: float,
        changes: Mapping[str, float],
        start: float = 0.0,
        draw: int = 0,
    ) -> Loop:
        """Follow a step of the setpoint, by default from the middle.

        Parameters
        ----------
        numbers : Numbers
            Of the valve.
        share : float
            End of the step over the way to an open port, -1..1, not the start [1].
        changes : mapping
            Factors of `SCALED` [1].
        start : float
            Where the valve rests before it, likewise [1].
        draw : int
            Which draw of the sensors' noise.
        """
        ...

    def force_margin(self, numbers: Numbers) -> float:
        """Return what the largest current leaves against spring and friction at the worst place.

        Parameters
        ----------
        numbers : Numbers
            Of the valve [N].
        """
        ...

    def of_wear(self, wear: Sequence[Wear]) -> Mapping[str, object]:
        """Return the options with which a twin names the dimension that has drifted.

        Parameters
        ----------
        wear : sequence of Wear
            What may drift.
        """
        ...

    def of_doubts(self, doubts: Sequence[Wear]) -> Mapping[str, object]:
        """Return the options with which the intervals of a twin hold the doubts about its map.

        Parameters
        ----------
        doubts : sequence of Wear
            Changes of the coenergy by a standard deviation each, on the nodes of the map.
        """
        ...

    def told_apart(self, numbers: Numbers, wear: Sequence[Wear]) -> Apart:
        """Return which dimensions a cycle of the simulated valve tells apart.

        Parameters
        ----------
        numbers : Numbers
            Of the valve.
        wear : sequence of Wear
            What may drift.
        """
        ...


SCALED = ("rubbing", "supply", "copper")
"""What a robust evaluation scales: friction, supply, resistance of the copper."""


def find_designable(name: str = "") -> Designable:
    """Return the model that a designed solenoid moves.

    Parameters
    ----------
    name : str
        Its name; empty = the first there is.

    Raises
    ------
    ValueError
        If there is none of the name, or it takes no design.
    """
    for known in (name,) if name else model_names():
        model = get_model(known)
        if isinstance(model, Designable):
            return model
    message = f"model '{name}' takes no designed solenoid: it has no of_design()"
    raise ValueError(message)
