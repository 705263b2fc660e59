# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Jobs of a valve: a cycle says since when it is compared."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.twin import Job
from valve_twin.core.types import Cycle, Frames, Maintenance
from valve_twin.nodes.twin import jobs
from valve_twin.nodes.twin.live_valve import LiveValve


def cycle(number):
    one = np.zeros(1)
    frames = Frames(one.astype(np.int64), one, one[:, None], one, one, np.ones(1, dtype=bool))
    return Cycle(number, 1e-3, frames)


made: Any = SimpleNamespace  # stands in for what has only the members that are used


@pytest.mark.parametrize(
    ("events", "since"),
    [
        ([], 0),
        ([Maintenance(1, 5, "oil")], 0),
        ([Maintenance(1, 5, "pilot", new_reference=True)], 5),
        ([Maintenance(1, 5, "pilot", True), Maintenance(2, 9, "pilot", True)], 9),
        ([Maintenance(1, 5, "pilot", True), Maintenance(2, 11, "to come", True)], 5),
        ([Maintenance(1, 5, "pilot", True), Maintenance(2, 9, "pilot", True),
          Maintenance(2, 9, "pilot", True, withdrawn=True)], 5),
    ],
)  # fmt: skip
def test_a_cycle_is_compared_since_the_newest_new_reference(monkeypatch, events, since):
    monkeypatch.setattr(jobs, "longest_wait_s", lambda *_: 1.0)
    sent = []
    worker = made(submit=lambda work, arguments, done: sent.append(arguments))
    config = made(name="v", model="m", options=None, signals={})
    of = jobs.Jobs(made(post=None), config, worker=worker, deliver=lambda *_: None)
    for event in events:
        LiveValve.note(made(jobs=of), event)
    of.start(made(next_job=lambda: Job(1, cycle(10), Memory.empty())))
    assert sent[0][3].since == since
    assert sent[0][3].number == 10
