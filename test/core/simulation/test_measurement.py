# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.simulation.measurement import MeasurementConfig, measure, start_sensor

RAMP = np.linspace(0.1, 0.9, 101)
NOISE = np.random.default_rng(1).standard_normal(101)


def seen(config, *, phase=0, frozen=False, position=RAMP, noise=NOISE):
    state = start_sensor(config, float(position[0]))
    return measure(state, config, position, noise, phase, frozen=frozen)[1]


def layer(**changes):
    return MeasurementConfig(**({"delay": 0, "noise": 0.0} | changes))


def test_an_ideal_sensor_shows_the_position():
    np.testing.assert_array_equal(seen(layer()), RAMP)


def test_delay_shifts_by_samples():
    np.testing.assert_array_equal(seen(layer(delay=3))[3:], RAMP[:-3])


def test_refresh_repeats_values_from_the_phase_on():
    measured = seen(layer(refresh=4, noise=1e-3), phase=2)
    fresh = np.flatnonzero(np.diff(measured) != 0.0) + 1
    np.testing.assert_array_equal(fresh, np.arange(2, 101, 4))
    np.testing.assert_allclose(measured[fresh], (RAMP + 1e-3 * NOISE)[fresh], rtol=1e-15)


def test_noise_has_its_standard_deviation():
    noise = np.random.default_rng(2).standard_normal(20000)
    error = seen(layer(noise=2e-3), position=np.full(20000, 0.5), noise=noise) - 0.5
    # 4 standard errors of a standard deviation over 20000 samples are 2 %
    assert error.std() == pytest.approx(2e-3, rel=0.02)


def test_quantisation_gives_whole_steps():
    measured = seen(layer(quantum=1 / 256))
    np.testing.assert_allclose(measured * 256, np.round(measured * 256), atol=1e-9)
    assert np.abs(measured - RAMP).max() <= 0.5 / 256 + 1e-12


def test_offset_is_added():
    np.testing.assert_allclose(seen(layer(position_offset=-0.01)), RAMP - 0.01, rtol=1e-15)


def test_a_frozen_sensor_repeats_its_last_value():
    config = layer(noise=1e-3)
    state, before = measure(start_sensor(config, 0.1), config, RAMP, NOISE, 0, frozen=False)
    state, frozen = measure(state, config, RAMP, NOISE, 0, frozen=True)
    assert set(frozen) == {before[-1]}
    assert measure(state, config, RAMP, NOISE, 0, frozen=False)[1][0] != before[-1]


def test_blocks_of_any_length_give_the_same_values():
    config = layer(delay=2, refresh=3, noise=1e-3)
    whole = seen(config)
    state, parts = start_sensor(config, float(RAMP[0])), []
    for i in (slice(0, 1), slice(1, 8), slice(8, 8), slice(8, 101)):
        phase = -i.start % 3
        state, part = measure(state, config, RAMP[i], NOISE[i], phase, frozen=False)
        parts.append(part)
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_refuses_a_phase_beyond_the_refresh():
    with pytest.raises(ValueError, match=r"refresh_phase = 4: must be below refresh = 4"):
        MeasurementConfig(refresh=4, refresh_phase=4)
