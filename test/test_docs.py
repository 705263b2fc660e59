# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The documents for developers: every section that is cited exists, every room is drawn."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DEVELOPERS = ROOT / "docs" / "developers"
CITING = ("valve_twin", "test", "docs", "tools", "config")
CITATION = re.compile(
    r"equations\.md,?\s+(?:section\s+)?(\d(?:\.\d)?)(?:\s*\((\d)\)|,\s+item\s+(\d))?"
)


def test_every_cited_section_of_the_equations_exists():
    sections = equations()
    cited = list(citations())
    assert len(cited) > 40
    for path, number, item in cited:
        assert number in sections, f"{path} cites section {number}"
        if item:
            listed = re.findall(r"^(\d)\. ", sections[number], re.MULTILINE)
            assert item in listed, f"{path} cites item {item} of section {number}"


def equations() -> dict[str, str]:
    """Return the text of every section by its number."""
    text = (DEVELOPERS / "equations.md").read_text(encoding="utf-8")
    parts = re.split(r"^##+ (\d(?:\.\d)?)\.? .*$", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def citations():
    """Yield file, section and item of every citation."""
    for folder in CITING:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in {".py", ".md", ".yaml"} and path != Path(__file__):
                text = re.sub(r"\n\s*#?\s*", " ", path.read_text(encoding="utf-8"))
                for number, item, other in CITATION.findall(text):
                    yield path.relative_to(ROOT), number, item or other


def test_the_picture_shows_every_room():
    picture = (DEVELOPERS / "architecture.svg").read_text(encoding="utf-8")
    rooms = {p.name for p in (ROOT / "valve_twin").iterdir() if (p / "__init__.py").is_file()}
    within = {
        p.name
        for room in ("core", "io", "nodes")
        for p in (ROOT / "valve_twin" / room).iterdir()
        if (p / "__init__.py").is_file()
    }
    assert [r for r in sorted(rooms | within) if f">{r}<" not in picture] == []


def test_no_room_of_the_picture_lies_on_another_or_beyond_its_floor():
    picture = (DEVELOPERS / "architecture.svg").read_text(encoding="utf-8")
    found = re.findall(
        r'<rect class="(\w+)" x="(.+?)" y="(.+?)" width="(.+?)" height="(.+?)"', picture
    )
    boxes = [(kind, *map(float, at)) for kind, *at in found]
    rooms = [b[1:] for b in boxes if b[0] == "room"]
    floors = [b[1:] for b in boxes if b[0] in {"floor", "core"}]
    for i, (x, y, wide, high) in enumerate(rooms):
        for a, b, w, h in rooms[:i]:
            assert x >= a + w or a >= x + wide or y >= b + h or b >= y + high, (x, y, a, b)
        on = [f for f in floors if f[1] < y + high and y < f[1] + f[3] and f[0] < x + wide]
        on = [f for f in on if x < f[0] + f[2]]
        for a, b, w, h in on:
            assert a <= x < x + wide <= a + w, (x, y)
            assert b <= y < y + high <= b + h, (x, y)
    assert len(rooms) > 30


def test_what_the_documents_for_developers_name_exists():
    for page in sorted(DEVELOPERS.glob("*.md")):
        for name in re.findall(r"`([a-z_]+/[\w/.]*)`", page.read_text(encoding="utf-8")):
            found = [(ROOT / name).exists(), (ROOT / "valve_twin" / name).exists()]
            assert any(found), f"{page.name} names {name}"


def test_the_index_leads_to_every_page():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = {p.stem for p in (ROOT / "docs").glob("*.md")} - {"index"}
    assert sorted(set(re.findall(r"^([a-z_]+)$", index, re.MULTILINE)) - {"toctree"}) == sorted(
        pages
    )
    for folder in ("valves", "developers"):
        assert f"\n{folder}/*\n" in index


def test_the_table_of_the_worst_caller_names_every_service():
    text = (ROOT / "docs" / "operation.md").read_text(encoding="utf-8")
    table = text.partition("What the worst caller")[2].partition("```")[0]
    kinds = [path.stem for path in (ROOT / "msg_defs" / "srv").glob("*.srv")]
    names = [re.sub(r"(?<!^)(?=[A-Z])", "_", kind).lower() for kind in kinds]
    rows = [line for line in table.splitlines() if line.startswith("| ")]
    known = set(re.findall(r"[`/](\w+)`", "\n".join(row.split(" | ")[0] for row in rows)))
    assert sorted(set(names) - known) == []


def test_latched_topics_are_echoed_by_the_line_that_works():
    """The default of `ros2 topic echo` is best effort, which is sent nothing that is latched."""
    for name in ("README.md", "docs/troubleshooting.md"):
        lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
        found = [line for line in lines if "ros2 topic echo --" in line]
        assert found, name
        for line in found:
            assert "--qos-durability transient_local --qos-reliability reliable" in line
