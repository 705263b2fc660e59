# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve's own motion: few numbers of a cycle, and the signatures that it gives."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.diagnosis.features import NOISE
from valve_twin.core.diagnosis.generic.features import Record
from valve_twin.core.diagnosis.generic.motion import motion_from, motion_of
from valve_twin.core.diagnosis.generic.signatures import own_table
from valve_twin.core.types import ParameterValue

PERIOD_S, SPAN, STEP, SIGMA = 0.1, 40.0, 0.02, 0.08
LEVELS = (0.0, 0.7, 0.3, 1.0, 0.0)


def response():
    """Return steps between levels through a lag of 0.5 s, over a span of 1."""
    wanted, place, out = np.repeat(LEVELS, 60), 0.0, []
    for level in wanted:
        out.append(place)
        place = level + np.exp(-PERIOD_S / 0.5) * (place - level)
    return np.array(out)


def record():
    run = SPAN * response()
    noise = np.random.default_rng(5).normal(0.0, SIGMA, len(run))
    return Record(STEP * np.round((run + noise) / STEP), run, PERIOD_S, np.zeros((len(run), 0)))


def shown(noise):
    return [ParameterValue(NOISE, noise)]


@pytest.fixture(scope="module")
def motion():
    return motion_of(record(), shown(SIGMA / SPAN))


def test_few_samples_give_the_motion_back(motion):
    assert len(motion.at) < 0.2 * len(response())
    assert motion.positions() == pytest.approx(response() / np.ptp(response()), abs=6e-3)
    assert motion.step == pytest.approx(STEP / SPAN, rel=0.02)
    assert motion.sigma == motion.noise == SIGMA / SPAN
    assert motion_from([p.value for p in motion.values()]) == motion


def test_a_cycle_that_stands_still_or_has_no_noise_gives_none():
    still = Record(np.ones(100), np.ones(100), PERIOD_S, np.zeros((100, 0)))
    assert motion_of(still, shown(1e-3)) is None
    assert motion_of(record(), shown(np.nan)) is None


def test_a_position_without_noise_counts_as_that_of_a_good_sensor(motion):
    filtered = replace(motion, noise=0.0, step=1e-5)
    assert filtered.sigma == 1e-4
    assert replace(motion, noise=2e-4, step=0.0).sigma == 2e-4


@pytest.mark.no_cover
def test_its_signatures_are_what_these_moves_would_show(motion):
    table = own_table("first_order", motion)
    assert own_table("first_order", motion) is table

    def change(fault, feature):
        found = [s for s in table.signatures if s.fault == fault and s.severity > 0.0]
        at = table.features.index(feature)
        return found[1].change[at], found[1].severity

    for lag in ("lag_up", "lag_down"):
        assert change("delay", lag)[0] == pytest.approx(change("delay", lag)[1], rel=0.1)
    # one of two moves up ends at the upper stop, and the one down from it begins there
    assert change("end_stop_upper", "gain_up")[0] < 0.0
    missing = change("end_stop_upper", "gain_up")[1]
    assert change("end_stop_upper", "gain_up")[0] == pytest.approx(
        np.log(1.0 - 0.5 * missing / 0.7), rel=0.2
    )
