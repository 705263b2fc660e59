# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve of the kit: prediction codes, refusals, intervals, plant."""

import re
from dataclasses import replace

import numpy as np
import pytest

from test.core.valves import blocks
from valve_twin.core.simulation import SimulatedValve, configure, simulate_cycles, to_frames
from valve_twin.core.types import Cycle, EstimateStatus, ParameterStatus, Validity
from valve_twin.core.valves.first_order import VALVE
from valve_twin.core.valves.kit import Valve, parameter
from valve_twin.core.valves.registry import complete_options, get_simulation

OPTIONS = complete_options(VALVE, {})
SIMULATION = get_simulation("first_order")
TRUE = {"time_constant": 0.4, "dead_band": 0.01}
ROOMY = parameter("dead_band", 0.03, "1", "moves nothing", lower=0.02, upper=0.2)
LAG = 2  # a held command and the sensor's delay of one sample


def cycle_of(seed=0, **given):
    (block,) = simulate_cycles(configure(SIMULATION, given), 1, seed)
    return Cycle(1, SIMULATION.period_s, to_frames(block))


def estimate(cycle, **options):
    (found,) = VALVE.estimate(cycle, replace(OPTIONS, **options))
    return found


def predict(cycle, restart, cuts=()):
    c = VALVE.coefficients(TRUE, LAG, cycle.period_s, OPTIONS)
    return blocks.predict(VALVE, c, cycle.frames, restart, cuts)


def codes(cycle, **at):
    return blocks.marked(len(cycle.frames), {where: int(code[1:]) for code, where in at.items()})


def test_the_true_parameters_predict_to_the_noise():
    cycle = cycle_of()
    predicted, simulated, validity = predict(cycle, codes(cycle))
    assert list(validity[: LAG + 1]) == [Validity.STARTING] * LAG + [Validity.VALID]
    assert np.isnan(predicted[:LAG]).all()
    errors = cycle.frames.position[LAG:] - predicted[LAG:], cycle.frames.position - simulated
    assert errors[0].std() < 1.5e-3  # the noise of two samples
    assert np.nanstd(errors[1]) == pytest.approx(1e-3, rel=0.2)


def test_a_gap_forgets_and_a_bad_sample_goes_on_with_the_prediction():
    cycle = cycle_of()
    cycle.frames.position[120] = np.nan
    predicted, simulated, validity = predict(cycle, codes(cycle, _2=200, _3=120))
    assert validity[120] == Validity.BAD_INPUT
    assert np.isfinite(predicted[120:122]).all()
    assert list(validity[200:203]) == [Validity.STARTING] * LAG + [Validity.VALID]
    assert np.isnan(simulated[200:202]).all()


def test_a_new_cycle_starts_the_free_run_from_the_measured_output():
    cycle = cycle_of()
    _, simulated, validity = predict(cycle, codes(cycle, _1=150))
    assert simulated[150] == cycle.frames.position[150]
    assert validity[150] == Validity.VALID


@pytest.mark.parametrize("cuts", [(1, 2, 3, 120, 121), (57, 199), tuple(range(1, 400))])
def test_the_bits_do_not_depend_on_the_blocks(cuts):
    cycle = cycle_of()
    restart = codes(cycle, _1=150, _2=200, _3=120)
    for whole, parts in zip(predict(cycle, restart), predict(cycle, restart, cuts), strict=True):
        assert whole.tobytes() == parts.tobytes()


def test_its_own_intervals_hold_the_true_parameters():
    inside = [
        p.lower_95 <= TRUE[p.name] <= p.upper_95
        for seed in range(20)
        for p in estimate(cycle_of(seed)).parameters
    ]
    assert np.mean(inside) >= 0.9


def test_a_step_of_the_lag_is_found():
    assert estimate(cycle_of()).lag == LAG
    assert estimate(cycle_of(**{"measurement.delay": 4})).lag == 5


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"valid": np.zeros(400, dtype=np.bool_)}, "0 usable samples"),
        ({"position": np.full(400, 0.3)}, "the output moved by 0, less than min_motion 0.02"),
        ({"inputs": np.full((400, 1), 0.3)}, r"the inputs stayed at \[0.3\]"),
    ],
)
def test_a_cycle_that_says_nothing_is_refused(change, reason):
    cycle = cycle_of()
    found = estimate(replace(cycle, frames=replace(cycle.frames, **change)))
    assert found.status is EstimateStatus.REFUSED
    assert re.match(reason, found.reason)
    assert all(p.status is ParameterStatus.REFUSED for p in found.parameters)


def test_percent_are_refused():
    cycle = cycle_of()
    frames = replace(cycle.frames, position=100.0 * cycle.frames.position)
    wrong = replace(cycle, frames=frames)
    assert "0.01 for percent" in VALVE.input_fault(wrong, OPTIONS)
    plain = Valve("v", ("command",), "y", VALVE.law, normalised=False)
    assert plain.input_fault(wrong, OPTIONS) == ""


def test_missing_and_repeated_samples_are_left_out():
    cycle = cycle_of(**{"measurement.refresh": 4})
    found = estimate(cycle)
    assert found.counts.used == pytest.approx(100, abs=10)
    assert found.counts.stale == len(cycle.frames) - found.counts.used
    assert found.value("time_constant") == pytest.approx(0.4, rel=0.05)


def test_a_parameter_on_its_bound_is_told():
    law = replace(VALVE.law, parameters=(VALVE.law.parameters[0], ROOMY))
    roomy = Valve("v", VALVE.inputs, VALVE.output, law)
    (found,) = roomy.estimate(cycle_of(), OPTIONS)
    band = found.parameters[1]
    assert (band.status, band.reason) == (ParameterStatus.AT_BOUND, "rests on its bound 0.02")
    assert np.isnan(band.standard_error)


def test_its_plant_ages_and_takes_faults():
    valve = SimulatedValve(configure(SIMULATION, {"controller": "external"}))
    valve.advance(100, np.full((100, 1), 0.5))
    for kind in ("command_loss", "stuck"):
        valve.set_fault(kind, 1.0)
        block = valve.advance(50, np.full((50, 1), 0.9))
        assert float(np.ptp(block.true_position)) < 1e-2, kind
        valve.set_fault("none")
    valve.set_aging("time_constant", "linear", 0.1)
    assert vars(valve.aged_plant(2))["time_constant"] == pytest.approx(
        0.4 * 1.1**1 + 0.4 * 0.1 * 0, rel=0.2
    )


def test_a_value_outside_its_bounds_is_refused_by_name():
    says = r"simulation.plant.dead_band: value 0.5 is outside its limits; write 0 to 0.2"
    with pytest.raises(ValueError, match=says):
        configure(SIMULATION, {"plant.dead_band": 0.5})


def test_without_a_program_it_is_not_simulated():
    assert Valve("v", ("command",), "y", VALVE.law).simulation() is None
