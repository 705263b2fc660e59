# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A noisier sensor is found against its own past, and a healthy one is not."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.direct.noise import first_quieter, noisier, over


def levels(cycles, seed, spread=0.1):
    """Return noise at rest that scatters about 1e-3 by a share."""
    return 1e-3 * np.exp(spread * np.random.default_rng(seed).standard_normal(cycles))


def test_8000_healthy_cycles_raise_at_most_one_alarm():
    for_all = (noisier(np.arange(1, 101), levels(100, seed, 0.2)) for seed in range(80))
    assert sum(len(found) for found in for_all) <= 1


def test_a_noisier_sensor_is_told_with_its_factor_and_is_over():
    noise = levels(60, 1)
    noise[20:40] *= 3.0
    (found,) = noisier(np.arange(1, 61), noise)
    assert (found.fault, found.part, found.onset, found.alarm, found.end) == (
        "sensor_noise",
        "sensor",
        21,
        22,
        45,
    )
    assert found.severity == pytest.approx(3.0, rel=0.1)  # the median of 20 at 10 %: 3 %


def test_one_wild_cycle_is_no_noisier_sensor():
    noise = levels(60, 2)
    noise[[20, 40]] *= 5.0
    assert noisier(np.arange(1, 61), noise) == []


def test_the_first_cycles_of_a_product_may_be_noisier_and_a_noisier_sensor_is_told_all_the_same():
    noise, cycles = levels(60, 5), np.arange(1, 61)
    noise[20:24] *= 3.0
    product = np.where(cycles > 20, 1, 0)
    assert [f.onset for f in noisier(cycles, noise)] == [21]
    assert noisier(cycles, noise, product) == []
    unknown = np.where(cycles > 20, -1, 0)[:23]  # before the product is known
    assert noisier(cycles[:23], noise[:23], unknown) == []
    noise[24:] *= 3.0
    (found,) = noisier(cycles, noise, product)
    assert (found.onset, found.alarm) == (21, 25)


def test_cycles_without_rest_are_left_out():
    noise = levels(60, 3)
    noise[20:] *= 3.0
    noise[::3] = np.nan
    assert [f.onset for f in noisier(np.arange(1, 61), noise)] == [21]


def test_nothing_is_said_before_it_is_known_how_noisy_it_is():
    noise = levels(20, 4)
    noise[5:] *= 3.0
    assert noisier(np.arange(1, 8), noise[:7]) == []


def test_what_was_found_long_ago_is_over_at_the_same_cycle_without_what_came_before():
    noise, cycles = levels(600, 4), np.arange(1, 601)
    noise[100:400] *= 3.0
    (whole,) = noisier(cycles, noise)
    (seen,) = noisier(cycles[:300], noise[:300])
    assert seen.end == -1
    assert over(cycles[250:400], noise[250:400], seen, 300) == -1
    assert over(cycles[250:], noise[250:], seen, 300) == whole.end == 405


@pytest.mark.parametrize("first", [2, 3, 7])
def test_a_sensor_that_was_quiet_in_the_first_cycles_only_is_told(first):
    """Too few cycles came before for an alarm (stranger 96071)."""
    noise = levels(40, 4)
    noise[first:] *= 4.0
    assert noisier(np.arange(1, 41), noise) == []
    assert first_quieter(noise) == first
    assert first_quieter(noise[:9]) == 0  # eight behind two must show it


def test_the_first_cycles_of_400_sound_sensors_are_not_quieter_in_all_but_one():
    assert sum(bool(first_quieter(levels(60, seed, 0.2))) for seed in range(400)) <= 1
