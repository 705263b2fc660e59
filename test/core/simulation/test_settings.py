# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.quantity import Kind, describe
from valve_twin.core.simulation import AgingRule, Scatter, configure
from valve_twin.core.valves.press_cartridge.plant import PressCartridgePlant, default_simulation

DEFAULT = default_simulation()


def press(config):
    assert isinstance(config.plant, PressCartridgePlant)
    return config.plant


def test_every_setting_can_be_given_back_as_it_is():
    flat = {
        s.name: list(s.default) if isinstance(s.default, tuple) else s.default
        for s in describe(DEFAULT)
    }
    assert configure(DEFAULT, flat) == DEFAULT


def test_every_setting_states_its_unit_and_meaning():
    listed = describe(DEFAULT)
    assert {"plant.area_in", "plant.plc.gain_in", "measurement.noise", "program.times_s"} <= {
        s.name for s in listed
    }
    assert all(s.description for s in listed)
    words = {Kind.STRING, Kind.STRINGS, Kind.BOOL}
    assert all(bool(s.unit) is (s.kind not in words) for s in listed)


def test_nested_and_dotted_names_are_the_same():
    nested = configure(DEFAULT, {"plant": {"plc": {"gain_in": 4.0}}, "measurement": {"delay": 2}})
    dotted = configure(DEFAULT, {"plant.plc.gain_in": 4.0, "measurement.delay": 2})
    assert nested == dotted
    assert press(nested).plc.gain_in == 4.0


def test_an_integer_may_stand_for_a_float():
    config = configure(DEFAULT, {"plant.mass": 90})
    assert isinstance(press(config).mass, float)


def test_rules_are_added_by_parameter_and_keep_what_is_not_given():
    config = configure(DEFAULT, {"aging": {"area_in": {"rate": -1e-3, "start_cycle": 5}}})
    assert config.aging == (AgingRule("area_in", "linear", -1e-3, 5),)
    again = configure(config, {"aging.area_in.law": "step", "scatter.area_out": 0.01})
    assert again.aging == (AgingRule("area_in", "step", -1e-3, 5),)
    assert again.scatter == (Scatter("supply_pressure", 0.004), Scatter("area_out", 0.01))


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (
            {"plant.aera_in": 1e-5},
            "simulation.plant.aera_in: unknown setting; did you mean 'plant.area_in'",
        ),
        (
            {"plant.mass": "heavy"},
            "simulation.plant.mass: value 'heavy' is no number; write for example",
        ),
        ({"plant.mass": True}, "plant.mass: value True is no number"),
        ({"plant.mass": np.nan}, r"value nan is not a number; write 0\.\d+ to \d+"),
        ({"measurement.delay": 1.5}, "measurement.delay: value 1.5 is no integer"),
        ({"controller": 3}, "controller: value '3' is unknown; write one of cycles, external"),
        (
            {"controller": "manual"},
            "controller: value 'manual' is unknown; write one of cycles, external",
        ),
        ({"program.times_s": 3.0}, "program.times_s: value 3.0 is no list of numbers"),
        (
            {"plant.mass": -1.0},
            "plant.mass: value -1.0 kg is outside its limits; write 0.01 to 10000",
        ),
        ({"aging.areain.rate": 0.1}, "'areain' is unknown; did you mean 'area_in'"),
        ({"aging.area_in": 0.1}, "known are aging.<parameter>.law"),
        (
            {"scatter.supply_pressure": 2.0},
            "scatter of supply_pressure = 2.0: must be from 0 to 0.5",
        ),
        ({"measurement.command_offsets": [0.1]}, r"must have 2 entries \(v_in, v_out\) or none"),
        ({"program.duration_s": 25.51}, "must be a whole multiple of period_s = 0.03"),
        ({"start_command": 2}, "must be below the number of commands, 2"),
        ({"fault.kind": "leek"}, "fault.kind = 'leek': must be one of"),
    ],
)
def test_refuses_a_wrong_setting_with_name_and_remedy(given, text):
    with pytest.raises(ValueError, match=text):
        configure(DEFAULT, given)
