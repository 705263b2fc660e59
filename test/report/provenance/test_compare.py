# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Lines that name what changed: each signal, each kind of rows, each key, each version."""

from dataclasses import replace

import pytest

from valve_twin.report.provenance.compare import (
    input_differences,
    key_differences,
    version_differences,
)
from valve_twin.report.provenance.inputs import rows_part
from valve_twin.report.provenance.record import BAG, HISTORY, Origin, Part, Provenance, versions

ROWS = [{"cycle": n, "value": n / 7.0} for n in range(5)]


def test_names_the_signal_whose_samples_changed():
    then = Origin(BAG, "bag", 9, {"command": Part(3, "a" * 64), "position": Part(3, "b" * 64)})
    now = Origin(BAG, "other", 8, {"command": Part(3, "a" * 64), "position": Part(4, "c" * 64)})
    assert input_differences(then, then) == []
    assert input_differences(then, replace(then, size=1, where="moved")) == []
    assert input_differences(then, now) == [
        "input: samples of signal 'position': 3 with sha256 bbbbbbbbbbbbbbbb in the report, "
        "4 with sha256 cccccccccccccccc in other"
    ]
    (line,) = input_differences(then, Origin(BAG, "other", 8, {"command": Part(3, "a" * 64)}))
    assert line.endswith(" in the report, none in other")


@pytest.mark.parametrize(
    ("now", "expected"),
    [
        (ROWS, "input: cycles: 2 were added, the 3 of the report are unchanged"),
        ([{"cycle": 0, "value": 1.0}, *ROWS[1:]], "input: cycles: 3 with sha256 "),
        (ROWS[:2], "input: cycles: 3 with sha256 "),
    ],
)
def test_tells_rows_that_were_added_from_rows_that_were_changed(now, expected):
    then = Origin(HISTORY, "h", 0, {"cycles": rows_part(ROWS[:3])})
    there = Origin(HISTORY, "h", 0, {"cycles": rows_part(now)})
    (line,) = input_differences(then, there, {"cycles": now})
    assert line.startswith(expected)


def test_names_the_keys():
    then = {"a": 1.0, "b": "x", "c": [1, 2], "d": float("nan")}
    now = {"a": 1.5, "c": [1, 2], "d": float("nan"), "e": True}
    assert key_differences(then, then) == []
    assert key_differences(then, now) == [
        "configuration: a: 1.0 in the report, 1.5 now",
        'configuration: b: "x" in the report, not given now',
        "configuration: e: not given in the report, true now",
    ]


def test_names_the_versions():
    here = versions()
    made = Provenance("/v", Origin(BAG, "b", 0, {}), "", "", False, here, 0)
    assert version_differences(made) == []
    older = replace(made, versions={**here, "scipy": "0.9"})
    expected = f"version: scipy: 0.9 in the report, {here['scipy']} here"
    assert version_differences(older) == [expected]
