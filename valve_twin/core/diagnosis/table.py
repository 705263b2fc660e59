# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults, and how each of them changes the features of a cycle."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.diagnosis.features import NOISE

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

PARTS = ("valve", "command", "sensor", "supply")
"""What can have a fault, as in the verdict."""

SIZES = ("small", "medium", "large")
FACTORS = (1.0, 3.0, 10.0)
"""Sizes of a fault over the size that four standard deviations of one cycle show."""


@dataclass(frozen=True, slots=True)
class FaultType:
    """What is known of a fault beforehand.

    Attributes
    ----------
    name : str
        As in `simulation.faults.KINDS` or `generic.faults.FAULTS`.
    part : str
        What is to be looked at: valve, command, sensor or supply.
    text : str
        What it is, in words.
    unit : str
        Unit of its size.
    two_sided : bool
        Whether it comes in both directions.
    most : float
        Greatest size that there is [unit of the fault].
    sized : bool
        Whether there is more and less of it.
    """

    name: str
    part: str
    text: str
    unit: str = "1"
    two_sided: bool = False
    most: float = np.inf
    sized: bool = True


_SLOWEST = 4.0
"""Greatest share by which a move may take longer, assumed: it would not end in a cycle [1]."""

FAULT_TYPES = (
    FaultType("leak", "valve", "leak of the chamber", "1/s"),
    FaultType("stiction", "valve", "sticking pilot"),
    FaultType("preload", "valve", "shifted closing force"),
    FaultType("coil_resistance", "valve", "risen resistance of the filling coil"),
    FaultType("weak_outflow", "valve", "weaker emptying pilots or coil"),
    FaultType("dead_band", "valve", "grown dead band"),
    FaultType("aeration", "valve", "gas in the chamber", most=1.0),
    FaultType("lost_motion", "valve", "lost motion (play), share of the travel", most=1.0),
    FaultType("sticking", "valve", "sticking when it sets off, share of the travel", most=1.0),
    FaultType("delay", "valve", "grown delay", "s"),
    FaultType("slow", "valve", "slower motion both ways", most=_SLOWEST),
    FaultType("slow_up", "valve", "slower motion up", most=_SLOWEST),
    FaultType("slow_down", "valve", "slower motion down", most=_SLOWEST),
    FaultType("end_stop_upper", "valve", "lowered upper end, share of the travel", most=1.0),
    FaultType("end_stop_lower", "valve", "raised lower end, share of the travel", most=1.0),
    FaultType("oscillation", "valve", "oscillating position, share of the travel", most=1.0),
    FaultType(
        "no_motion",
        "valve",
        "no motion: the spool is stuck, or no command reaches it",
        sized=False,
    ),
    FaultType(
        "no_opening",
        "valve",
        "it does not open: jammed, without drive, or its switch does not report the open end",
        sized=False,
    ),
    FaultType(
        "no_closing",
        "valve",
        "it does not close: jammed, without drive, or its switch does not report the closed end",
        sized=False,
    ),
    FaultType(
        "sensor_offset",
        "sensor",
        "offset of the position sensor, share of the travel",
        two_sided=True,
    ),
    FaultType("sensor_gain", "sensor", "gain of the position sensor", two_sided=True),
    FaultType("sensor_freeze", "sensor", "freezing position sensor", most=1.0),
    FaultType("sensor_noise", "sensor", "noisier position sensor, noise at rest times"),
    FaultType("clock", "sensor", "clocks of position and commands apart, by"),
    FaultType("command_offset", "command", "offset of the command", two_sided=True),
    FaultType("command_loss", "command", "command that does not reach the valve", most=1.0),
    FaultType("saturation", "command", "command at its end more often, share", most=1.0),
    FaultType("supply_drop", "supply", "drop of the supply pressure", most=1.0),
)
"""Every fault that is separated, by the part that has it."""

BY_NAME = {f.name: f for f in FAULT_TYPES}

PAIRS = {
    frozenset({"preload", "coil_resistance"}): "measure the current of the filling coil",
    frozenset({"sensor_gain", "supply_drop"}): "measure the pressure, or move to the upper seat",
    frozenset({"dead_band", "command_offset"}): "measure the command at the valve",
}
"""Pairs of faults that position and commands do not tell apart, and what settles it."""

SHOWN_BY = {
    "leak": "hold longer off the seats",
    "stiction": "drive small commands slowly both ways",
    "preload": "measure the current of the filling coil",
    "coil_resistance": "measure the current of the filling coil",
    "weak_outflow": "measure the current of the emptying coil",
    "dead_band": "measure the command at the valve",
    "aeration": "log commands and position at 5 ms or faster",
    "sensor_offset": "check the zero at the seats by finer steps",
    "sensor_gain": "move to the upper seat",
    "sensor_freeze": "log the state of the sensor",
    "command_offset": "measure the command at the valve",
    "command_loss": "measure the command at the valve",
    "supply_drop": "measure the pressure",
}
"""The one extra measurement that shows what cycles are too noisy or too coarse to show."""


def partner(fault: str) -> str:
    """Return the fault that no data tell from a fault, empty = there is none."""
    return next((n for pair in PAIRS if fault in pair for n in pair if n != fault), "")


