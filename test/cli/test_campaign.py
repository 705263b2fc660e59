# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin campaign` on a short campaign, and what it says of a file that is wrong."""

import json

import numpy as np
import pytest

from test.gateway.fmu.test_valve import made, record
from valve_twin.cli.main import main
from valve_twin.core.diagnosis.generic import signatures
from valve_twin.core.diagnosis.generic.campaign import model_rig
from valve_twin.core.diagnosis.source import read_table
from valve_twin.core.types import ParameterValue
from valve_twin.core.valves.registry import get_model
from valve_twin.gateway.fmu.export import write_fmu
from valve_twin.gateway.fmu.valve import valve_of
from valve_twin.io.fmu.plant import simulation_for

VALUES = (
    ParameterValue("time_constant", 0.7, lower_95=0.69, upper_95=0.71),
    ParameterValue("dead_band", 0.02, lower_95=0.01, upper_95=0.03),
)

SHORT = """
model: press_cartridge
seeds: 1
cycles: 40
onset: 31
after: 4
aging: {area_in: -0.0007}
severities:
  leak: [8.9e-05, 2.67e-04, 8.9e-04]
  dead_band: [0.0025, 0.0075, 0.025]
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text(SHORT, encoding="utf-8")
    return path


def test_it_prints_what_was_found_and_writes_all_figures(config, tmp_path, capsys):
    out = tmp_path / "faults.json"
    assert main(["campaign", "--config", str(config), "--json", str(out)]) == 0
    said = capsys.readouterr().out
    assert "0 false alarms in 40 healthy aging cycles" in said
    assert "preload = coil_resistance; sensor_gain = supply_drop" in said
    figures = json.loads(out.read_text(encoding="utf-8"))
    large = [r for r in figures["rows"] if r["size"] == "large"]
    assert [(r["fault"], r["within_5"], r["in_class"]) for r in large] == [
        ("leak", 1, 1),
        ("dead_band", 1, 1),
    ]


def test_one_fault_may_be_chosen(config, tmp_path, capsys):
    out = tmp_path / "faults.json"
    arguments = ["campaign", "--config", str(config), "--json", str(out)]
    assert main([*arguments, "--fault", "leak", "--seeds", "1"]) == 0
    assert {r["fault"] for r in json.loads(out.read_text())["rows"]} == {"leak"}
    capsys.readouterr()
    assert main([*arguments, "--fault", "leek"]) == 2
    assert "there is no fault 'leek'; there are leak, dead_band" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("seeds: 1", "sedes: 1", "unknown key 'sedes'"),
        ("leak: [", "leek: [", "unknown fault 'leek'"),
        ("press_cartridge", "hydraulic_actuator", "shows no features of faults"),
        ("onset: 31", "onset: 3", "key 'onset': value 3 is outside its limits; write 26 or more"),
        ("onset: 31", "onset: 40", "key 'onset': value 40 is not below cycles = 40"),
        ("seeds: 1", "seeds: many", "key 'seeds': value 'many' is no integer"),
        ("area_in:", "aera_in:", "plant parameter 'aera_in' is unknown"),
        ("[0.0025,", "[", "faults.yaml"),
        ("model:", "model: [", "not valid YAML"),
    ],
)
def test_a_wrong_file_is_one_line(config, capsys, old, new, text):
    config.write_text(SHORT.replace(old, new), encoding="utf-8")
    assert main(["campaign", "--config", str(config)]) == 2
    said = capsys.readouterr().err
    assert text in said
    assert said.count("\n") == 1


def test_a_missing_file_is_said(tmp_path, capsys):
    assert main(["campaign", "--config", str(tmp_path / "none.yaml")]) == 1
    assert "none.yaml" in capsys.readouterr().err


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    pytest.importorskip("fmpy")
    pytest.importorskip("ziglang")
    path = tmp_path_factory.mktemp("fmu") / "valve.fmu"
    write_fmu(valve_of("db", "/v", made(values=VALUES), record()), path, 2)
    return path


@pytest.mark.timeout(900)  # the first use of the compiler builds its C libraries
def test_an_fmu_as_the_plant_has_the_faults_of_any_valve(fmu, tmp_path):
    out = tmp_path / "faults.json"
    arguments = ["--model", "first_order", "--fmu", str(fmu), "--seeds", "1", "--json", str(out)]
    assert main(["campaign", *arguments, "--fault", "sensor_offset"]) == 0
    figures = json.loads(out.read_text())
    assert figures["false_alarms"] == []
    assert [(r["size"], r["within_5"], r["named"]) for r in figures["rows"]] == [
        ("medium", 1, 1),
        ("large", 1, 1),
    ]
    ours = {"plant.time_constant": 0.7, "plant.dead_band": 0.02}
    rigs = [
        model_rig("first_order", simulation_for("first_order", given))
        for given in ({"fmu.file": str(fmu)}, ours)
    ]
    theirs, own = (rig.run(rig.start(3), 6) for rig in rigs)
    np.testing.assert_allclose(theirs, own, rtol=1e-6, atol=1e-9)  # the FMU is that valve


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--model", "first_order", "--fmu", "none.fmu"], "none.fmu: there is no such file"),
        (["--config", "x.yaml", "--fmu", "none.fmu"], "--fmu needs --model NAME"),
        (["--model", "none", "--fmu", "none.fmu"], "'none' is unknown"),
    ],
)
def test_an_fmu_that_cannot_be_the_plant_is_one_line(capsys, more, said):
    assert main(["campaign", *more]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


@pytest.mark.timeout(900)
def test_its_variables_are_named_where_they_have_other_names(fmu, capsys):
    arguments = ["campaign", "--model", "first_order", "--fmu", str(fmu)]
    assert main([*arguments, "--fmu-output", "positon"]) == 2
    assert "did you mean 'position'" in capsys.readouterr().err
    assert main([*arguments, "--fmu-input", "comand"]) == 2
    assert "did you mean 'command'" in capsys.readouterr().err


def test_derived_signatures_are_a_file_that_a_valve_ships(tmp_path, monkeypatch):
    table = get_model("press_cartridge").signatures()
    monkeypatch.setattr(signatures, "derive_table", lambda _model: table)
    package = tmp_path / "a_shipping_valve"
    package.mkdir()
    (package / "__init__.py").touch()
    made_of = ["campaign", "--model", "first_order", "--derive", str(package / "signatures.json")]
    assert main(made_of) == 0
    monkeypatch.syspath_prepend(tmp_path)
    assert read_table("a_shipping_valve") == table
