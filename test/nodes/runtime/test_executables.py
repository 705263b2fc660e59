# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A node that shows gives way to those that compute, in its session and against other ones."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from valve_twin.nodes.runtime import executables

GROUP = Path("/proc/self/autogroup")
SHOWN = f"""
import os
from pathlib import Path
from valve_twin.nodes.runtime.executables import give_way

give_way(7)
group = Path({str(GROUP)!r})
print(os.getpriority(os.PRIO_PROCESS, 0), group.read_text() if group.exists() else "")
"""


@pytest.mark.parametrize("leads", [True, False])
def test_a_service_gives_way_to_those_of_other_sessions(leads):
    """With `nice` alone two sessions got a processor each by half."""
    command = [sys.executable, "-c", SHOWN]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, start_new_session=leads
    )
    priority, *group = done.stdout.split()
    assert int(priority) == os.getpriority(os.PRIO_PROCESS, 0) + 7
    if group and leads:  # Linux shows none where it groups by control groups alone
        assert group[-1] == "7"
    elif GROUP.exists():
        assert group == GROUP.read_text(encoding="ascii").split()


def test_of_two_services_that_begin_together_both_give_way(monkeypatch):
    """Linux refused the second within 0.1 s, and its session kept its priority."""
    refused, lowered = [1, 2], []

    def written(path: Path, text: str, encoding: str) -> None:
        del encoding
        if refused:
            refused.pop()
            raise BlockingIOError
        lowered.append((path, text))

    monkeypatch.setattr(os, "nice", lambda by: by)
    monkeypatch.setattr(os, "getsid", lambda of: os.getpid() if of == 0 else of)
    monkeypatch.setattr(Path, "write_text", written)
    executables.give_way(10)
    assert lowered == [(GROUP, "10")]
