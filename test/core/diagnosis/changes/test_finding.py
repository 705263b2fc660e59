# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Clocks apart hide no fault: it is told first, and they beside it."""

import math
from dataclasses import replace

from valve_twin.core.diagnosis.changes.finding import (
    LATELY,
    Diagnosis,
    Finding,
    clocks_beside,
    describe_finding,
    lately_over,
)


def finding(name, part, onset, end=-1):
    return Finding(name, (), part, 0.1, 9.0, onset, onset + 2, end)


CLOCK = finding("clock", "sensor", 1)


def test_a_fault_is_told_before_clocks_that_run_apart():
    leak = finding("leak", "valve", 14)
    found = Diagnosis((leak, CLOCK), 40, ready=True)
    assert (found.present, found.clocks) == (leak, CLOCK)


def test_what_clocks_apart_look_like_is_told_as_clocks():
    gas = finding("aeration", "valve", 14)
    assert Diagnosis((gas, CLOCK), 40, ready=True).present is CLOCK
    assert Diagnosis((gas,), 40, ready=True).present is gas


def test_clocks_are_told_where_no_other_fault_lasts():
    found = Diagnosis((finding("leak", "valve", 14, end=20), CLOCK), 40, ready=True)
    assert (found.present, found.clocks) == (CLOCK, None)


def test_clocks_are_told_beside_a_fault_and_alone_by_the_verdict():
    leak = Finding("leak", (), "valve", 1e-3, 9.0, 14, 20)
    clock = Finding("clock", (), "sensor", 3e-4, 20.0, 1, 40)
    beside = clocks_beside(Diagnosis((leak, clock), 40, ready=True))
    assert beside.startswith("beside it clocks of position and commands apart, by 300 ppm")
    assert clocks_beside(Diagnosis((clock,), 40, ready=True)) == ""


def test_a_fault_that_is_over_is_told_for_a_while_where_none_lasts():
    gone = finding("leak", "valve", 14, end=20)
    older = finding("stiction", "valve", 3, end=9)
    said = lately_over(Diagnosis((older, gone), 22, ready=True), 22)
    assert said.startswith("a fault is over since cycle 20: leak of the chamber")
    assert "since cycle 14" in said
    assert lately_over(Diagnosis((gone,), 60, ready=True), 20 + LATELY) == ""
    unseen = replace(gone, end_seen=False)
    assert lately_over(Diagnosis((older, unseen), 22, ready=True), 22).startswith(
        "a fault is over since cycle 9"
    )
    assert lately_over(Diagnosis((older, gone), 22, ready=True), 22, since=15) == ""
    lasts = finding("stiction", "valve", 21)
    assert lately_over(Diagnosis((gone, lasts), 22, ready=True), 22) == ""


def test_a_size_that_no_signature_tells_is_said_and_hides_neither_evidence_nor_rivals():
    found = replace(finding("sticking", "valve", 14), severity=math.nan, rivals=("lost_motion",))
    said = describe_finding(found)
    assert "size unknown, since cycle 14 (9.0 standard deviations of one cycle)" in said
    assert said.endswith("the data fit as well: lost motion (play), share of the travel")
    jam = replace(finding("no_motion", "valve", 14), severity=math.nan)
    assert "size" not in describe_finding(jam)  # of which there is no more and no less
