# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The demo of every valve in full: live nodes, the injected drift inside the interval found."""

from __future__ import annotations

import subprocess
import sys

import pytest

from valve_twin.core.valves.registry import DEFAULT_MODEL
from valve_twin.demo.cases import case_names

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.mark.timeout(600)
@pytest.mark.parametrize("model", [name for name in case_names() if name != DEFAULT_MODEL])
def test_the_demo_of_a_valve_finds_what_was_injected(model, tmp_path):
    command = [sys.executable, "-m", "valve_twin.demo", "--valve", model, "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "inside the interval" in done.stdout
    folder = tmp_path / "1"
    assert (folder / f"{model}_report.html").is_file()
    assert (folder / f"{model}_bag" / "metadata.yaml").is_file()
    for log in folder.glob("*.log"):
        assert "Traceback" not in log.read_text(errors="replace"), log.name
