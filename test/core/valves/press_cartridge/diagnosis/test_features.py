# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Features tell physical sizes, one by one, and nothing where the cycle shows nothing."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import to_frames
from valve_twin.core.types import Cycle, EstimateStatus, ParameterStatus
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.press_cartridge.diagnosis.features import (
    COUNTS,
    FEATURES,
    NAMES,
    RELATIVE,
)
from valve_twin.core.valves.registry import complete_options

OPTIONS = complete_options(MODEL, {"estimators": ["output_error", "features"]})


def change(rig, started, kind, severity, name, cycles=3):
    """Return the mean change of a feature by a fault, as it is followed."""
    healthy, faulty = (
        rig.run(valve, cycles)[1:] for valve in (started(), started(kind, severity))
    )
    return float((faulty - healthy).mean(axis=0)[NAMES.index(name)])


def test_an_offset_of_the_sensor_is_the_rest_level(rig, started):
    # below the dead band of the controller, 2e-3, which would act on a larger one
    moved = change(rig, started, "sensor_offset", 1.5e-3, "rest_level")
    assert moved == pytest.approx(1.5e-3, abs=5e-5)


def test_a_leak_is_the_slope_in_hold(rig, started):
    # the spool is moved at the pressure of balance: 2 % of the rate
    assert change(rig, started, "leak", 1e-3, "hold_slope") == pytest.approx(-1e-3, rel=0.02)


def test_a_sensor_gain_scales_both_directions(rig, started):
    for name in ("gain_in_high", "gain_out_high"):
        moved = change(rig, started, "sensor_gain", 0.05, name)
        assert moved == pytest.approx(np.log(1.05), abs=0.012)


def test_a_dead_band_takes_more_of_small_commands(rig, started):
    small = change(rig, started, "dead_band", 0.01, "gain_in_low")
    large = change(rig, started, "dead_band", 0.01, "gain_in_high")
    assert small < 2.0 * large < 0.0


def test_gas_in_the_chamber_delays_the_opening(rig, started):
    assert change(rig, started, "aeration", 0.1, "delay_in") > 5e-3


def test_a_freezing_sensor_repeats_its_values(rig, started):
    share = change(rig, started, "sensor_freeze", 0.1, "repeats")
    assert share == pytest.approx(0.1, abs=0.03)  # 2 * 850 draws: three deviations are 0.022


def coarse(started, move, step=4.7e-3, noise=0.0):
    """Return features of a cycle whose sensor has steps and is off by a number of them."""
    frames = to_frames(started().advance(850))
    rng = np.random.default_rng(1)
    seen = frames.position + move * step + noise * step * rng.standard_normal(len(frames))
    frames = replace(frames, position=step * np.round(seen / step))
    return {p.name: p.value for p in MODEL.features(Cycle(2, 0.03, frames), OPTIONS)}


def test_a_level_between_two_steps_of_the_sensor_is_not_told(started):
    assert coarse(started, 0.1)["rest_level"] == pytest.approx(0.0, abs=1e-9)
    assert coarse(started, 1.1)["rest_level"] == pytest.approx(4.7e-3, abs=1e-9)
    assert np.isnan(coarse(started, 0.5, noise=0.1)["rest_level"])


def test_noise_that_carries_a_sensor_over_its_steps_tells_the_level(started):
    # 130 samples of 1.0 steps: 0.09 steps
    level = coarse(started, 0.5, noise=1.0)["rest_level"]
    assert level == pytest.approx(0.5 * 4.7e-3, abs=3 * 0.09 * 4.7e-3)


def test_a_sensor_between_two_of_its_steps_is_not_noisier_than_one_beside(started):
    beside, between = (coarse(started, m, noise=0.05) for m in (0.42, 0.5))
    known = [v["rest_noise"] for v in (beside, between) if np.isfinite(v["rest_noise"])]
    assert known
    assert known == pytest.approx([4.7e-3] * len(known))


