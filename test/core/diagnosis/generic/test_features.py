# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a cycle shows: each feature against the difference that it stands for."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.features import FeatureSet
from valve_twin.core.diagnosis.generic.features import (
    DEVIATION,
    NAMES,
    Record,
    cycle_features,
    feature_set,
)

PERIOD_S, SPAN = 0.05, 0.8
NONE = np.zeros((400, 0))


@pytest.fixture
def shown(motion):
    """A function that returns the features of a measured position."""

    def show(position, *, commands=NONE, missing=0.0, response=motion):
        return cycle_features(Record(position, response, PERIOD_S, commands, missing))

    return show


def test_a_position_like_the_models_differs_in_nothing(motion, shown):
    found = shown(motion)
    assert [found[n] for n in ("gain_up", "gain_down")] == pytest.approx([1.0, 1.0])
    noises = {"rest_noise", "move_noise"}
    apart = {"gain_up", "gain_down", "saturated", *noises}
    assert np.abs([v for n, v in found.items() if n not in apart]).max() < 1e-12
    assert max(found[n] for n in noises) < 1e-6


def test_an_offset_moves_the_level_alone(motion, shown):
    found = shown(motion + 0.004)
    assert found["level_zero"] == pytest.approx(0.004 / SPAN, rel=0.02)
    assert found[DEVIATION] == pytest.approx(0.004 / SPAN, rel=0.02)
    left = [found[n] for n in ("level_gain", "level_bend", "lag_up", "slow_down", "short_up")]
    assert np.abs(left).max() < 1e-9


def test_a_gain_of_the_sensor_is_a_slope_over_the_level(motion, shown):
    found = shown(1.01 * motion)
    assert found["level_gain"] == pytest.approx(0.01, rel=1e-6)
    assert found["level_zero"] == pytest.approx(0.0, abs=1e-9)
    assert [found["gain_up"], found["gain_down"]] == pytest.approx([1.01, 1.01], rel=1e-3)


def test_a_delay_is_found_in_seconds(motion, shown):
    n = np.arange(400.0)
    found = shown(np.interp(n - 0.2, n, motion))
    assert [found["lag_up"], found["lag_down"]] == pytest.approx([0.01, 0.01], rel=0.15)
    assert abs(found["level_gain"]) < 3e-4


def test_a_slower_move_up_is_no_slower_move_down(motion, shown):
    n = np.arange(100.0)
    slower = motion.copy()
    slower[100:200] = np.interp(n / 1.05, n, motion[100:200])
    found = shown(slower)
    assert found["slow_up"] > 0.01
    assert abs(found["slow_down"]) < 0.05 * found["slow_up"]


def test_a_lost_move_is_counted_and_spoils_nothing_else(motion, shown):
    lost = motion.copy()
    lost[200:300] = motion[199]
    lost[300:] = motion[300:] + (motion[199] - motion[300]) * np.exp(-np.arange(100) / 8.0)
    found = shown(lost)
    assert found["unfollowed"] == pytest.approx(0.25)
    assert not np.isfinite([found[n] for n in ("level_zero", "gain_up", "rough_move")]).any()


@pytest.mark.parametrize("factor", [1.0, 2.5, 7.0])
def test_noise_is_that_of_the_sensor_where_the_model_errs_in_moves(motion, shown, factor):
    n = np.arange(400.0)
    late = np.interp(n - 2.0, n, motion)
    noise = factor * 3e-4 * np.random.default_rng(8).standard_normal(400)
    found = shown(late + noise)
    assert found["rest_noise"] == pytest.approx(factor * 3e-4 / SPAN, rel=0.2)
    assert found["move_noise"] > 1.5 * 3e-4 / SPAN


def test_a_rounded_position_has_at_least_the_noise_of_rounding(motion, shown):
    step = 0.8 * 2.0**-8
    found = shown(step * np.round(motion / step))
    assert found["rest_noise"] == pytest.approx(step / SPAN / np.sqrt(12.0), rel=1e-4)
    rng = np.random.default_rng(9)
    louder = motion + step * rng.standard_normal(400)
    found = shown(step * np.round(louder / step))
    assert found["rest_noise"] == pytest.approx(step / SPAN * np.sqrt(1.0 + 1.0 / 12.0), rel=0.2)


def test_noise_and_repeats_are_measured(motion, shown):
    rng = np.random.default_rng(3)
    noisy = motion + 1e-3 * rng.standard_normal(400)
    found = shown(noisy)
    assert found["rest_noise"] == pytest.approx(1e-3 / SPAN, rel=0.15)
    assert found["move_noise"] == pytest.approx(1e-3 / SPAN, rel=0.2)
    assert found["rough_rest"] == pytest.approx(1e-3 / SPAN, rel=0.15)
    noisy[1::2] = noisy[::2]
    assert shown(noisy)["repeats"] == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("asks", [0.0, 0.04])
