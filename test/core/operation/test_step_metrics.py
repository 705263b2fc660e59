# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Step metrics: intervals cover what simulated valves did, refusals name their reason."""

import math
from dataclasses import replace

import numpy as np
import pytest

from test.core.operation.stepping import FINE_S, make_cycle, score, step_valve
from valve_twin.core.operation.step_metrics import (
    METRICS,
    MOST_STEPS,
    Metric,
    StepMetrics,
    measure_steps,
    worth_telling,
)

DT, DEAD, LAG = 0.01, 0.12, 0.3
SEEDS = range(500, 535)


def lagging(sizes=(0.5,), *, hold=3.0, noise=1e-3, gain=1.0, lag=LAG, dt=DT, seed=1):
    """Return time, position and command of a lag with dead time that is stepped."""
    time_s = np.arange(0.0, hold * (len(sizes) + 1), dt)
    u = np.full(len(time_s), 0.2)
    x = 0.2 * np.ones(len(time_s))
    for k, size in enumerate(sizes, 1):
        since = time_s - round(k * hold / dt) * dt
        u += size * (since > -0.5 * dt)
        x += gain * size * -np.expm1(-np.clip(since - DEAD, 0.0, None) / lag)
    return time_s, x + noise * np.random.default_rng(seed).standard_normal(len(x)), u


def metric(found, name):
    return next(m for m in found.metrics if m.name == name)


def one(*arguments, **options):
    (found,) = measure_steps(make_cycle(*lagging(*arguments, **options)), ("command",))
    return found


def reasons(found):
    return {m.name: m.reason for m in found.metrics}


@pytest.mark.parametrize("kind", ["first_order", "positioner", "lagging"])
@pytest.mark.parametrize("together", [True, False])
def test_intervals_of_simulated_valves_cover(kind, together):
    told, covered, _ = score(kind, SEEDS, together=together)
    steps = 4 * len(SEEDS)
    for name in ("dead_time", "t63", "t86", "travel_gain"):
        assert told[name] > 0.7 * steps
    for name, many in told.items():
        # 95 %, four standard errors of so many draws apart; nothing less where it is a bound
        least = 0.95 - 4.0 * math.sqrt(0.05 * 0.95 / many)
        assert covered[name] / many >= least, name


def test_a_lag_with_dead_time_has_its_closed_form():
    found = one(noise=1e-4, dt=0.4 * DT)
    assert (found.step, found.command, found.size) == (1, "command", pytest.approx(0.5))
    assert found.stamp_ns == 10**12 + 3 * 10**9
    assert [m.name for m in found.metrics] == list(METRICS)

    def level(share):
        return DEAD - LAG * math.log(1.0 - share)

    wanted = {
        "dead_time": 1.5 * level(0.1) - 0.5 * level(0.3),
        "t63": level(0.63),
        "t86": level(0.86),
        "breakaway": level(0.05),
        "travel_gain": 1.0,
        "overshoot": 0.0,
    }
    for name, value in wanted.items():
        assert metric(found, name).value == pytest.approx(value, abs=3e-3), name
    assert metric(found, "t63").upper_95 - metric(found, "t63").lower_95 > 0.36 * DT  # unseen time


def test_a_falling_step_of_a_valve_with_another_gain_is_measured_alike():
    found = one((-0.1,), gain=-3.0)
    assert metric(found, "travel_gain").value == pytest.approx(-3.0, rel=0.01)
    assert "against the command" in metric(found, "t63").reason
    up, down = one((0.1,), gain=2.0), one((-0.1,), gain=2.0)
    assert metric(up, "t63").value == pytest.approx(metric(down, "t63").value, abs=0.02)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"noise": 0.03}, "the step is too small beside the noise"),
        ({"gain": 0.0}, "the step is too small beside the noise"),
        ({"dt": 0.15, "hold": 6.0}, "the sampling is too coarse"),
    ],
)
def test_what_cannot_be_told_of_the_course_is_refused_and_the_gain_is_not(options, reason):
    found = one(**options)
    assert reason in reasons(found)["dead_time"]
    assert math.isnan(metric(found, "dead_time").value)
    gain = metric(found, "travel_gain")
    assert gain.lower_95 <= options.get("gain", 1.0) <= gain.upper_95


