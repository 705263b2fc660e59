# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is told of long work where no bar can be shown."""

from __future__ import annotations

import io
import sys
import time

import pytest

from valve_twin.progress import Steps, progress


def test_a_line_says_what_is_done_and_how_long_the_rest_takes(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    steps = Steps("evaluating designs", 100)
    assert steps.line() == "evaluating designs: 0 of 100 done"
    for _ in range(60):
        steps()  # of an archive: at once
    for _ in range(40):
        now[0] += 6.0
        steps()
    steps.more(20)
    assert steps.line() == "evaluating designs: 100 of 120 done, about 2.0 min left"
    assert Steps("computing fields", None).line() == "computing fields: 0 done"


def test_lines_come_where_there_is_no_terminal(capsys):
    with progress("evaluating designs", 2, every_s=1e-3) as step:
        step()
        said, deadline = "", time.monotonic() + 60.0
        while "1 of 2 done" not in said and time.monotonic() < deadline:
            said += capsys.readouterr().err
    assert "evaluating designs: 1 of 2 done, about 0.0 min left" in said


@pytest.mark.parametrize("to", [None, "closed"])
def test_work_goes_on_where_nobody_can_be_told(to, monkeypatch):
    if to is not None:
        to = io.StringIO()
        to.close()
    monkeypatch.setattr(sys, "stderr", to)
    with progress("evaluating designs", 2, every_s=1e-3) as step:
        step()
        time.sleep(0.02)
    assert step.done == 1


def test_short_work_is_silent(capsys):
    with progress("evaluating designs", 2) as step:
        step()
    assert capsys.readouterr().err == ""
