# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Commanded strokes: eleven seeded defects and sound valves, each by its criterion; refusals."""

import dataclasses

import numpy as np
import pytest

from valve_twin.core.operation.stroke_test import StrokeLimits, StrokeVerdict, judge_stroke
from valve_twin.core.quantity import QuantityError

DT, BEGIN, BACK, END = 0.02, 3.0, 18.0, 33.0
DEFECTS = {
    "stuck": "travel",
    "late": "breakaway_s",
    "slow": "t63_s",
    "slow tail": "t86_s",
    "short": "travel",
    "too far": "travel",
    "overshoot": "overshoot",
    "sticks": "stick_s",
    "hunts": "hunting",
    "early": "early",
    "slow back": "return_s",
    "stays open": "return_error",
}
SEEDS = 4
MANY = 100


def stroke(seed, defect=""):
    """Return times, command and position of a valve: dead time, lag, slew limit, noise."""
    rng = np.random.default_rng([seed, *defect.encode()])
    time_s = np.arange(0.0, END, DT)
    size = rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 1.0)
    base = 0.0 if size > 0.0 else 1.0
    away = (time_s >= BEGIN) & (time_s < BACK)
    lag, dead, rate = rng.uniform(0.3, 1.5), rng.uniform(0.05, 0.5), rng.uniform(0.25, 2.0)
    pause, at = 0.0, rng.uniform(0.3, 0.6)
    if defect == "late":
        dead = rng.uniform(1.5, 4.0)
    if defect == "slow":
        rate = rng.uniform(0.07, 0.1)
    if defect == "sticks":
        pause = rng.uniform(1.6, 3.0)
    goal = np.where((time_s >= BEGIN + dead) & (time_s < BACK + dead), 1.0, 0.0)
    if defect == "early":
        goal[(time_s > 1.0) & (time_s < BEGIN)] = rng.uniform(0.15, 0.4)
    way, x, stood = np.zeros(len(time_s)), 0.0, 0.0
    for n in range(len(time_s)):
        back = goal[n] == 0.0 and time_s[n] >= BACK
        slew = 0.05 if defect == "slow back" and back else rate
        slew = 0.015 if defect == "slow tail" and not back and x > 0.7 else slew
        if x > at and stood < pause:
            stood += DT
        elif not (defect == "stays open" and back and x < 0.3):
            x += DT * np.clip((goal[n] - x) / lag, -slew, slew)
        way[n] = x
    since = np.clip(time_s - BEGIN - dead, 0.0, None)
    if defect == "stuck":
        way[:] = 0.0
    elif defect == "short":
        way *= rng.uniform(0.4, 0.88)
    elif defect == "too far":
        way *= rng.uniform(1.12, 1.4)
    elif defect == "overshoot":
        way += np.where(away, rng.uniform(0.3, 0.5), 0.0) * np.exp(-(((since - 5.0) / 1.0) ** 2))
    elif defect == "hunts":
        way += np.where(away, rng.uniform(0.06, 0.1), 0.0) * np.sin(since * rng.uniform(3.0, 8.0))
    noise = rng.uniform(2e-4, 0.01) * abs(size)
    position = base + size * way + noise * rng.standard_normal(len(time_s))
    return time_s, base + size * away, position


def right(seed, defect):
    found = judge_stroke(*stroke(seed, defect), limits=StrokeLimits())
    if not defect:
        return found.verdict is StrokeVerdict.PASS
    assert not (defect == "stuck" and found.verdict is StrokeVerdict.PASS)
    named = DEFECTS[defect] in {c.name for c in found.failed}
    return found.verdict is StrokeVerdict.FAIL and named


def share_right(seeds):
    verdicts = [right(seed, defect) for seed in seeds for defect in ("", *DEFECTS)]
    return np.mean(verdicts)


def test_defects_are_found_by_their_criterion_and_sound_valves_pass():
    assert share_right(range(SEEDS)) == 1.0


@pytest.mark.slow
def test_at_least_99_of_100_verdicts_are_right_over_many_seeds():
    assert share_right(range(1000, 1000 + MANY)) >= 0.99


