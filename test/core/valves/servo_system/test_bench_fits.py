# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Hysteresis loops of a record: whole ones only, and what cannot be a loop."""

import numpy as np
import pytest

from valve_twin.core.valves.servo_system.bench_fits import hysteresis_loop, split_loops
from valve_twin.core.valves.servo_system.loops import sine_response, valve_loop
from valve_twin.core.valves.servo_system.plant import ServoSystemPlant

PLANT = ServoSystemPlant()


@pytest.fixture(scope="module")
def record():
    current, position = sine_response(PLANT, 6.3, 0.06, periods=4)
    every = len(current) // 3200
    return current[::every], position[::every]


@pytest.mark.no_cover
def test_only_whole_loops_count(record):
    assert len(split_loops(*record)) == 3


def test_a_loop_has_the_width_and_area_of_the_simulated_valve(record):
    known = valve_loop(PLANT, 6.3, 0.06)
    for loop in split_loops(*record)[1:]:
        assert loop.width == pytest.approx(known.width, rel=0.01)
        assert loop.area == pytest.approx(known.area, rel=0.01)


def test_one_loop_has_no_interval(record):
    third = slice(0, len(record[0]) // 2)
    columns = dict(zip(("current", "position"), (v[third] for v in record), strict=True))
    result = hysteresis_loop(columns, {})
    assert "no interval" in result.remark
    assert all(np.isnan(v.lower) for v in result.values)


def test_what_is_no_loop_is_told(record):
    ramp = np.linspace(0.0, 1.0, 500)
    with pytest.raises(ValueError, match="no whole loop"):
        split_loops(ramp, ramp)
    with pytest.raises(ValueError, match="stands still"):
        hysteresis_loop({"current": ramp, "position": 0.0 * ramp}, {})
    with pytest.raises(ValueError, match=r"a branch of \d samples; 10 or more"):
        split_loops(record[0][::160], record[1][::160])
