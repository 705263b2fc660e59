# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The worked example of docs/diagnosis.md: a leak of the fourth cycle, by two sister presses."""

import json
import re
import shlex
import subprocess

from valve_twin.cli.main import main

EXAMPLE = re.compile(r"<!-- example begins -->\n```sh\n(.*?)```", re.DOTALL)


def test_the_example_of_the_page_tells_a_leak_of_the_fourth_cycle(root, tmp_path, monkeypatch):
    page = (root / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    (block,) = EXAMPLE.findall(page)
    monkeypatch.chdir(root / "config")
    for line in block.replace("/tmp/", f"{tmp_path}/").splitlines():
        if line.startswith("valve-twin "):
            assert main(shlex.split(line)[1:]) == 0, line
        else:
            subprocess.run(line, shell=True, check=True)
    lines = map(json.loads, (tmp_path / "leaks.jsonl").read_text(encoding="utf-8").splitlines())
    (verdict,) = (x for x in lines if x.get("kind") == "verdict")
    assert verdict["fault"] == "leak"
    assert "since cycle 4" in verdict["evidence"]
    told = "judged against the stored reference presses.reference (2 valves, 22 cycles)"
    assert told in verdict["evidence"]
