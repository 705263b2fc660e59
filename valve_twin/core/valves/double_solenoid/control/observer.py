# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the trajectory set control knows of the valve: an observer of position and currents.

The observer is the model of the controller, driven by the voltages that the current controllers
gave and corrected every sample by what the sensors show. What the forces of the model do not
explain it takes for a constant push on the spool and integrates it: the predictions of the
controller hold that push, so that no error is left which a mass, a spring or a force other than
the model's would leave.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, NamedTuple

from valve_twin.core.control.current_loop import rounded
from valve_twin.core.control.trajectory_set import MODEL_STEPS
from valve_twin.core.physics.curves import linked_flux
from valve_twin.core.quantity import assumed, check_quantities, compiled
from valve_twin.core.simulation.noise import normal_at
from valve_twin.core.valves.double_solenoid import plant_kernel as at
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.physics.curves import Curves
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.double_solenoid.plant_kernel import Valve


class Observer(NamedTuple):
    """Numbers of `ObserverConfig` as the compiled functions take them."""

    place: float
    speed: float
    push: float
    largest_push: float
    position_noise: float
    position_quantum: float
    flux_share: float
    current_quantum: float
    seed: int


@dataclass(frozen=True, slots=True)
class ObserverConfig:
    """Numbers of the observer and of the position sensor that it reads."""

    rate: float = assumed(
        3e3, "1/s", "Rate at which errors of the state fade", 10.0, 3e4, ages=False
    )
    flux_share: float = assumed(
        0.3, "1", "Share of the currents' error that corrects the fluxes", 0.0, 1.0, ages=False
    )
    position_noise: float = assumed(
        1.6e-7, "m", "Standard deviation of the position that it reads", 0.0, 1e-4, ages=False
    )
    position_quantum: float = assumed(
        1e-7, "m", "Resolution of the position that it reads", 0.0, 1e-4, ages=False
    )

    largest_push: float = assumed(
        100.0, "N", "Largest push on the spool that it believes in", 0.0, 1e5, ages=False
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_quantities(self)

    def numbers(self, current_quantum: float, seed: int) -> Observer:
        """Return the numbers for the compiled functions.

        The gains are those of a fading memory: one pole of multiplicity three.

        Parameters
        ----------
        current_quantum : float
            Resolution of the current sensors [A].
        seed : int
            Of the noise of the position.
        """
        left = math.exp(-self.rate * at.SAMPLE_S)
        return compiled(
            Observer,
            self,
            place=1.0 - left**3,
            speed=1.5 * (1.0 - left) ** 2 * (1.0 + left) / at.SAMPLE_S,
            push=(1.0 - left) ** 3 / at.SAMPLE_S**2,
            current_quantum=current_quantum,
            seed=seed,
        )


@dataclass(frozen=True, slots=True)
class KnownNumbers:
    """What the model of the controller has in place of the valve's own numbers; 0 = these."""

    mass: float = assumed(0.0, "kg", "Mass in the model; 0 = the valve's", 0.0, 10.0, ages=False)
    force_gain: float = assumed(
        0.0, "1", "Force gain in the model; 0 = the valve's", 0.0, 5.0, ages=False
    )
    friction: float = assumed(
        0.0, "N", "Coulomb friction in the model; 0 = the valve's", 0.0, 500.0, ages=False
    )
    spring_1: float = assumed(
        0.0, "N/m", "Rate of spring 1 in the model; 0 = the valve's", 0.0, 1e6, ages=False
    )
    spring_2: float = assumed(
        0.0, "N/m", "Rate of spring 2 in the model; 0 = the valve's", 0.0, 1e6, ages=False
    )
    preload_1: float = assumed(
        0.0, "N", "Preload of spring 1 in the model; 0 = the valve's", 0.0, 1e3, ages=False
    )
    preload_2: float = assumed(
        0.0, "N", "Preload of spring 2 in the model; 0 = the valve's", 0.0, 1e3, ages=False
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_quantities(self)

    def of(self, valve: Valve) -> Valve:
        """Return the model of the controller.

        Parameters
        ----------
        valve : Valve
            The valve's own numbers.
        """
        given = {f.name: float(getattr(self, f.name)) for f in fields(self)}
        numbers = valve._asdict() | {name: value for name, value in given.items() if value > 0.0}
        return type(valve)(**numbers)


@njit(cache=True)
def correct(o: FloatArray, v: Valve, m: Curves, of: Observer, s: FloatArray, read: float) -> None:
    """Correct the observer's state by what the sensors show.

    Parameters
    ----------
    o : (STATE_SIZE,) array
        The observer's state at this time, see `STATE_SIZE`; written in place.
    v, m, of : Valve, Curves, Observer
        The model of the controller; numbers of observer and sensors.
    s : (STATE_SIZE,) array
        Of the valve, see `STATE_SIZE`; only means of currents, integral parts and time are read.
    read : float
        Position at the sensor, without noise [m].
    """
    if of.position_noise > 0.0:
        read += of.position_noise * normal_at(of.seed, round(s[at.TIME] / at.SAMPLE_S))
    if of.position_quantum > 0.0:
        read = of.position_quantum * round(read / of.position_quantum)
    off = read - o[at.X]
    o[at.X] = min(max(o[at.X] + of.place * off, -v.stop), v.stop)
    o[at.SPEED] += of.speed * off
    push = o[at.PUSH] + of.push * v.mass * off
    o[at.PUSH] = min(max(push, -of.largest_push), of.largest_push)
    shown = (
        rounded(s[at.MEAN_A], of.current_quantum),
        rounded(s[at.MEAN_B], of.current_quantum),
    )
    believed = o[at.MEAN_A], o[at.MEAN_B]
    for j in range(2):
        other = shown[1 - j]
        more = linked_flux(m, j, shown[j], other, read) - linked_flux(
            m, j, believed[j], other, read
        )
        o[at.PSI_A + j] += of.flux_share * more
        current = of.flux_share * (shown[j] - believed[j])
        if v.eddies.gain_1 == 0.0:
            o[at.GA_1 + 2 * j] += current
        o[at.I_A + j] += current
        o[at.MEAN_A + j] = shown[j]
        o[at.INTEGRAL_A + j] = s[at.INTEGRAL_A + j]


@njit(cache=True)
def follow(o: FloatArray, v: Valve, m: Curves, s: FloatArray) -> None:
    """Advance the observer's state by a control sample, with the voltages of the valve's.

    Parameters
    ----------
    o : (STATE_SIZE,) array
        The observer's state, see `STATE_SIZE`; written in place.
    v, m : Valve, Curves
        The model of the controller.
    s : (STATE_SIZE,) array
        Of the valve after that sample, see `STATE_SIZE`; only command and voltages are read.
    """
    at.step_sample(o, v, m, (s[at.VOLTS_A], s[at.VOLTS_B]), (-1, -1), MODEL_STEPS, False)
    o[at.COMMAND] = s[at.COMMAND]
