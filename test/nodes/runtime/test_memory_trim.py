# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Memory goes back to the system after the start or a backlog and every minute, not during one."""

from __future__ import annotations

import subprocess
import sys

from valve_twin.nodes.runtime.memory_trim import BEHIND_S, EVERY_S, PAUSE_S, MemoryTrimmer


def _trimmer(most: int) -> tuple[MemoryTrimmer, list[int]]:
    """Return a trimmer that has given back what the start left, and what it does from now on."""
    done: list[int] = []
    trimmer = MemoryTrimmer(most, lambda: done.append(1))
    trimmer.look(0, 0.0, -PAUSE_S)
    assert done.pop()
    return trimmer, done


def test_without_a_backlog_memory_is_given_back_every_minute():
    trimmer, done = _trimmer(5)
    for now in range(round(EVERY_S - PAUSE_S)):
        trimmer.look(5, BEHIND_S, float(now))
    assert not done
    for now in range(round(EVERY_S - PAUSE_S), round(3 * EVERY_S - PAUSE_S)):
        trimmer.look(5, BEHIND_S, float(now))
    assert len(done) == 2


STALL = """
import os
from pathlib import Path
from valve_twin.nodes.runtime.memory_trim import EVERY_S, MemoryTrimmer

def rss_b():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

trimmer = MemoryTrimmer(5)
trimmer.look(0, 0.0, 0.0)
before = rss_b()
held = [(bytearray(50_000), bytearray(1_000)) for _ in range(1000)]
kept = [small for _, small in held]  # between the others: they hold the heap
del held
left = rss_b() - before
trimmer.look(0, 0.0, EVERY_S)
print(left, rss_b() - before)
"""


def test_what_a_short_stall_leaves_in_the_heap_goes_back_within_a_minute():
    """In a process of its own: what other tests left free in this one would be taken first."""
    said = subprocess.run([sys.executable, "-c", STALL], capture_output=True, check=True).stdout
    left, after = map(int, said.split())
    assert left > 30e6
    assert after < 0.2 * left


def test_a_start_into_a_backlog_waits_for_its_end():
    done: list[int] = []
    trimmer = MemoryTrimmer(5, lambda: done.append(1))
    trimmer.look(6, 0.0, 0.0)
    assert not done
    trimmer.look(5, 0.0, 1.0)
    assert done == [1]


def test_memory_is_given_back_once_when_the_estimations_have_caught_up():
    trimmer, done = _trimmer(5)
    trimmer.look(6, 0.0, 0.0)
    assert not done
    for now in range(1, 50):
        trimmer.look(0, 0.0, float(now))
    assert len(done) == 1


def test_late_samples_are_a_backlog_and_attempts_keep_their_distance():
    trimmer, done = _trimmer(5)
    for now in range(int(PAUSE_S) + 2):
        trimmer.look(0, 2.0 * BEHIND_S * ((now + 1) % 2), float(now))
    assert len(done) == 2
