# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design export`."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from valve_twin.cli import main
from valve_twin.core.valves.double_solenoid.parameters import doubted
from valve_twin.design import chain
from valve_twin.design.doubt import compute_doubts
from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.map import MapGrid, compute_map, write_map
from valve_twin.design.wear import compute_wear
from valve_twin.io.config.valve import load_config

pytestmark = pytest.mark.usefixtures("transients_once", "maps_once")


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "map.npz"
    grid = MapGrid(currents=4, positions=4, fine=0.3)
    write_map(compute_map(DoubleStroke().section(), grid), path)
    return str(path)


def test_a_file_of_another_valve_is_refused_before_fields_are_computed(
    root, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(chain, "compute_design", pytest.fail)
    like = str(root / "config" / "servo_system.yaml")
    out = tmp_path / "designed.yaml"
    assert main(["design", "export", "--like", like, "--out", str(out)]) == 2
    assert "servo_system.yaml: is of model 'servo_system'; give one of" in capsys.readouterr().err
    assert not out.exists()


def test_valve_and_twin_run_on_the_map(coarse, tmp_path, capsys, monkeypatch):
    quick = chain.Fidelity(MapGrid(currents=4, positions=4, fine=0.3), fine=0.3, step=4e-4)
    monkeypatch.setitem(chain.FIDELITIES, "export", quick)
    path = str(tmp_path / "designed.yaml")
    assert main(["design", "export", "--map", coarse, "--out", path]) == 0
    told = capsys.readouterr()
    found = json.loads(told.out)
    assert "valve.power" not in told.err
    assert (
        f"{coarse}: made with currents 4 (now 7), positions 4 (now 9), fine 0.3 (now 0.8)\n"
        in (told.err)
    )
    assert f"next: make demo VALVE=double_solenoid CONFIG={path}" in told.err
    options = load_config(path)[0].options
    assert found["map"] in options.map_source
    assert options.resistance_a == pytest.approx(found["resistance"])
    names = ("gain_1", "time_1", "gain_2", "time_2", "growth")
    branches = [getattr(options.eddies, n) for n in names]
    assert branches == found["eddies"]
    assert min(branches) > 0.0
    bag = str(tmp_path / "bag")
    assert main(["simulate", "--config", path, "--cycles", "2", "--out", bag]) == 0
    capsys.readouterr()
    assert main(["estimate", bag, "--config", path]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    last = [x for x in lines if x["kind"] == "estimate" and x["used_by_trend"]][-1]
    assert last["status"] == "ACCEPTED", last["reason"]
    value = dict(zip(last["names"], last["values"], strict=True))
    assert value["resistance_a"] == pytest.approx(options.resistance_a, rel=0.02)
    assert value["force_gain"] == pytest.approx(1.0, abs=0.02)


def test_second_order_leaves_the_eddy_currents_out(coarse, tmp_path, capsys, monkeypatch):
    quick = chain.Fidelity(MapGrid(currents=4, positions=4, fine=0.3), fine=0.3, step=4e-4)
    monkeypatch.setitem(chain.FIDELITIES, "export", quick)
    path = tmp_path / "designed.yaml"
    words = ["--map", coarse, "--dynamics", "second_order", "--out", str(path)]
    assert main(["design", "export", *words]) == 0
    assert json.loads(capsys.readouterr().out)["eddies"] == []
    assert "eddies" not in path.read_text(encoding="utf-8")


def test_branches_of_one_gain_are_written_without_a_growth(coarse, tmp_path, capsys, monkeypatch):
    quick = chain.Fidelity(MapGrid(currents=4, positions=4, fine=0.3), fine=0.3, step=4e-4)
    monkeypatch.setitem(chain.FIDELITIES, "export", quick)
    path = tmp_path / "designed.yaml"
    assert (
        main(["design", "export", "--map", coarse, "--dynamics", "eddies", "--out", str(path)])
        == 0
    )
    assert len(json.loads(capsys.readouterr().out)["eddies"]) == 4
    assert "growth" not in path.read_text(encoding="utf-8")
    assert load_config(path)[0].options.eddies.growth == 0.0


def test_a_map_that_ends_too_early_for_the_power_is_told(coarse, tmp_path, capsys, monkeypatch):
    quick = chain.Fidelity(MapGrid(currents=4, positions=4, fine=0.3), fine=0.3, step=4e-4)
    monkeypatch.setitem(chain.FIDELITIES, "export", quick)
    words = ["--map", coarse, "--set", "valve.power=30", "--out", str(tmp_path / "designed.yaml")]
    assert main(["design", "export", *words]) == 0
    assert (
        "the map ends at 3 A, below the 3.93 A that valve.power = 30 W" in capsys.readouterr().err
    )


def test_a_twin_that_names_dimensions_takes_the_file(coarse, tmp_path, capsys, monkeypatch):
    grid = MapGrid(currents=4, positions=4, fine=0.3)
    quick = chain.Fidelity(grid, fine=0.3, step=4e-4)
    monkeypatch.setitem(chain.FIDELITIES, "export", quick)
    monkeypatch.setattr(
        compute_wear, "__defaults__", (grid, *(compute_wear.__defaults__ or ())[1:])
    )
    path = str(tmp_path / "designed.yaml")
    words = ["design", "export", "--faults", "--map", coarse, "--out", path]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["causes"]["spring_1"]["nearest"] in found["causes"]
    assert all(0.0 <= of["leaves"] <= 1.0 for of in found["causes"].values())
    config = load_config(path)[0]
    assert config.options.dimension_names[0] == "gap_a"
    assert config.options.estimators == ("balance", "features", "dimensions")
    bag = str(tmp_path / "bag")
    assert main(["simulate", "--config", path, "--cycles", "2", "--out", bag]) == 0
    capsys.readouterr()
    assert main(["estimate", bag, "--config", path]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    told = [x for x in lines if x["kind"] == "estimate" and x["estimator"] == "dimensions"]
    assert told[-1]["status"] == "ACCEPTED", told[-1]["reason"]
    assert "cycle.gap_a" in told[-1]["names"]
    assert "no reference before 8 cycles" in told[-1]["reason"]


def test_the_twin_takes_the_doubts_of_its_map(coarse, tmp_path, monkeypatch):
    grid = MapGrid(currents=4, positions=4, fine=0.3)
    quick = chain.Fidelity(grid, fine=0.3, step=4e-4)
    monkeypatch.setitem(chain.FIDELITIES, "export", quick)
    monkeypatch.setattr(
        compute_doubts, "__defaults__", (grid, *(compute_doubts.__defaults__ or ())[1:])
    )
    path = str(tmp_path / "designed.yaml")
    assert main(["design", "export", "--doubts", "--map", coarse, "--out", path]) == 0
    options = load_config(path)[0].options
    assert options.map_doubt_names == ("mesh", "gap_a", "gap_b", "steel")
    own, others = options.map_coenergy, [of.map_coenergy for of in doubted(options)]
    assert [len(of) for of in others] == [len(own)] * 4
    assert all(of != own for of in others)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "gap_ratio=0.2"], "the map was computed of another section"),
        (["--valve", "first_order"], "model 'first_order' takes no designed solenoid"),
        (["--set", "valve.preload=-1"], "valve.preload: value -1.0 N is outside its limits"),
    ],
)
def test_bad_input_is_one_line(coarse, words, said, tmp_path, capsys):
    out = str(tmp_path / "x.yaml")
    assert main(["design", "export", "--map", coarse, "--out", out, *words]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1


@pytest.mark.slow
def test_the_file_that_the_demo_shows_is_that_of_the_reference(root, tmp_path):
    """20 s of CPU; another processor may round the last digits otherwise."""
    path = tmp_path / "designed.yaml"
    assert main(["design", "export", "--out", str(path)]) == 0
    shipped, computed = (
        load_config(p)[0].options for p in (root / "config" / "designed_solenoid.yaml", path)
    )
    numbers = {n: v for n, v in asdict(shipped).items() if isinstance(v, float)}
    assert {n: getattr(computed, n) for n in numbers} == pytest.approx(numbers, rel=1e-6)
    assert asdict(computed.eddies) == pytest.approx(asdict(shipped.eddies), rel=1e-6)
    assert shipped.map_coenergy == pytest.approx(computed.map_coenergy, rel=1e-6, abs=1e-12)
