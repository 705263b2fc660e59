# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Other structures follow a valve that is not of the plain law, and say how far it was moved."""

import numpy as np
import pytest

from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.simulation.settings import configure
from valve_twin.core.types import Cycle
from valve_twin.core.valves.positioner.check import rivals_of
from valve_twin.core.valves.positioner.check.rivals import _Search
from valve_twin.core.valves.positioner.fit import bounds, fit_free_run
from valve_twin.core.valves.positioner.model import MODEL
from valve_twin.core.valves.positioner.parameters import FITTED
from valve_twin.core.valves.positioner.record import prepare


def compared(**changes):
    """Return the fit of one simulated cycle, what its rivals say, and the truth (5,)."""
    simulation = configure(MODEL.simulation(), changes)
    (block,) = simulate_cycles(simulation, 1, 11)
    cycle = Cycle(1, simulation.period_s, to_frames(block))
    prepared, o = prepare(cycle, MODEL.options), MODEL.options
    limits = bounds(cycle.period_s, min_slew=o.min_slew, max_dead_band=o.max_dead_band)
    solution = fit_free_run(prepared.record, max_lag=prepared.max_lag, limits=limits)
    rivals = rivals_of(prepared.record, solution, limits, prepared.max_lag)
    truth = MODEL.truth(simulation, 1)
    return solution.parameters, rivals, np.array([truth[name] for name in FITTED])


def test_no_rival_follows_a_valve_of_the_plain_law_better():
    found, rivals, truth = compared()
    assert rivals.best.terms == ()
    assert (rivals.moved[:4] < 0.05 * truth[:4]).all()
    assert rivals.left == pytest.approx(1e-3, rel=0.1)  # the simulated noise
    np.testing.assert_allclose(found[:4], truth[:4], rtol=0.02)


@pytest.mark.parametrize(
    ("changes", "term"),
    [
        ({"plant.velocity_lag": 0.1}, "velocity_lag"),
        ({"plant.stiction": 0.03}, "stiction"),
        ({"plant.backlash": 0.01}, "backlash"),
        ({"measurement.position_offset": 0.003}, "rest_level"),
        ({"plant.static_gain": 0.99}, "static_gain"),
        ({"plant.delay_change": 0.2}, "delay_falling"),
    ],
)
def test_names_the_term_that_is_missing_and_reaches_the_truth(changes, term):
    found, rivals, truth = compared(**changes)
    assert term in rivals.best.terms
    scatter = 0.1 * truth  # of one cycle in which lag and rate trade against each other
    assert (np.abs(found - truth) <= rivals.moved[:5] + scatter).all()
    assert (np.abs(found - truth) > scatter).any()  # without the check it would be wrong


def test_no_delay_and_the_longest_leave_no_room_for_both():
    """A search over random valves ended there: the minimum of nothing."""
    (block,) = simulate_cycles(MODEL.simulation(), 1, 11)
    prepared = prepare(Cycle(1, MODEL.simulation().period_s, to_frames(block)), MODEL.options)
    limits = bounds(0.02, min_slew=0.01, max_dead_band=0.1)
    solution = fit_free_run(prepared.record, max_lag=3, limits=limits)
    search = _Search(prepared.record, solution, limits, 3)
    rival = search.plain._replace(delays=(0.0, 4.0))
    assert search.with_delays(rival, "part_of_a_sample") is rival
    other = search.with_delays(rival._replace(delays=(0.0, 3.0)), "part_of_a_sample")
    assert "part_of_a_sample" in other.terms


def test_a_long_record_is_thinned_and_still_names_the_lag():
    simulation = configure(MODEL.simulation(), {"plant.velocity_lag": 0.1, "period_s": 0.01})
    (block,) = simulate_cycles(simulation, 1, 11)
    cycle = Cycle(1, simulation.period_s, to_frames(block))
    prepared, o = prepare(cycle, MODEL.options), MODEL.options
    limits = bounds(cycle.period_s, min_slew=o.min_slew, max_dead_band=o.max_dead_band)
    solution = fit_free_run(prepared.record, max_lag=prepared.max_lag, limits=limits)
    assert len(prepared.record.position) > 2000
    assert (
        "velocity_lag" in rivals_of(prepared.record, solution, limits, prepared.max_lag).best.terms
    )


def test_tells_the_step_of_a_quantised_position():
    _, rivals, _ = compared(**{"measurement.quantum": 0.01})
    assert rivals.quantum == pytest.approx(0.01)
