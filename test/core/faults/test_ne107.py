# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Every fault of a node has a state of NE 107, and every state its letter."""

from __future__ import annotations

from valve_twin.core.faults.kinds import FAULT_KINDS
from valve_twin.core.faults.lifetime import Severity
from valve_twin.core.faults.ne107 import NODE_FAULTS, Ne107


def test_every_fault_of_a_node_has_a_state_and_no_other_code_has_one():
    assert sorted(NODE_FAULTS) == sorted(k.code for k in FAULT_KINDS)
    assert Ne107.GOOD not in NODE_FAULTS.values()


def test_what_only_warns_is_no_failure_unless_the_signal_is_missing():
    failing = {
        k.code
        for k in FAULT_KINDS
        if k.severity is Severity.WARN and NODE_FAULTS[k.code] is Ne107.FAILURE
    }
    assert failing <= {"input.missing", "twin.absent", "diagnosis.command", "history.dropped"}


def test_every_state_has_its_letter():
    assert "".join(state.letter for state in Ne107) == "FCSMN"
