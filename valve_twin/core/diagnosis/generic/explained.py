# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How much of what a cycle differs from its model each fault of any valve explains.

The free run is changed by each fault at some sizes, as a sensor behind that fault would show it;
what of the squared difference is left is a number that needs no noise, no scatter and no table. A
fault that begins explains more than in the cycles before it, whatever the model lacks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.generic.faults import FAULTS, Sensed, slipping, source
from valve_twin.core.diagnosis.generic.features import span_of, thinned
from valve_twin.core.diagnosis.generic.moves import find_moves
from valve_twin.core.types import Parameter, ParameterValue

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.diagnosis.generic.features import Record
    from valve_twin.core.diagnosis.generic.moves import Move
    from valve_twin.core.types import BoolArray, FloatArray

EXPLAINED = "explained."
"""With what the names of these numbers begin."""

_WIDTHS = np.geomspace(0.004, 0.4, 12)
"""Sizes that are tried of faults that are lengths, assumed: shares of the span [1]."""

_SLOWER = np.geomspace(0.03, 2.0, 11)
"""Sizes that are tried of slower moves, assumed [1]."""

_JUMPS = (1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Slip jumps of what sticks that are tried, assumed [share of the stick band]."""

_LATER = np.concatenate((np.arange(0.5, 4.0, 0.5), np.geomspace(4.0, 60.0, 11)))
"""Delays that are tried, assumed [samples]."""

_WAVES = np.geomspace(7.0, 32.0, 40)
"""Periods of an oscillation that are tried, those of `FAULTS` and a little beyond [samples]."""

_SLOWED = ("slow", "slow_up", "slow_down")
_SHAPES = ("lost_motion", "end_stop_upper", "end_stop_lower", "delay", *_SLOWED)
"""Faults whose response is that of `FAULTS`, size by size."""

NAMED = ("sensor_gain", "command_loss", "oscillation", "sticking", *_SHAPES)
"""Faults of which it is told how much they explain."""

PARAMETERS = tuple(
    Parameter(f"{EXPLAINED}{n}", "1", f"what {n} explains: logarithm of squares over those left")
    for n in NAMED
)
"""What these numbers are."""

_FLOOR = 1e-3
"""Difference below which nothing needs explaining, assumed: share of the span; a small fault of a
valve without noise is named by its features [1]."""


def explained(record: Record) -> dict[str, float]:
    """Return by fault how much it explains of the difference from the model; empty = not known.

    Parameters
    ----------
    record : Record
        Measured and expected.

    Returns
    -------
    dict of str to float
        Logarithm of the squared difference over what is left of it [1], both about their mean:
        where the free run drifts, its level says nothing.
    """
    record = thinned(record)
    y, m, span = record.position, record.response, span_of(record)
    if not span > 0.0:
        return {}
    told = np.isfinite(m)
    known = np.isfinite(y) & told
    place = np.arange(len(m), dtype=np.float64)
    motion = np.interp(place, place[told], m[told]) / span
    measured = np.where(known, y / span, motion)
    off = (measured - motion)[known]
    moves = find_moves(motion)[0]
    left = _left(off)
    found = {
        "sensor_gain": np.log(left / _behind_gain(off, motion[known])),
        "command_loss": np.log(left / _left((measured - _lost(measured, motion, moves))[known])),
        "oscillation": np.log(left / _behind_wave(measured - motion, known)),
        "sticking": np.log(left / _behind_slips(measured, motion, known)),
    }
    period_s = record.period_s
    sensed = Sensed(motion, np.zeros(len(motion)), period_s, source(0, 0), moves)
    for name in _SHAPES:
        sizes = _sizes(name, period_s)
        shown = np.array([measured - FAULTS[name](sensed, float(size)) for size in sizes])
        found[name] = np.log(left / min(_left(row) for row in shown[:, known]))
    return {name: float(max(value, 0.0)) for name, value in found.items()}


def values(record: Record) -> list[ParameterValue]:
    """Return the same as parameters of an estimate."""
    return [ParameterValue(f"{EXPLAINED}{n}", v) for n, v in explained(record).items()]


def _sizes(name: str, period_s: float) -> FloatArray:
    if name == "delay":
        return np.asarray(_LATER * period_s)
    return _SLOWER if name in _SLOWED else _WIDTHS


def _left(off: FloatArray) -> float:
    """Return the mean square of a difference about its mean, and of what needs no explaining."""
    return float(np.var(off)) + _FLOOR**2


def _behind_gain(off: FloatArray, motion: FloatArray) -> float:
    """Return what is left of a difference behind the gain that fits it best."""
    about = motion - motion.mean()
    return _left(off - about * (about @ off) / (about @ about))


def _behind_wave(off: FloatArray, known: BoolArray) -> float:
    """Return what is left of a difference (N,) behind the wave that fits it best."""
    about = np.where(known, off - off[known].mean(), 0.0)
    turns = np.exp(-2j * np.pi * np.outer(1.0 / _WAVES, np.arange(len(off))))
    most = float((np.abs(turns @ about) ** 2).max())
    count = np.count_nonzero(known)
    return max(float(about @ about) - 2.0 * most / count, 0.0) / count + _FLOOR**2


def _behind_slips(measured: FloatArray, motion: FloatArray, known: BoolArray) -> float:
    """Return what is left of a difference behind the stick band and slip jump that fit it best."""
    shown = (slipping(motion, float(s), j) for s in _WIDTHS for j in _JUMPS)
    return min(_left((measured - row)[known]) for row in shown)


def _lost(measured: FloatArray, motion: FloatArray, moves: Sequence[Move]) -> FloatArray:
    """Return the motion without the moves that were rather lost than made, (N,) [1]."""
    out, off = motion.copy(), 0.0
    for move in moves:
        part, begin = slice(move.first, move.next), float(motion[move.first])
        way = np.minimum(np.abs((motion[part] - begin) / move.way), 1.0)
        made = motion[part] + off * (1.0 - way)
        lost = np.full(len(made), begin + off)
        is_lost = _squares(measured[part] - lost) < _squares(measured[part] - made)
        out[part] = lost if is_lost else made
        off = begin + off - float(motion[move.next - 1]) if is_lost else 0.0
    return out


def _squares(off: FloatArray) -> float:
    return float(off @ off)