def test_a_step_that_does_not_settle_is_refused():
    (first, second) = measure_steps(make_cycle(*lagging((0.5, 0.2), hold=0.6)), ("command",))
    for found in (first, second):
        assert len(set(reasons(found).values())) == 1
    assert reasons(first)["t63"].startswith("not settled before the next step")
    assert reasons(second)["t63"].startswith("not settled before the step")
    short, _ = measure_steps(make_cycle(*lagging((0.5, 0.2), hold=0.15)), ("command",))
    assert "15 samples until the next step" in reasons(short)["t63"]


def test_a_valve_that_hunts_is_refused():
    time_s, x, u = lagging()
    found = measure_steps(make_cycle(time_s, x + 0.02 * np.sin(9.0 * time_s), u), ("command",))
    assert "not settled" in reasons(found[0])["travel_gain"]


def test_a_sensor_that_repeats_values_is_refused_and_one_with_steps_is_wider():
    time_s, x, u = lagging()
    slow = np.repeat(x[::5], 5)[: len(x)]
    (found,) = measure_steps(make_cycle(time_s, slow, u), ("command",))
    assert "repeats" in reasons(found)["t63"]
    coarse = np.round(lagging(noise=0.0)[1] / 0.004) * 0.004
    (found,) = measure_steps(make_cycle(time_s, coarse, u), ("command",))
    gain = metric(found, "travel_gain")
    assert gain.lower_95 <= 1.0 <= gain.upper_95
    assert gain.upper_95 - gain.lower_95 > 0.004


def test_samples_that_are_not_believed_do_not_count():
    time_s, x, u = lagging()
    clean = one()
    cycle = make_cycle(time_s, x, u)
    position, valid = cycle.frames.position.copy(), cycle.frames.valid.copy()
    position[::50], valid[25::50] = np.nan, False
    position[25::50] = 40.0
    frames = replace(cycle.frames, position=position, valid=valid)
    (found,) = measure_steps(replace(cycle, frames=frames), ("command",))
    assert metric(found, "t63").value == pytest.approx(metric(clean, "t63").value, abs=1.5 * DT)
    assert (
        metric(found, "t63").lower_95 < metric(clean, "t63").value < metric(found, "t63").upper_95
    )


def test_a_cycle_without_steps_has_none_and_one_of_many_is_bounded():
    time_s, x, u = lagging()
    assert measure_steps(make_cycle(time_s, x, np.full(len(u), 0.3)), ("command",)) == ()
    assert measure_steps(make_cycle(time_s[:12], x[:12], u[:12]), ("command",)) == ()
    many = make_cycle(*lagging((0.1, -0.1) * MOST_STEPS))
    assert len(measure_steps(many, ("command",))) == MOST_STEPS


def test_a_ramp_is_no_step():
    time_s, x, _ = lagging()
    u = np.interp(time_s, [2.005, 2.305], [0.2, 0.7])
    (found,) = measure_steps(make_cycle(time_s, x, u), ("command",))
    (reason,) = set(reasons(found).values())
    assert reason == "the command is not a step: it changes over 29 samples"


def test_the_truth_of_the_simulations_is_that_of_the_closed_form():
    cycle, truth = step_valve("first_order", 1, together=True)
    assert len(truth) == 4
    assert all(t["overshoot"] < 1e-3 < FINE_S + t["t63"] < t["t86"] for t in truth)
    assert cycle.period_s >= 2 * FINE_S


def test_of_steps_that_tell_nothing_the_first_of_each_command_is_told():
    none, some = (Metric("t63", reason="too small"),), (Metric("t63", 0.1, 0.09, 0.11),)
    steps = [("a", none), ("b", none), ("a", some), ("a", none), ("b", none), ("a", some)]
    found = [StepMetrics(1, n, n, c, 0.5, m) for n, (c, m) in enumerate(steps, 1)]
    assert [s.step for s in worth_telling(found)] == [1, 2, 3, 6]