@dataclass(frozen=True, slots=True)
class Signature:
    """Change of the features by a fault of one size.

    Attributes
    ----------
    fault : str
        Name of the fault.
    severity : float
        Its size, with sign [unit of the fault].
    change : tuple of float
        Mean change of each feature as it is followed, logarithms where relative.
    scatter : tuple of float
        Standard deviation of that change from cycle to cycle: a fault that comes and goes by
        chance scatters more than a healthy valve.
    """

    fault: str
    severity: float
    change: tuple[float, ...]
    scatter: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SignatureTable:
    """How faults change the features of a cycle of one model, derived by simulation.

    Attributes
    ----------
    features : tuple of str
        Names of the F features.
    covariance : tuple of tuple of float
        (F, F) covariance of the features of a healthy valve's cycle about their trend.
    floor : tuple of float
        (F,) least standard deviation of each feature: one sample more or less, or rounding.
    signatures : tuple of Signature
        Of each fault, size by size, small first.
    levels : tuple of (str, float)
        Features that are roots of sums of squares, and their logarithm on that healthy valve: a
        fault adds squares, so that it changes the logarithm of a greater one less.
    gains, slopes : tuple of str
        As `FeatureSet` has them.
    """

    features: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    floor: tuple[float, ...]
    signatures: tuple[Signature, ...]
    levels: tuple[tuple[str, float], ...] = ()
    gains: tuple[str, ...] = ()
    slopes: tuple[str, ...] = ()
    _hash: int = field(init=False, repr=False, compare=False, default=0)

    def __post_init__(self) -> None:
        """Reckon its hash once: what was found by a table is looked up by it in every verdict."""
        parts = self.features, self.covariance, self.floor, self.signatures, self.levels
        object.__setattr__(self, "_hash", hash(parts))

    def __hash__(self) -> int:
        """Return the hash of its parts."""
        return self._hash

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the faults, in the order of the signatures."""
        return tuple(dict.fromkeys(s.fault for s in self.signatures))

    def range(self, index: int) -> tuple[float, float]:
        """Return for which multiples of its size a signature stands: to half the way to others."""
        own = self.signatures[index]
        same = [s.severity / own.severity for s in self.signatures if s.fault == own.fault]
        ratios = [r for r in same if r > 0.0]
        lower = 0.5 if min(ratios) < 1.0 else 0.0
        most = BY_NAME[own.fault].most / abs(own.severity) if own.fault in BY_NAME else np.inf
        return lower, min(2.0 if max(ratios) > 1.0 else np.inf, most)

    def least(self, quiet: float = 1.0) -> FloatArray:
        """Return the least standard deviation of each feature between sound cycles, (F,).

        Parameters
        ----------
        quiet : float
            Share of what sampling alone does on the simulated valve that counts [1].
        """
        return np.maximum(self.floor, quiet * _arrays(self).deviation)

    def changes(self) -> FloatArray:
        """Return the changes of all signatures, (S, F), not to be changed."""
        return _arrays(self).changes

    def scatters(self) -> FloatArray:
        """Return the scatter of all signatures, (S, F), not to be changed."""
        return _arrays(self).scatters

    def on_levels(self, own: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return changes and scatters (S, F) of a valve whose features are at levels (F,)."""
        changes, scatters = self.changes(), self.scatters()
        if not self.levels:
            return changes, scatters
        level = np.array([dict(self.levels).get(n, np.nan) for n in self.features])
        more = np.exp(2.0 * (level - own))  # square of the table's over the own
        summed = np.isfinite(more) & (changes > 0.0)
        if NOISE in self.features:  # which a noisier sensor multiplies
            louder = [s.fault == "sensor_noise" for s in self.signatures]
            summed[louder, self.features.index(NOISE)] = False
        added = np.where(summed, more * np.expm1(2.0 * changes), 0.0)
        share = more * np.exp(2.0 * changes) / (1.0 + added)
        found = np.where(summed, 0.5 * np.log1p(added), changes)
        return found, np.where(summed, share * scatters, scatters)


class _Arrays(NamedTuple):
    """Changes and scatters of all signatures, (S, F), and deviations of all features, (F,)."""

    changes: FloatArray
    scatters: FloatArray
    deviation: FloatArray


@lru_cache(maxsize=256)
def _arrays(table: SignatureTable) -> _Arrays:
    """Return what every cycle of every valve is judged by, made of tuples once."""
    found = _Arrays(
        np.array([s.change for s in table.signatures]),
        np.array([s.scatter for s in table.signatures]),
        np.sqrt(np.diag(table.covariance)),
    )
    for array in found:
        array.flags.writeable = False
    return found


def whitener(covariance: FloatArray) -> FloatArray:
    """Return (F, F) W: W r has unit covariance where r has `covariance`."""
    return np.linalg.inv(np.linalg.cholesky(covariance))


def held_correlations(noise: FloatArray, own: FloatArray, apart: float) -> FloatArray:
    """Return by how much correlations of noise hold for cycles that scatter by more, (F, F) [1].

    Parameters
    ----------
    noise, own : (F,) arrays
        Standard deviations of the features by noise alone, and between cycles [same unit].
    apart : float
        Share of the scatter beyond noise that has correlations of its own [1].
    """
    share = np.minimum(noise / own, 1.0)
    held = 1.0 - apart * (1.0 - np.outer(share, share))
    np.fill_diagonal(held, 1.0)
    return np.asarray(held)


def with_floor(covariance: FloatArray, floor: FloatArray) -> FloatArray:
    """Return a covariance whose standard deviations are at least `floor` (F,)."""
    missing = np.maximum(floor**2 - np.diag(covariance), 0.0)
    return covariance + np.diag(missing + 1e-4 * np.diag(covariance))
