# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The static curve: what one cycle shows of it, and what several cycles show together.

A cycle that knows one level of the command shows where the valve settles there, not from which
command on it answers. Cycles at different levels show both: the line through what they settled at.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import Estimate, FloatArray
    from valve_twin.core.valves.positioner.fit import Record

_BIN, _HELD = 0.05, 0.05  # width of a level / range, least share of the samples in it [1], assumed
_MEDIANS = ("rate_rising", "rate_falling", "velocity_lag", "rest_level", "delay", "delay_falling")
_LEAST_SPREAD = 0.1  # levels that distinguish a line from a gain, in the greatest one [1], assumed


def shows_several_levels(record: Record) -> bool:
    """Return whether the command is held at two or more levels beside the lowest one."""
    command = record.command[record.used]
    low, span = float(command.min()), float(np.ptp(command))
    if span <= 0.0:
        return False
    bins = np.floor((command - low) / (_BIN * span) + 0.5).astype(np.int64)
    shares = np.bincount(bins) / len(bins)
    held = np.flatnonzero(shares >= _HELD)
    levels = 1 + np.count_nonzero(np.diff(held) > 1) if len(held) else 0
    return bool(levels >= 3)


def pooled(estimates: Sequence[Estimate]) -> dict[str, float]:
    """Return what cycles of a static curve know together, nothing of cycles without one.

    The curve is the line through what they settled at, rates and delays are their medians: a rate
    that one step from rest shows depends on how far the step goes.

    Parameters
    ----------
    estimates : sequence of Estimate
        Of one estimator, none refused.
    """
    commands, levels = settled(estimates)
    if not len(commands):
        return {}
    values = {}
    for name in _MEDIANS:
        known = [v for e in estimates if np.isfinite(v := e.value(name))]
        if known:
            values[name] = float(np.median(known))
    line = line_through(commands, levels)
    if line is not None:
        values["dead_command"], values["static_gain"] = line
    return values


def settled(estimates: Sequence[Estimate]) -> tuple[FloatArray, FloatArray]:
    """Return the highest commands (K,) of cycles and what the valve settled at above rest [1]."""
    rows = [
        (e.value("top_command"), e.value("top_level") - e.value("rest_level")) for e in estimates
    ]
    known = np.array([r for r in rows if np.isfinite(r).all()]).reshape(-1, 2)
    return known[:, 0], known[:, 1]


def line_through(commands: FloatArray, levels: FloatArray) -> tuple[float, float] | None:
    """Return dead command and gain of the line through settled levels, None where none shows.

    Parameters
    ----------
    commands, levels : (K,) arrays
        Commands and what the valve settled at above rest [1].
    """
    if len(commands) < 2 or np.ptp(commands) < _LEAST_SPREAD * float(np.abs(commands).max()):
        return None
    gain, offset = np.polyfit(commands, levels, 1)
    if gain <= 0.0:
        return None
    return max(float(-offset / gain), 0.0), float(gain)
