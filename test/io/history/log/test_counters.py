# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Counters are in the history exactly where their last cycle is."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from valve_twin.core.operation.counters import Counters
from valve_twin.core.operation.events import Event, start_event
from valve_twin.io.history.log.events import Acknowledgement
from valve_twin.io.history.store import CycleRecord, CycleTakenError, History

VALVE = "/press/valve_1"


def record(number, end_ns=0):
    return CycleRecord(number, 0, end_ns or number, 10)


def test_counters_come_back_as_they_were_and_only_with_their_cycle(tmp_path):
    first = Counters(cycle=1, cycles=1, done=0.1 + 0.2, closed=-0.0, spans=(1,) * 14, rests=True)
    second = replace(first, cycle=2, cycles=2, level=1 / 3, begin=0.25, stroke=1.0, direction=-1)
    with History(tmp_path / "h.db") as history:
        assert history.log.counters(VALVE) is None
        history.store(VALVE, record(1), (), first)
        found = history.log.counters(VALVE)
        assert found is not None
        assert math.isnan(found.stroke)
        history.store(VALVE, record(2), (), second)
        # stored again, and another cycle under a number that is taken: neither counts
        doubled = replace(second, cycles=3)
        assert history.store(VALVE, record(2), (), doubled) is False
        with pytest.raises(CycleTakenError):
            history.store(VALVE, record(2, 77), (), doubled)
        assert history.log.counters("/other") is None
    with History(tmp_path / "h.db", read_only=True) as history:
        assert history.log.counters(VALVE) == second
        assert history.verify().damaged == []


def test_a_file_that_was_replaced_takes_the_counters_that_counted_more(tmp_path):
    file = tmp_path / "h.db"
    with History(file) as history:
        for n in (1, 2):
            history.store(VALVE, record(n), (), Counters(cycle=n, cycles=n))
        old = history.backup(tmp_path / "old.db")
        history.store(VALVE, record(3), (), Counters(cycle=3, cycles=3))
        history.log.add(VALVE, start_event(1, 3, "1"))
        old.replace(file)
        history.store(VALVE, record(4), (), Counters(cycle=4, cycles=4))
        assert history.log.counters(VALVE) == Counters(cycle=4, cycles=4)
        assert [c.cycle for c in history.cycles(VALVE)] == [1, 2, 3, 4]
        assert [e.code for e in history.log.events(VALVE)] == ["twin.start"]


def test_a_file_that_was_replaced_takes_what_was_acknowledged(tmp_path):
    file = tmp_path / "h.db"
    with History(file) as history:
        history.store(VALVE, record(1))
        history.log.add(VALVE, Event(1, 1, "fault.sensor_freeze", "failure", "frozen"))
        old = history.backup(tmp_path / "old.db")
        history.log.acknowledge(VALVE, 0, Acknowledgement("J. Doe", "cable renewed", 7))
        old.replace(file)
        history.store(VALVE, record(2))
        first, seen = history.log.events(VALVE)
        assert (first.acknowledged_by, first.acknowledged_at_ns) == ("J. Doe", 7)
        assert seen.code == "event.acknowledged"
        assert history.verify().damaged == []
