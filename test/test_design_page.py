# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What docs/design.md tells a reader to type first works, in its order."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from valve_twin.cli import main
from valve_twin.design import chain
from valve_twin.design.map import MapGrid
from valve_twin.design.wear import compute_wear

PAGE = Path(__file__).resolve().parent.parent / "docs" / "design.md"
GRID = MapGrid(currents=4, positions=4, fine=0.3)
pytestmark = pytest.mark.usefixtures("transients_once", "maps_once")
COARSE = {
    "map": ["--currents", "4", "--positions", "4", "--fine", "0.3"],
    "transient": ["--fine", "0.3", "--step", "4e-4"],
}


def test_the_fifteen_minutes_run_in_their_order(tmp_path, monkeypatch):
    """As a reader types them, on coarse fields; only the folder for results is another one."""
    quick = chain.Fidelity(GRID, fine=0.3, step=4e-4)
    for name in ("export", "usual"):  # alike: no transient field is computed twice
        monkeypatch.setitem(chain.FIDELITIES, name, quick)
    kept = (compute_wear.__defaults__ or ())[1:]
    monkeypatch.setattr(compute_wear, "__defaults__", (GRID, *kept))
    (block,) = re.findall(r"^```sh\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    lines = [line for line in block.splitlines() if not line.startswith("#")]
    assert len(lines) == 11
    for line in lines:
        program, command, *words = shlex.split(line.replace("/tmp/", f"{tmp_path}/"))
        assert (program, command) == ("tools/run", "valve-twin")
        assert main([*words, *COARSE.get(words[1], [])]) == 0, line
        for made in re.findall(r"--(?:out|svg|yaml|json) (/tmp/\S+)", line):
            assert (tmp_path / Path(made).name).exists(), line
