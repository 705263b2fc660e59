# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The file of all evaluated designs."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.search.archive import Archive, header_of
from valve_twin.design.search.tasks import DesignTask, Outcome


def task_of(radius):
    design = replace(DoubleStroke(), armature_radius=radius)
    return DesignTask(f"armature_radius={radius:g}", design, {"armature_radius": radius})


def test_no_design_is_computed_twice_and_a_new_process_knows_them(archive, stand_in, tmp_path):
    tasks = [task_of(8e-3), task_of(7.9e-3), task_of(8e-3)]
    seen = []
    first = archive.outcomes(tasks, stand_in, lambda: seen.append(1))
    assert len(stand_in.keys) == len(seen) == 2
    assert first[0] == first[2]
    again = Archive(tmp_path / "archive.jsonl", header_of(DoubleStroke(), ""))
    assert again.outcomes(tasks, stand_in) == first
    assert len(stand_in.keys) == 2


def test_what_is_not_finite_comes_back(archive, tmp_path):
    odd = Outcome("a", "search", {"a": 1.0}, {"zero": math.inf}, {"force": (-math.inf,)})
    list(archive.evaluate([task_of(8e-3)], lambda tasks: [odd]))
    (found,) = Archive(tmp_path / "archive.jsonl", header_of(DoubleStroke(), ""))
    assert found == odd


def test_a_line_that_was_being_written_is_dropped(archive, stand_in, tmp_path):
    path = tmp_path / "archive.jsonl"
    archive.outcomes([task_of(8e-3), task_of(7.9e-3)], stand_in)
    path.write_bytes(path.read_bytes()[:-20])
    again = Archive(path, header_of(DoubleStroke(), ""))
    assert [of.key for of in again] == ["armature_radius=0.008"]
    again.outcomes([task_of(7.9e-3)], stand_in)
    assert len(tuple(Archive(path, header_of(DoubleStroke(), "")))) == 2


def test_the_archive_of_another_problem_is_refused_with_what_differs(archive, tmp_path):
    del archive
    with pytest.raises(ValueError, match=r"another problem: gap_ratio is .* there and .*0\.2"):
        Archive(tmp_path / "archive.jsonl", header_of(DoubleStroke(gap_ratio=0.2), ""))


def test_of_fields_that_differ_the_number_is_named(archive, tmp_path):
    """Two long mappings were shown, cut off before what differed."""
    del archive
    header = header_of(DoubleStroke(), "")
    fidelities = json.loads(json.dumps(header["fidelities"]))
    fidelities["twice"]["step"] = 3e-4
    del fidelities["evened"]["draws"]
    said = r"fidelities.twice.step is 0.0001 there and 0.0003 here; name"
    with pytest.raises(ValueError, match=said):
        Archive(tmp_path / "archive.jsonl", {**header, "fidelities": fidelities})
    fidelities["twice"]["step"] = 1e-4
    with pytest.raises(ValueError, match=r"fidelities.evened.draws is 5 there and null here"):
        Archive(tmp_path / "archive.jsonl", {**header, "fidelities": fidelities})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,b\n1,2\n", "line 1: is no archive of valve-twin design"),
        ("a drawing of mine without a last line end", "line 1: is no archive of valve-twin"),
        ("a,b\n1,2", "line 1: is no archive of valve-twin"),
        ("[" * 100_000 + "\n", "line 1: is no archive of valve-twin"),
        ('{"form": 99, "problem": {}}\n', "is no archive of valve-twin design of form 5"),
    ],
)
def test_another_file_is_no_archive(text, said, tmp_path):
    path = tmp_path / "x"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=said):
        Archive(path, header_of(DoubleStroke(), ""))
    assert path.read_text(encoding="utf-8") == text


def test_a_first_line_that_was_being_written_begins_anew(archive, stand_in, tmp_path):
    del archive
    path = tmp_path / "archive.jsonl"
    path.write_bytes(path.read_bytes()[:-20])
    Archive(path, header_of(DoubleStroke(), "")).outcomes([task_of(8e-3)], stand_in)
    assert len(tuple(Archive(path, header_of(DoubleStroke(), "")))) == 1


@pytest.mark.parametrize("line", ['{"key": "a"}', '{"key": "a", "fid\x00\x00', ""])
def test_a_line_of_something_else_is_named(line, archive, tmp_path):
    del archive
    path = tmp_path / "archive.jsonl"
    path.write_text(f"{path.read_text()}{line}\n", encoding="utf-8")
    with pytest.raises(ValueError, match="line 2: is no evaluated design: remove the line"):
        Archive(path, header_of(DoubleStroke(), ""))


def test_a_runner_that_loses_a_design_is_refused(archive):
    with pytest.raises(ValueError, match="no outcome came back of the design armature_radius"):
        archive.outcomes([task_of(8e-3)], lambda tasks: [])
