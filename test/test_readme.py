# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What README.md tells a reader to type works, and what it points to exists."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from valve_twin.cli import main
from valve_twin.core.valves.registry import DEFAULT_MODEL, model_names
from valve_twin.demo.cases import case_names

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```sh\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
COMMANDS = [
    shlex.join(words)
    for block in BLOCKS
    for line in block.replace("\\\n", " ").splitlines()
    if (words := shlex.split(line, comments=True))
]
OFFLINE = [c for c in COMMANDS if c.startswith("tools/run valve-twin ")]
LINKED = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
TOLD_ELSEWHERE = {"damadics": "docs/damadics.md", "first_order": "docs/developers/add_a_valve.md"}
"""Pages of valves outside docs/valves: a benchmark, and the example of how to add one."""


def test_every_command_is_of_a_kind_that_is_checked():
    known = ("make ", "tools/run valve-twin ", "ros2 launch valve_twin ", "ros2 run valve_twin ")
    assert [c for c in COMMANDS if not c.startswith(known)] == []
    assert len(OFFLINE) >= 4


def test_the_offline_commands_run_in_their_order(tmp_path, monkeypatch, capsys):
    """As a reader types them: the first in processes of its own, as all of them start.

    Only the folder for results is another one.
    """
    monkeypatch.chdir(ROOT)
    for count, command in enumerate(OFFLINE):
        assert "/tmp/" in command
        adapted = command.replace("/tmp/", f"{tmp_path}/")
        words = shlex.split(adapted)
        if count == 0:
            done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
            code, said = done.returncode, done.stderr
        else:
            code, said = main(words[2:]), capsys.readouterr().err
        assert code == 0, f"{command}\n{said}"
        assert "Traceback" not in said
        for result in re.findall(r"--(?:out|json) (\S+)", adapted):
            assert Path(result).exists(), command


def test_make_targets_exist():
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    targets = [c.split()[1] for c in COMMANDS if c.startswith("make ")]
    assert targets[:2] == ["demo", "test"]
    for target in targets:
        done = subprocess.run(
            ["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


def test_the_demo_and_the_pages_of_valves_are_those_of_the_registry():
    (shown,) = re.findall(r"^Another valve: ([^;]*);", README, re.MULTILINE)
    shown = re.findall(r"`(?:make demo VALVE=)?(\w+)`", shown)
    assert sorted([DEFAULT_MODEL, *shown]) == sorted(case_names())
    (listed,) = re.findall(r"^\| \[docs/valves\]\(docs/valves\) \| ([^:]*):", README, re.MULTILINE)
    pages = sorted(page.stem for page in (ROOT / "docs" / "valves").glob("*.md"))
    assert sorted(listed.split(", ")) == pages
    assert sorted([*pages, *TOLD_ELSEWHERE]) == sorted(model_names())
    assert [page for page in TOLD_ELSEWHERE.values() if not (ROOT / page).is_file()] == []


def test_launch_files_and_their_arguments_exist():
    launches = [shlex.split(c)[3:] for c in COMMANDS if c.startswith("ros2 launch")]
    assert launches
    for file, *arguments in launches:
        text = (ROOT / "launch" / file).read_text(encoding="utf-8")
        declared = re.findall(r"DeclareLaunchArgument\(\s*\"(\w+)\"", text)
        assert {a.split(":=")[0] for a in arguments} <= set(declared), file


@pytest.mark.parametrize("page", LINKED, ids=lambda p: str(p.relative_to(ROOT)))
def test_relative_links_lead_to_something(page):
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8"))
    relative = [t for t in targets if "://" not in t]
    assert [t for t in relative if not (page.parent / t).exists()] == []


def test_folders_and_files_of_the_house_exist():
    (house,) = re.findall(r"^```\n(msg_defs/.*?)^```", README, re.MULTILINE | re.DOTALL)
    named = [line.split()[0] for line in house.splitlines()]
    named += [w for w in house.splitlines()[-1].split() if w.endswith("/")]
    assert [n for n in named if not (ROOT / n).exists()] == []


def test_named_services_exist():
    (sentence,) = re.findall(r"Services of the twin: (.*?)\n\n", README, re.DOTALL)
    for name in re.findall(r"`(\w+)`", sentence):
        file = "".join(part.capitalize() for part in name.split("_")) + ".srv"
        assert (ROOT / "msg_defs" / "srv" / file).is_file(), name


def test_message_types_of_the_topics_exist():
    rows = re.findall(r"^\| `[^`]+` \| (\w+)(\(Series\))?", README, re.MULTILINE)
    types = {name for name, _ in rows} | {f"{name}Series" for name, series in rows if series}
    own = {p.stem for p in (ROOT / "msg_defs" / "msg").glob("*.msg")}
    assert types - own == {"DiagnosticArray"}


def test_the_mapping_it_shows_is_yaml():
    (mapping,) = re.findall(r"`(v_in: \{.*?\})`", README)
    assert yaml.safe_load(mapping)["v_in"]["field"] == "position[2]"


def test_it_stays_short():
    assert len(README.splitlines()) < 150
