# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How a stream is cut into production cycles: the `cycles` section of a configuration."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.quantity import assumed, quantity, setting
from valve_twin.core.types import CycleRule


@dataclass(frozen=True, slots=True)
class CycleConfig:
    """How the stream is cut into cycles.

    The thresholds are assumptions; `valve-twin configure` proposes them.
    """

    rule: CycleRule = setting(CycleRule.COMMANDS, "commands, counter, reference or window.")
    start_signal: str = setting(
        "",
        "Command whose rise above `threshold` opens a cycle (rule commands); empty = "
        "the model's first command.",
    )
    rearm_signal: str = setting(
        "",
        "Command that must have been above `rearm_threshold` since the last opening, "
        "such as that of the return stroke; empty = `start_signal` below `threshold`.",
    )
    threshold: float = assumed(0.02, "1", "Command level that counts as active.")
    rearm_threshold: float = assumed(
        0.2, "1", "Level of `rearm_signal` that no correction in a hold reaches."
    )
    min_cycle_s: float = assumed(
        1.0, "s", "Shortest length of a cycle cut from commands or reference.", lower=0.0
    )
    max_cycle_s: float = assumed(
        600.0, "s", "Greatest length of a cycle cut from commands or reference.", lower=1e-3
    )
    idle_close_s: float = assumed(
        60.0,
        "s",
        "A cycle closes after this long without an active command (rule commands).",
        lower=1e-3,
    )
    window_s: float = assumed(
        300.0, "s", "Length of fixed windows on the stamps (rule window).", lower=1e-3
    )
    window_offset_s: float = quantity(
        0.0, "s", "Offset of fixed windows on the stamps (rule window)."
    )
    reference_level: float = assumed(
        0.5,
        "1",
        "A cycle opens where the reference rises through the level; it re-arms below "
        "level - hysteresis.",
    )
    reference_hysteresis: float = assumed(
        0.05,
        "1",
        "A cycle opens where the reference rises through the level; it re-arms below "
        "level - hysteresis.",
        lower=0.0,
    )
