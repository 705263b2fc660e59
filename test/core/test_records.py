# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Records as columns: named, in order, and back; what fits in no column is named."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import pytest

from valve_twin.core.records import build, columns, flat
from valve_twin.core.types import EstimateStatus


@dataclass(frozen=True)
class Part:
    name: Annotated[str, "part_names"]
    size: Annotated[float, "part_sizes"] = 0.5


@dataclass(frozen=True)
class Counts:
    used: Annotated[int, "counts_used"] = 0
    bad: Annotated[int, "counts_bad"] = 0


@dataclass(frozen=True)
class Record:
    cycle: int
    status: EstimateStatus
    parts: tuple[Part, ...] = ()
    counts: Counts = Counts()
    note: str = "none"


RECORD = Record(7, EstimateStatus.PARTIAL, (Part("a", 1.0), Part("b")), Counts(3), "seal")
FLAT = {
    "cycle": 7,
    "status": EstimateStatus.PARTIAL,
    "part_names": ["a", "b"],
    "part_sizes": [1.0, 0.5],
    "counts_used": 3,
    "counts_bad": 0,
    "note": "seal",
}


def test_columns_stand_in_the_order_of_the_fields_with_their_kinds():
    assert flat(RECORD) == FLAT
    assert list(flat(RECORD)) == list(FLAT) == [c.name for c in columns(Record)]
    kinds = [int, EstimateStatus, str, float, int, int, str]
    assert [c.kind for c in columns(Record)] == kinds
    assert [c.name for c in columns(Record) if c.many] == ["part_names", "part_sizes"]


def test_a_record_without_parts_has_empty_lists():
    assert flat(Record(1, EstimateStatus.ACCEPTED))["part_names"] == []


def test_a_record_comes_back_and_what_is_not_given_takes_its_default():
    assert build(Record, FLAT) == RECORD
    given = {k: v for k, v in FLAT.items() if k not in {"counts_bad", "note"}}
    assert build(Record, given) == Record(7, EstimateStatus.PARTIAL, RECORD.parts, Counts(3))


def test_lists_of_different_length_are_refused():
    with pytest.raises(ValueError, match="shorter"):
        build(Record, FLAT | {"part_sizes": [1.0]})


def test_a_field_that_fits_in_no_column_is_named():
    @dataclass
    class Bad:
        when: complex

    with pytest.raises(TypeError, match=r"Bad.when: .*complex.* fits in no column: make it a"):
        columns(Bad)
