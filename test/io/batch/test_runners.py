# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Runners of many tasks; what they do with bags stands in test_archive.py."""

from __future__ import annotations

import os

import pytest

from valve_twin.io.batch.runners import LocalRunner

PID = "__import__('os').getpid()"


def lost(task, why):
    return f"{task}: {why}"


@pytest.mark.parametrize("keep", [True, False])
def test_processes_live_on_where_they_are_kept(keep):
    runner = LocalRunner(1, eval, lost, keep=keep)
    found = [pid for _ in range(2) for pid in runner((PID,))]
    assert os.getpid() not in found
    assert (found[0] == found[1]) is keep


def test_a_kept_runner_goes_on_after_a_process_died():
    runner = LocalRunner(1, eval, lost, keep=True)
    (died,) = runner(("__import__('os')._exit(3)",))
    assert "killed twice" in died
    (pid,) = runner((PID,))
    assert pid != os.getpid()
