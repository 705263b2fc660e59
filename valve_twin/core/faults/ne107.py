# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The five condensed states of NAMUR NE 107, and that of every fault of a node.

NE 107 leaves to the maker which fault gives which state; the assignment here is ours.
"""

from __future__ import annotations

from enum import Enum


class Ne107(Enum):
    """State of a valve with its monitoring, gravest first."""

    FAILURE = "failure"
    CHECK_FUNCTION = "check function"
    OUT_OF_SPECIFICATION = "out of specification"
    MAINTENANCE_REQUIRED = "maintenance required"
    GOOD = "good"

    @property
    def letter(self) -> str:
        """The letter of its sign: F, C, S, M, or N for none."""
        return _LETTERS[self]


_LETTERS = dict(zip(Ne107, "FCSMN", strict=True))

_F, _C, _S, _M = (state for state in Ne107 if state is not Ne107.GOOD)

NODE_FAULTS = {
    "input.missing": _F,
    "input.type": _F,
    "input.qos": _F,
    "input.silent": _F,
    "input.deadline": _S,
    "input.loss": _S,
    "input.overrun": _S,
    "input.gaps": _S,
    "input.unreadable": _F,
    "input.deaf": _S,
    "input.values": _S,
    "stamps.duplicate": _S,
    "stamps.late": _S,
    "clock.set_back": _S,
    "clock.offset": _S,
    "clock.sources": _C,
    "clock.waiting": _C,
    "estimation.overdue": _S,
    "estimation.dropped": _F,
    "estimation.late": _S,
    "estimation.refused": _C,
    "estimation.failed": _F,
    "estimation.worker_died": _S,
    "history.not_stored": _M,
    "history.dropped": _F,
    "history.refused": _F,
    "parameter.refused": _C,
    "twin.absent": _F,
    "assessment.failed": _F,
    "diagnosis.valve": _M,
    "diagnosis.command": _F,
    "diagnosis.sensor": _S,
    "diagnosis.supply": _S,
    "simulation.slow": _S,
    "simulation.failed": _F,
    "simulation.command": _C,
    "safety.stopped": _C,
    "recorder.loss": _S,
    "recorder.disk": _M,
}
"""State by the code of a fault of a node (`kinds`): what it says of the monitoring it disturbs."""
