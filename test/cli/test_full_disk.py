# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Verbs whose results do not find room or their folder: one line, and nothing by half."""

from __future__ import annotations

import numpy as np
import pytest

from test.cli.test_output import CONFIG
from test.io.test_whole import full_disk
from valve_twin.cli import main

ROWS = 1500
WRITING = {
    "estimate": "estimate bag --config valve.yaml --json {out}",
    "batch": "batch archive --config valve.yaml --jobs 1 --out {out}",
    "report": "report bag --config valve.yaml --out {out}",
    "convert": "convert bag --config valve.yaml --out {out}.csv",
    "cut": "cut bag --from 0 --to 50 --out {out}",
    "recover": "recover bag --out {out}",
    "import": "import m.csv --config valve.yaml --out {out}",
    "configure": "configure m.csv --yes --out {out}.yaml",
    "campaign": "campaign --model first_order --seeds 1 --json {out}",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a table, its bag, and an archive of it."""
    made = tmp_path_factory.mktemp("full")
    rng = np.random.default_rng(1)
    command = np.repeat(rng.integers(0, 2, ROWS // 50), 50).astype(float)
    position = np.zeros(ROWS)
    for i in range(1, ROWS):
        position[i] = position[i - 1] + 0.1 * (command[i - 1] - position[i - 1])
    rows = zip(0.05 * np.arange(ROWS), command, position, strict=True)
    text = "".join(f"{t:.2f},{a:g},{b:.6f}\n" for t, a, b in rows)
    (made / "m.csv").write_text(f"t,a,b\n{text}")
    (made / "valve.yaml").write_text(f"{CONFIG}    cycles: {{rule: window, window_s: 5.0}}\n")
    given = f"{made}/m.csv --config {made}/valve.yaml --out"
    for out in ("bag", "archive/bag"):
        assert main(["import", *given.split(), str(made / out)]) == 0
    return made


def left(folder) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*")}


@pytest.mark.parametrize("verb", sorted(set(WRITING) - {"batch", "campaign", "configure"}))
def test_a_full_disk_is_one_line_and_leaves_no_half_file(folder, monkeypatch, capsys, verb):
    monkeypatch.chdir(folder)
    before = left(folder)
    capsys.readouterr()
    with full_disk(300):
        code = main(WRITING[verb].format(out="out").split())
    lines = [x for x in capsys.readouterr().err.splitlines() if x.startswith("valve-twin: ")]
    assert code in (1, 2)
    assert "out" in lines[-1]
    assert "File too large" in lines[-1]
    assert "space" in lines[-1]
    assert left(folder) == before


@pytest.mark.parametrize("verb", WRITING)
def test_a_file_where_the_folder_should_be_is_one_line(folder, monkeypatch, capsys, verb):
    monkeypatch.chdir(folder)
    before = left(folder)
    capsys.readouterr()
    code = main(WRITING[verb].format(out="m.csv/out").split())
    lines = [x for x in capsys.readouterr().err.splitlines() if x.startswith("valve-twin: ")]
    assert code in (1, 2)
    assert "m.csv" in lines[-1]
    assert left(folder) == before
