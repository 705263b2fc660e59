# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the survey guesses of records whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from valve_twin.core.simulation import simulate_cycles
from valve_twin.core.survey.pairs import Signal
from valve_twin.core.survey.record import propose
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import get_simulation

CYCLES = 6


def columns(**values):
    """Return signals of 10 ms, under neutral names."""
    return {
        k: Signal(k, np.arange(len(v), dtype=np.int64) * 10_000_000, np.asarray(v, dtype=float))
        for k, v in values.items()
    }


def follower(n=6000, lag=12, seed=1, noise=1e-3):
    """Return a command of steps that comes back to rest, and a first-order answer to it."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.3, 0.9, n // 200), 200) * (np.arange(n) % 600 < 400)
    y = np.zeros(n)
    for k in range(lag, n):
        y[k] = y[k - 1] + 0.1 * (u[k - lag] - y[k - 1])
    return u, y + rng.normal(0, noise, n)


def role(proposal, signal):
    return next(r for r in proposal.roles if r.signal == signal)


def test_a_follower_is_a_positioner():
    u, y = follower()
    found = propose(columns(a=y, b=u))
    assert found is not None
    assert found.model == "positioner"
    assert (role(found, "position").source, role(found, "command").source) == ("a", "b")
    assert found.period_s == pytest.approx(0.01)
    assert 12 <= found.lag <= 20
    assert found.max_delay_s > 0.12


def test_a_command_that_rests_cuts_cycles_and_one_that_does_not_gets_windows():
    u, y = follower()
    found = propose(columns(a=y, b=u))
    assert found is not None
    assert found.cycles.rule is CycleRule.REFERENCE
    assert found.cycles.values["min_cycle_s"] == pytest.approx(3.0)
    assert "9 in this record" in found.cycles.reason  # it is up at the start of the record
    rng = np.random.default_rng(0)
    wander = np.cumsum(rng.normal(0, 0.01, 6000)) + 5.0
    found = propose(columns(a=np.concatenate((wander[:1].repeat(9), wander[:-9])), b=wander))
    assert found is not None
    assert found.cycles.rule is CycleRule.WINDOW
    assert found.lag == 9


def test_a_column_in_another_unit_is_scaled_by_a_line():
    u, y = follower()
    found = propose(columns(volts=2.0 + 8.0 * u, percent=100.0 * y + 30.0))
    assert found is not None
    position, command = role(found, "position"), role(found, "command")
    mapped = (2.0 + 8.0 * u) * command.scale + command.offset
    wanted = (100.0 * u + 30.0) * position.scale
    assert np.abs(mapped - wanted).max() < 0.03


def test_a_reference_beside_the_command_is_not_taken_for_the_position():
    u, y = follower()
    found = propose(columns(reference=u, position=y, command=u))
    assert found is not None
    assert role(found, "position").source == "position"
    assert role(found, "command").source in {"reference", "command"}


def test_a_mirror_without_the_sensor_is_not_taken_for_the_measurement():
    u, y = follower(noise=0.0)
    sensor = np.concatenate((y[:2], y[:-2])) + np.random.default_rng(3).normal(0, 1e-3, len(y))
    found = propose(columns(true=y, command=u, sensor=sensor))
    assert found is not None
    assert role(found, "position").source == "sensor"
    assert role(found, "command").source == "command"


def test_a_counter_cuts_the_cycles():
    u, y = follower()
    found = propose(columns(count=np.arange(6000) // 600 + 40, a=y, b=u))
    assert found is not None
    assert role(found, "cycle_counter").source == "count"
    assert found.cycles.rule is CycleRule.COUNTER


@pytest.mark.parametrize(
    "other", [np.arange(6000), np.full(6000, 3.0), np.arange(6000) * 0.01, np.arange(6000) > 3000]
)
def test_message_numbers_constants_and_clocks_are_left_out(other):
    u, y = follower()
    found = propose(columns(other=other, a=y, b=u))
    assert found is not None
    assert found.left_out == ("other",)


def test_columns_with_little_in_them_are_left_out():
    u, y = follower()
    hollow = np.where(np.arange(6000) % 2, np.nan, y)
    found = propose(columns(hollow=hollow, a=y, b=np.where(np.arange(6000) == 7, np.nan, u)))
    assert found is not None
    assert found.left_out == ("hollow",)


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_unrelated_columns_are_not_explained(seed):
    rng = np.random.default_rng(seed)
    assert propose(columns(a=rng.normal(size=500), b=rng.normal(size=500))) is None


@pytest.mark.parametrize("columns_", [{}, columns(a=[1.0, 2.0]), columns(a=np.zeros(500))])
def test_too_little_is_not_explained(columns_):
    assert propose(columns_) is None


def press_columns(**sensor):
    config = get_simulation("press_cartridge")
    layer = replace(config.measurement, **({"noise": 1e-3, "delay": 1} | sensor))
    blocks = list(simulate_cycles(replace(config, measurement=layer), CYCLES, seed=2))
    stamp_ns = np.concatenate([b.stamp_ns for b in blocks])
    inputs = np.concatenate([b.inputs for b in blocks])
    table = {
        "reference": np.concatenate([b.reference for b in blocks]),
        "x": np.concatenate([b.position for b in blocks]),
        "down": inputs[:, 1],
        "up": inputs[:, 0],
        "true": np.concatenate([b.true_position for b in blocks]),
    }
    return {k: Signal(k, stamp_ns, v) for k, v in table.items()}


@pytest.mark.parametrize("missing", [(), ("reference",), ("true",), ("reference", "true")])
def test_two_commands_that_drive_a_rate_make_a_press_valve(missing):
    table = {k: v for k, v in press_columns().items() if k not in missing}
    found = propose(table)
    assert found is not None
    assert found.model == "press_cartridge"
    assert role(found, "spool_position").source == "x"
    assert (role(found, "v_in").source, role(found, "v_out").source) == ("up", "down")
    assert found.cycles.rule is CycleRule.COMMANDS
    assert f"{CYCLES} in this record" in found.cycles.reason
    assert found.lag in {2, 3}


@pytest.mark.parametrize("layer", [{"noise": 4e-3, "refresh": 4}, {"noise": 1e-2, "delay": 2}])
def test_a_poor_sensor_hides_neither_the_valve_nor_its_rest(layer):
    found = propose(press_columns(**layer))
    assert found is not None
    assert [r.source for r in found.roles] == ["x", "up", "down"]
    assert all(r.offset == 0.0 for r in found.roles)


def test_offsets_of_command_and_position_are_found():
    table = press_columns()
    table["up"] = replace(table["up"], values=table["up"].values + 0.03)
    table["x"] = replace(table["x"], values=table["x"].values + 0.05)
    found = propose({k: table[k] for k in ("x", "up", "down")})
    assert found is not None
    assert role(found, "v_in").offset == pytest.approx(-0.03, abs=1e-6)
    assert role(found, "spool_position").offset == pytest.approx(-0.05, abs=2e-3)
    assert role(found, "v_out").offset == 0.0


def test_a_press_position_below_zero_is_inverted():
    table = press_columns()
    table = {k: table[k] for k in ("x", "down", "up")}
    found = propose({**table, "x": replace(table["x"], values=-table["x"].values)})
    assert found is not None
    assert (role(found, "v_in").source, role(found, "v_out").source) == ("up", "down")
    position = role(found, "spool_position")
    assert (position.scale, position.offset) == (-1.0, 0.0)
    assert "inverted" in position.evidence


def test_a_press_position_at_the_upper_end_may_count_from_there():
    table = press_columns()
    table = {k: table[k] for k in ("x", "down", "up")}
    found = propose({**table, "x": replace(table["x"], values=1.0 - table["x"].values)})
    assert found is not None
    assert "if it counts from the other end: scale -1" in role(found, "spool_position").evidence


@pytest.mark.parametrize("scale", [1.0, 100.0])
@pytest.mark.parametrize("end", [0.0, 1.0])
def test_a_position_that_falls_as_its_command_rises_is_turned_round(end, scale):
    u, y = follower()
    found = propose(columns(a=scale * (end - y), b=scale * u))
    assert found is not None
    position, command = role(found, "position"), role(found, "command")
    assert (position.source, command.source) == ("a", "b")
    assert "inverted: it falls as the command rises" in position.evidence
    assert position.scale == -1.0 / scale
    mapped = scale * (end - y) * position.scale + position.offset
    wanted = scale * u * command.scale + command.offset
    assert np.abs(np.median(mapped - wanted)) < 0.02
    assert np.abs(mapped - y).max() < 0.02


def test_the_position_may_be_named():
    found = propose(press_columns(), position="true")
    assert found is not None
    assert role(found, "spool_position").source == "true"
