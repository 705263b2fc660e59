# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How any valve may be read and sampled otherwise than the twin takes for granted."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

READ_OTHERWISE: Mapping[str, Mapping[str, object]] = MappingProxyType(
    {
        "noise 1e-5": {"measurement.noise": 1e-5},
        "noise 3e-3": {"measurement.noise": 3e-3},
        "noise 1e-2": {"measurement.noise": 1e-2},
        "quantised to 0.002": {"measurement.quantum": 0.002},
        "quantised to 0.01": {"measurement.quantum": 0.01},
        "quantised to 0.03": {"measurement.quantum": 0.03},
        "a new value every 2 samples": {"measurement.refresh": 2},
        "a new value every 4 samples": {"measurement.refresh": 4},
        "a new value every 8 samples": {"measurement.refresh": 8},
        "position three samples late": {"measurement.delay": 3},
        "position ten samples late": {"measurement.delay": 10},
        "position twenty samples late": {"measurement.delay": 20},
        "position offset 0.003": {"measurement.position_offset": 0.003},
        "position offset -0.01": {"measurement.position_offset": -0.01},
        "position offset 0.03": {"measurement.position_offset": 0.03},
        "command logged 0.003 higher": {"measurement.command_offsets": (0.003,)},
        "command logged 0.01 lower": {"measurement.command_offsets": (-0.01,)},
        "command logged 0.03 higher": {"measurement.command_offsets": (0.03,)},
        "command logged 0.1 higher": {"measurement.command_offsets": (0.1,)},
        "process moves it by 3e-4": {"measurement.process_noise": 3e-4},
        "process moves it by 3e-3": {"measurement.process_noise": 3e-3},
        "all of it: noise, refresh, offset": {
            "measurement.noise": 3e-3,
            "measurement.refresh": 2,
            "measurement.position_offset": 0.003,
        },
    }
)
"""Of one command; by name."""
