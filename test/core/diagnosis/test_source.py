# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A table of signatures becomes the file that a valve ships."""

import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from valve_twin.core.diagnosis.source import read_table, table_source
from valve_twin.core.valves import interface

VALVES = Path(interface.__file__).parent
SHIPPED = sorted(VALVES.rglob("signatures.json"))


def test_a_table_becomes_a_file_and_back(table, tmp_path, monkeypatch):
    (tmp_path / "a_strange_valve").mkdir()
    (tmp_path / "a_strange_valve" / "__init__.py").touch()
    (tmp_path / "a_strange_valve" / "signatures.json").write_text(table_source(table))
    monkeypatch.syspath_prepend(tmp_path)
    again = read_table("a_strange_valve")
    assert again == table
    assert hash(again) == hash(table)
    assert repr(again) == repr(table)


def test_a_file_that_says_of_no_feature_that_it_is_a_gain_is_read(tmp_path, monkeypatch):
    """A valve of another package, whose file an older version wrote, could not be used at all."""
    shipped = json.loads((VALVES / "positioner" / "signatures.json").read_text(encoding="utf-8"))
    del shipped["gains"], shipped["slopes"]
    (tmp_path / "an_old_valve").mkdir()
    (tmp_path / "an_old_valve" / "__init__.py").touch()
    (tmp_path / "an_old_valve" / "signatures.json").write_text(json.dumps(shipped))
    monkeypatch.syspath_prepend(tmp_path)
    read = read_table("an_old_valve")
    assert read == import_module("valve_twin.core.valves.positioner.signatures").TABLE
    assert read.gains == ("gain_up", "gain_down")


def test_a_table_without_a_number_is_not_written(table):
    with pytest.raises(ValueError, match="not JSON compliant"):
        table_source(replace(table, covariance=((float("nan"),),)))


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.relative_to(VALVES).parts[0])
def test_a_shipped_file_is_what_the_generator_writes(file):
    shipped = import_module(".".join(("valve_twin.core.valves", *module_of(file)))).TABLE
    assert table_source(shipped) == file.read_text(encoding="utf-8")


def module_of(file):
    return file.relative_to(VALVES).with_suffix("").parts