def test_a_gain_of_small_commands_that_noise_hides_is_not_told(started):
    frames = to_frames(started().advance(850))
    rng = np.random.default_rng(1)
    noisy = replace(frames, position=frames.position + 0.05 * rng.standard_normal(len(frames)))
    shown, hidden = (
        {p.name: p for p in MODEL.features(Cycle(2, 0.03, f), OPTIONS)} for f in (frames, noisy)
    )
    assert shown["gain_in_low"].status is ParameterStatus.OK
    assert hidden["gain_in_low"].status is ParameterStatus.NOT_EXCITED
    assert not hidden["weak_small"].value > 0.0  # that it has no effect is not known


def test_lost_samples_are_no_feature(started):
    frames = to_frames(started("lost_samples", 0.05).advance(850))
    values = MODEL.features(Cycle(2, 0.03, frames), OPTIONS)
    assert {p.reason for p in values} == {"samples are missing"}
    assert np.isnan(MODEL.feature_set.vector(values)).all()


def test_a_cycle_without_motion_says_what_it_lacks(started):
    frames = to_frames(started("stuck").advance(850))
    values = {p.name: p for p in MODEL.features(Cycle(2, 0.03, frames), OPTIONS)}
    assert values["gain_in_low"].status is ParameterStatus.NOT_EXCITED
    assert values["stuck"].value > 0.0


def test_few_or_bad_samples_never_raise(started):
    frames = to_frames(started().advance(850))
    for count in (1, 2, 7, 40):
        assert len(MODEL.features(Cycle(2, 0.03, frames[:count]), OPTIONS)) == len(
            FEATURES + COUNTS
        )
    frames.position[::3] = np.nan
    frames.inputs[::7] = np.nan
    assert len(MODEL.features(Cycle(2, 0.03, frames), OPTIONS)) == len(FEATURES + COUNTS)


def test_they_are_an_estimate_beside_the_others_that_feeds_no_trend(started):
    cycle = Cycle(2, 0.03, to_frames(started().advance(850)))
    estimates, memory = estimate_cycle(MODEL, OPTIONS, cycle, Memory.empty())
    found = {e.estimator: e for e in estimates}
    assert list(found) == ["output_error", "features"]
    assert found["features"].status is EstimateStatus.ACCEPTED
    assert not found["features"].used_by_trend
    assert [p.name for p in found["features"].parameters[: len(NAMES)]] == list(NAMES)
    again, _ = estimate_cycle(MODEL, OPTIONS, cycle, memory)
    assert again[1].value("rest_level") == found["features"].value("rest_level")


def test_relative_features_are_followed_by_their_logarithm(started):
    cycle = Cycle(2, 0.03, to_frames(started().advance(850)))
    values = MODEL.features(cycle, OPTIONS)
    vector = MODEL.feature_set.vector(values)
    for name, value, followed in zip(
        NAMES, (p.value for p in values[: len(NAMES)]), vector, strict=True
    ):
        assert followed == (np.log(value) if name in RELATIVE else value)


def own(started, name, *fault, cycles=1):
    """Return the sum over the first cycles of a number that stands beside the features."""
    valve, total = started(*fault), 0.0
    for number in range(cycles):
        frames = to_frames(valve.advance(850))
        values = MODEL.features(Cycle(number + 1, 0.03, frames), OPTIONS)
        total += {p.name: p.value for p in values}[name]
    return total


def test_a_sensor_that_is_far_off_shows_the_spool_where_it_cannot_rest(started):
    assert own(started, "off_seat") == 0.0
    assert own(started, "off_seat", "sensor_offset", 0.02) == pytest.approx(0.02, abs=1e-3)


def test_small_commands_lack_effect_behind_a_wide_dead_band_only(started):
    assert own(started, "weak_small", cycles=3) == 0.0
    assert own(started, "weak_small", "dead_band", 0.08) > 0.4


def test_a_freezing_sensor_misses_values_from_its_first_cycle_on(started):
    assert own(started, "missed", cycles=6) == 0.0
    missed, due = (own(started, n, "sensor_freeze", 0.1, cycles=6) for n in ("missed", "due"))
    assert missed / due == pytest.approx(0.1, abs=0.06)  # 160 values: two and a half deviations