def test_says_by_how_much_a_criterion_is_not_kept():
    time_s, command, position = stroke(2, "short")
    found = judge_stroke(time_s, command, position, limits=StrokeLimits())
    travel = next(c for c in found.failed if c.name == "travel")
    assert travel.excess == pytest.approx(travel.value - 0.05)
    wider = dataclasses.replace(StrokeLimits(), travel=travel.value)
    kept = judge_stroke(time_s, command, position, limits=wider).criteria
    assert [c.excess for c in kept if c.name == "travel"] == [0.0]


def test_times_are_those_of_a_known_motion():
    time_s = np.arange(0.0, 20.0, 0.01)
    command = np.where(time_s >= 2.0, 0.5, 0.0)
    position = np.clip((time_s - 2.5) * 0.25, 0.0, 0.5)  # 0.5 s dead time, 2 s of way
    found = judge_stroke(time_s, command, position, limits=StrokeLimits())
    values = {c.name: c.value for c in found.criteria}
    assert found.verdict is StrokeVerdict.PASS
    assert "return_s" not in values
    assert values["breakaway_s"] == pytest.approx(0.5 + 0.02 * 2.0, abs=0.03)
    assert values["t63_s"] == pytest.approx(0.5 + 0.63 * 2.0, abs=0.03)
    assert values["t86_s"] == pytest.approx(0.5 + 0.86 * 2.0, abs=0.03)
    assert values["travel"] == pytest.approx(0.0, abs=1e-12)


def test_what_is_never_reached_is_infinite():
    found = judge_stroke(*stroke(3, "stuck"), limits=StrokeLimits(t63_s=1e9, t86_s=1e9))
    assert {c.name for c in found.failed} >= {"breakaway_s", "t63_s", "t86_s", "travel"}
    assert next(c for c in found.failed if c.name == "t63_s").value == np.inf


def test_a_stroke_within_the_noise_is_refused():
    time_s, command, position = stroke(2)
    noisy = position + 0.03 * np.random.default_rng(1).standard_normal(len(time_s))
    small = judge_stroke(
        time_s, command[0] + 0.1 * (command - command[0]), noisy, limits=StrokeLimits()
    )
    assert small.verdict is StrokeVerdict.REFUSED
    assert "too small beside the noise" in small.reason


@pytest.mark.parametrize(
    ("keep", "reason"),
    [
        (slice(0, 100), "no stroke was commanded"),
        (slice(145, None), "5 samples before the command"),
        (slice(0, 155), "5 samples away"),
        (slice(0, 905), "5 samples after the return"),
        (slice(0, 12), "12 samples, needed are 20"),
    ],
)
def test_a_record_that_lacks_a_part_is_refused(keep, reason):
    parts = [values[keep] for values in stroke(2)]
    found = judge_stroke(*parts, limits=StrokeLimits())
    assert found.verdict is StrokeVerdict.REFUSED
    assert reason in found.reason


def test_two_strokes_are_refused():
    time_s, command, position = stroke(2)
    twice = [np.concatenate([v, v]) for v in (command, position)]
    found = judge_stroke(np.concatenate([time_s, time_s + END]), *twice, limits=StrokeLimits())
    assert found.verdict is StrokeVerdict.REFUSED
    assert "no single stroke" in found.reason


def test_a_copy_of_the_command_is_no_position():
    time_s, command, _ = stroke(2)
    found = judge_stroke(time_s, command, command, limits=StrokeLimits())
    assert found.verdict is StrokeVerdict.REFUSED
    assert "copy of the command" in found.reason


def test_wrong_arguments_are_errors():
    time_s, command, position = stroke(2)
    with pytest.raises(ValueError, match="give one of each a sample"):
        judge_stroke(time_s[:-1], command, position, limits=StrokeLimits())
    with pytest.raises(ValueError, match="the times do not increase"):
        judge_stroke(time_s[::-1].copy(), command, position, limits=StrokeLimits())
    with pytest.raises(QuantityError, match=r"travel = 1\.0"):
        StrokeLimits(travel=1.0)
