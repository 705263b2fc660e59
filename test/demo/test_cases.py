# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which valves the demo shows and what it takes for the truth."""

from __future__ import annotations

from dataclasses import replace

import pytest

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import AgingRule, simulate_cycles, to_frames
from valve_twin.core.types import Cycle, Estimate, EstimateStatus
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.registry import get_model, get_simulation
from valve_twin.demo.__main__ import main
from valve_twin.demo.cases import DRIFT, case_names, config_of, find_case, injected, shown_file
from valve_twin.io.config.valve import load_config
from valve_twin.io.offline.simulated_bag import simulation_of


def test_the_simulated_valves_with_an_aging_law_are_shown():
    assert {"press_cartridge", "stepper_servo", "hybrid_actuator"} <= set(case_names())


@pytest.mark.parametrize("model", case_names())
def test_a_case_follows_a_trend_of_its_model(model):
    case = find_case(model)
    followed = {p.name for p in get_model(model).parameters if p.trend}
    assert case.followed in followed
    assert abs(case.aging_rate * case.cycles) == pytest.approx(DRIFT, abs=0.011)


def test_a_shorter_demo_ages_as_far():
    case = find_case("hybrid_actuator", cycles=30)
    assert case.cycles == 30
    assert 30 * case.aging_rate == pytest.approx(-DRIFT)


def test_the_truth_of_a_number_of_the_plant_is_its_law():
    case = find_case("stepper_servo")
    rule = AgingRule("backlash", "linear", 0.01, 1)
    simulation = replace(get_simulation("stepper_servo"), aging=(rule,))
    assert injected(case, simulation, [1, 5, 10]) == pytest.approx([1.01, 1.05, 1.10])


def test_the_truth_of_the_press_is_its_steady_gain():
    case = find_case("press_cartridge")
    rule = AgingRule("area_in", "linear", -0.01, 1)
    simulation = replace(get_simulation("press_cartridge"), aging=(rule,))
    new, old = injected(case, simulation, [0, 10])
    assert old / new == pytest.approx(0.9, abs=0.01)


def test_a_file_of_the_user_s_is_shown_in_place_of_that_of_the_model(tmp_path):
    own = tmp_path / "designed.yaml"
    text = config_of("double_solenoid").read_text(encoding="utf-8")
    own.write_text(text.replace("/**:", "# mine\n/**:"), encoding="utf-8")
    case = find_case(file=own)
    assert case == replace(find_case("double_solenoid"), file=own)
    assert find_case("double_solenoid", file=own) == case


def test_the_double_solenoid_is_shown_on_the_map_of_a_field():
    """Issue 11: the demo runs on a computed map, not on an assumed pole."""
    case = find_case("double_solenoid")
    config = load_config(case.file)[0]
    assert len(config.options.map_coenergy) > 1000
    plant = simulation_of(config).plant
    assert isinstance(plant, DoubleSolenoidPlant)
    assert plant.map_coenergy == config.options.map_coenergy
    assert plant.eddies == config.options.eddies
    assert plant.eddies.gain_1 > 0.0
    assert case.rate == 0.5


def test_valve_and_twin_of_the_shown_file_agree():
    config = load_config(shown_file("double_solenoid"))[0]
    model, simulation = get_model(config.model), simulation_of(config)
    memory, found = Memory.empty(), tuple[Estimate, ...]()
    for i, block in enumerate(simulate_cycles(simulation, 2, 5), 1):
        cycle = Cycle(i, simulation.period_s, to_frames(block))
        found, memory = estimate_cycle(model, config.options, cycle, memory)
    said = next(e for e in found if e.estimator == model.trend_estimator)
    assert said.status is EstimateStatus.ACCEPTED, said.reason
    truth = model.truth(simulation, 2)
    for name, true in truth.items():
        assert said.value(name) == pytest.approx(true, rel=0.1), name


def test_a_file_that_lets_no_such_valve_age_is_refused(capsys, tmp_path):
    pilot = config_of("double_solenoid").with_name("press_cartridge.yaml")
    assert main(["--valve", "double_solenoid", "--config", str(pilot)]) == 2
    assert "lets no valve of the model 'double_solenoid' age" in capsys.readouterr().err
    assert main(["--config", str(tmp_path / "none.yaml")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "none.yaml" in line


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--valve", "stepper_serve"], "did you mean 'stepper_servo'?"),
        (["--valve", "cycle_timing"], "no such valve to show; there are double_solenoid"),
        (["--cycles", "-1"], "cycles = -1, rate = 0.0: must not be negative"),
        (["--rate", "nan"], "must not be negative"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_one_line(capsys, arguments, told):
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
