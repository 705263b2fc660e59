# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The five condensed states of NAMUR NE 107, and that of every fault of a node.

NE 107 leaves to the maker which fault gives which state; the assignment here is ours.
"""

from __future__ import annotations

from enum import Enum


class Ne107(Enum):
    """State of a valve with its monitoring, in the order in which one device tells several.

    Valves are ranked by `severity`: one that is checked, or of which nothing is known yet, is no
    worse than one out of its specification.
    """

    FAILURE = "failure"
    CHECK_FUNCTION = "check function"
    OUT_OF_SPECIFICATION = "out of specification"
    MAINTENANCE_REQUIRED = "maintenance required"
    GOOD = "good"

    @property
    def letter(self) -> str:
        """The letter of its sign: F, C, S, M, or N for none."""
        return _LETTERS[self]

    @property
    def severity(self) -> int:
        """How grave it is among valves, 1 .. 1000 as of an event of OPC UA [1]."""
        return _SEVERITIES[self]


_LETTERS = dict(zip(Ne107, "FCSMN", strict=True))
_SEVERITIES = dict(zip(Ne107, (900, 500, 700, 400, 100), strict=True))

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