def test_a_cycle_that_asks_for_nearly_no_motion_tells_nothing(motion, asks):
    """A loop that rests repeats a rounded position, and follows no noise of its command."""
    response = 0.4 + asks * (motion - motion[0])
    rested = cycle_features(Record(np.full(400, 0.4), response, PERIOD_S, NONE, span=SPAN))
    assert not np.isfinite(list(rested.values())).any()
    moved = cycle_features(Record(np.full(400, 0.4), motion, PERIOD_S, NONE, span=SPAN))
    assert moved["repeats"] == 1.0
    assert moved["unfollowed"] > 0.5


def test_a_command_at_its_end_is_counted(motion, shown):
    commands = np.where(np.arange(400) < 100, 1.0, 0.3)[:, None]
    assert shown(motion, commands=commands)["saturated"] == pytest.approx(0.25)
    assert np.isnan(shown(motion)["saturated"])


def test_without_a_response_only_the_signals_show(motion, shown):
    found = shown(motion, response=np.full(400, np.nan))
    assert {n for n, v in found.items() if np.isfinite(v)} == {"repeats"}


def test_what_was_lost_on_the_way_is_no_fault(motion, shown):
    assert not np.isfinite(list(shown(motion, missing=0.02).values())).any()


def test_a_valve_excludes_adds_and_bounds():
    own = FeatureSet(("heat",), frozenset(("heat",)))
    mine = feature_set(("saturated",), own, least={"level_zero": 1e-3})
    assert mine.names == (*(n for n in NAMES if n != "saturated"), "heat")
    assert "saturated" not in mine.shares
    assert "heat" in mine.relative
    usual = feature_set().least
    assert set(usual) == {"saturated", "rough_rest", "rough_move"}
    kept = {n: usual[n] for n in ("rough_rest", "rough_move")}
    assert mine.least == {**kept, "level_zero": 1e-3}
    assert feature_set(least={"rough_rest": 0.4}).least["rough_rest"] == 0.4
    assert mine.of_any_valve


def slow_valve(levels, start):
    """Return a flap in 0.5 s samples whose rate fades by the root of what it lacks."""
    x, out = start, []
    for wanted in np.repeat(levels, 120):
        out.append(x)
        lack = wanted - x
        x += np.sign(lack) * min(0.03 * np.sqrt(abs(lack)), abs(lack))
    return np.array(out)


SLOW_LEVELS = (0.2, 0.5, 0.3, 0.8, 0.2)


@pytest.mark.parametrize("shift", [0.18, -0.15])
def test_a_shifted_zero_of_a_slow_valve_is_no_lost_command(shift):
    """The model is set on the first position and leaves it: what it does there is no move."""
    measured = slow_valve(SLOW_LEVELS, SLOW_LEVELS[0]) + shift
    response = slow_valve(SLOW_LEVELS, SLOW_LEVELS[0] + shift)
    found = cycle_features(Record(measured, response, 0.5, NONE))
    assert found["unfollowed"] == 0.0
    assert found["level_zero"] == pytest.approx(shift / np.ptp(response), rel=0.1)
    assert found["gain_up"] == pytest.approx(1.0, abs=0.02)


def test_a_zero_that_is_shifted_below_the_end_of_the_sensor_is_no_lost_command():
    levels = (0.0, 0.15, 0.5, 0.15, 0.0)
    response = slow_valve(levels, 0.0)
    measured = np.maximum(response - 0.09, 0.0)
    found = cycle_features(Record(measured, response, 0.5, NONE))
    assert found["unfollowed"] == 0.0
    assert found["gain_down"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("move", [1, 2, 4])
def test_a_lost_move_of_a_slow_valve_is_one_of_its_moves(move):
    response = slow_valve(SLOW_LEVELS, SLOW_LEVELS[0])
    done = [*SLOW_LEVELS[:move], SLOW_LEVELS[move - 1], *SLOW_LEVELS[move + 1 :]]
    found = cycle_features(Record(slow_valve(done, done[0]), response, 0.5, NONE))
    assert found["unfollowed"] == pytest.approx(0.25)
    assert np.isnan(found["level_zero"])


def test_how_long_a_switched_command_is_on_says_nothing(motion, shown):
    on = np.where(np.arange(400) < 100, 1.0, 0.0)
    assert np.isnan(shown(motion, commands=on[:, None])["saturated"])
    steered = np.where(np.arange(400) < 100, 0.3, 0.2 + 1e-3 * np.arange(400))
    beside = np.stack((on, steered), axis=1)
    assert shown(motion, commands=beside)["saturated"] == 0.0
    assert shown(motion, commands=np.ones((400, 1)))["saturated"] == 1.0
