# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What was measured in a cycle, and the currents that magnetise.

Without eddy currents these are the measured ones. With `Eddies` they are what is left of them:

    i_m = i - e_1 - e_2      t_j e_j' = k_j (V - R i) - e_j

from the measured means, with the resistance by the flux balance of that very record, since a warm
coil would pass for an eddy current otherwise. A cycle is taken to begin without any.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.double_solenoid.coils import CoilFit, fit_resistance, flux_record
from valve_twin.core.valves.double_solenoid.eddies import Eddies, magnetising
from valve_twin.core.valves.kit.record import held
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, Frames
    from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant


@dataclass(frozen=True, slots=True)
class Record:
    """What was measured in a cycle, SI units.

    Attributes
    ----------
    x : (N,) array
        Position [m].
    current_a, current_b : (N,) arrays
        Currents that magnetise, means over the samples before the stamps [A].
    drawn, volts : (N, 2) arrays
        Measured currents [A] and voltages [V] of both coils, likewise.
    known : (N,) bool array
        Samples that can be used.
    period_s : float
        Sampling time [s].
    """

    x: FloatArray
    current_a: FloatArray
    current_b: FloatArray
    drawn: FloatArray
    volts: FloatArray
    known: BoolArray
    period_s: float


def make_record(
    frames: Frames, known: BoolArray, period_s: float, valve: DoubleSolenoidPlant
) -> Record:
    """Return what was measured; unusable samples repeat the last usable one.

    Parameters
    ----------
    frames : Frames
        N samples of a cycle.
    known : (N,) bool array
        Samples that can be used.
    period_s : float
        Sampling time [s].
    valve : DoubleSolenoidPlant
        The valve of the options.
    """
    position, inputs = held(frames.position, known), held(frames.inputs, known)
    drawn = inputs[:, 3:5] * valve.current_scale
    record = Record(
        x=valve.half_stroke * (2.0 * position - 1.0),
        current_a=np.ascontiguousarray(drawn[:, 0]),
        current_b=np.ascontiguousarray(drawn[:, 1]),
        drawn=drawn,
        volts=inputs[:, 1:3] * valve.supply_voltage,
        known=known,
        period_s=period_s,
    )
    if not valve.eddies.gain_1:
        return record
    given = [valve.resistance_a, valve.resistance_b]
    record = less_eddies(record, valve.eddies.numbers(), given)
    return less_eddies(record, valve.eddies.numbers(), warm_resistances(record, valve))


def warm_resistances(record: Record, valve: DoubleSolenoidPlant) -> list[float]:
    """Return the resistances by the flux balance, else those of the options [ohm].

    Parameters
    ----------
    record : Record
        What was measured.
    valve : DoubleSolenoidPlant
        The valve of the options.
    """
    part, given = longest_part(record.known), (valve.resistance_a, valve.resistance_b)
    found = [coil_of(record, valve, part, k).resistance for k in range(2)]
    return [f if np.isfinite(f) else g for f, g in zip(found, given, strict=True)]


def coil_of(record: Record, valve: DoubleSolenoidPlant, part: slice, column: int) -> CoilFit:
    """Return the resistance of coil A (0) or B (1) from a part of a record.

    Parameters
    ----------
    record : Record
        What was measured.
    valve : DoubleSolenoidPlant
        Its curves count.
    part : slice
        Samples without gaps.
    column : int
        The coil.
    """
    currents = record.current_a[part], record.current_b[part]
    own, other = currents if column == 0 else currents[::-1]
    x = np.ascontiguousarray(record.x[part])
    flux = np.empty(len(x))
    both = np.ascontiguousarray(own), np.ascontiguousarray(other)
    flux_record(valve.tables(), column, *both, x, flux)
    volts, drawn = record.volts[part, column], record.drawn[part, column]
    return fit_resistance(volts, drawn, flux, record.period_s)


def longest_part(known: BoolArray) -> slice:
    """Return the longest part without unusable samples."""
    if known.all():
        return slice(0, len(known))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], known, [False])).astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - starts))
    return slice(int(starts[longest]), int(ends[longest]))


def less_eddies(record: Record, of: Eddies, resistances: list[float]) -> Record:
    """Return a record whose currents are the measured ones less the eddy currents.

    Parameters
    ----------
    record : Record
        What was measured.
    of : Eddies
        The branches.
    resistances : list of float
        Of the coils [ohm].
    """
    left = np.empty((2, len(record.x)))
    for k, resistance in enumerate(resistances):
        volts, drawn = (np.ascontiguousarray(v[:, k]) for v in (record.volts, record.drawn))
        _magnetising_record(of, resistance, volts, drawn, record.period_s, left[k])
    return replace(record, current_a=left[0], current_b=left[1])


@njit(cache=True)
def _magnetising_record(
    of: Eddies,
    resistance: float,
    volts: FloatArray,
    drawn: FloatArray,
    period_s: float,
    out: FloatArray,
) -> None:
    fast, slow = 0.0, 0.0
    for n in range(len(drawn)):
        induced = volts[n] - resistance * drawn[n]
        out[n], fast, slow = magnetising(of, drawn[n], induced, fast, slow, period_s)
