# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin bench-fit`: every kind on its sample, the picture, one line on bad input."""

import json
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.cli.bench_fit import known_fits

RATE = ["--set", "spring_rate=18820"]
TRUTH = {
    "static-force": {"saturation_flux": 0.046, "c1": 7.0e-6, "c2": 6.04e-5, "c3": 2.18e-4},
    "ring-down": {"damping_ratio": 0.036, "natural_frequency": 380.7345, "mass": 0.12983},
    "current": {"resistance": 0.34, "inductance": 2 * 2.8e-7 / (0.5e-3 + 1.04e-6)},
    "dynamics": {"b1": 0.25, "b2": 0.010, "a1": 0.75, "a2": 0.090},
}


@pytest.fixture
def samples(root):
    return root / "samples" / "bench"


def values_of(capsys, *arguments):
    assert main(["bench-fit", *map(str, arguments), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["doubt"] == ""
    return found["values"]


def refusal(capsys, *arguments):
    code = main(["bench-fit", *map(str, arguments)])
    assert code in {1, 2}
    shown = capsys.readouterr().err
    assert shown.count("\n") == 1
    return shown


@pytest.mark.parametrize("kind", TRUTH)
def test_the_intervals_of_the_samples_hold_the_truth(kind, samples, capsys):
    extra = RATE if kind == "ring-down" else []
    found = values_of(capsys, kind, samples / f"{kind}.csv", *extra)
    for name, true in TRUTH[kind].items():
        assert found[name]["lower_95"] <= true <= found[name]["upper_95"], name


def test_a_loop_has_the_width_of_the_simulated_hysteresis(samples, capsys):
    found = values_of(capsys, "hysteresis-loop", samples / "hysteresis-loop.csv")
    assert found["width"]["value"] == pytest.approx(4.914e-3, rel=0.01)
    assert found["swing"]["value"] == pytest.approx(0.12, rel=0.005)


def test_every_step_is_judged_by_itself(samples, capsys):
    found = values_of(capsys, "step", samples / "step.csv")
    assert [found[f"step {k}"]["value"] for k in (1, 2, 3)] == pytest.approx([0.4, -0.8, 0.4])
    for k in (1, 2, 3):
        assert 0.002 < found[f"rise {k}"]["value"] < found[f"settling {k}"]["value"] < 0.012


@pytest.mark.parametrize("kind", [*TRUTH, "hysteresis-loop", "step"])
def test_the_picture_is_an_svg_with_points_and_lines(kind, samples, tmp_path, capsys):
    extra = RATE if kind == "ring-down" else []
    path = tmp_path / "fit.svg"
    assert (
        main(["bench-fit", kind, str(samples / f"{kind}.csv"), *extra, "--plot", str(path)]) == 0
    )
    assert "95 % interval" in capsys.readouterr().out
    shown = path.read_text(encoding="utf-8")
    assert ET.fromstring(shown).tag.endswith("svg")
    assert 'class="dot"' in shown
    assert 'class="fit"' in shown
    assert "nan" not in shown


def test_without_a_kind_all_are_listed(capsys):
    assert main(["bench-fit"]) == 0
    shown = capsys.readouterr().out
    assert [kind for kind in known_fits() if kind not in shown] == []


def test_units_of_the_columns_are_taken(samples, tmp_path, capsys):
    rows = np.loadtxt(samples / "ring-down.csv", delimiter=",", skiprows=1)
    path = tmp_path / "si.csv"
    rows = rows * [1e-3, 1e3]
    np.savetxt(path, rows, delimiter=";", header="time_s;position_um", comments="")
    found = values_of(capsys, "ring-down", path, *RATE)
    assert found["mass"]["value"] == pytest.approx(0.12983, rel=1e-3)


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ("time,position_mm", "column 'time' has no unit; name it time_s or time_ms or time_us"),
        ("time_h,position_mm", "column 'time_h': unit 'h' is not known; name it time_s or"),
        ("time_ms,place_mm", "there is no column position_m or position_mm or position_um"),
        ("time_ms,time_s", "columns time_ms and time_s say the same; keep one"),
    ],
)
def test_a_column_that_cannot_be_read_is_told_in_one_line(header, line, tmp_path, capsys):
    path = tmp_path / "bad.csv"
    path.write_text(f"{header}\n0,1\n1,2\n", encoding="utf-8")
    assert line in refusal(capsys, "ring-down", path, *RATE)


def test_a_cell_without_a_number_is_told_with_its_line(tmp_path, capsys):
    path = tmp_path / "bad.csv"
    path.write_text("time_ms,position_mm\n0,1\n1,\n2,3\n", encoding="utf-8")
    shown = refusal(capsys, "ring-down", path, *RATE)
    assert f"{path}:3: column 'position_mm': no finite number" in shown


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["ring-down"], "give a CSV file with time_s, position_m"),
        (["ring-donw"], "there is no kind 'ring-donw'; did you mean 'ring-down'"),
        (["ring-down", "x.csv"], "spring rate [N/m] is not in the record; give --set"),
        (["ring-down", "x.csv", "--set", "spring_rate=k"], "write a number"),
        (["current", "x.csv", "--set", "gain=1"], "there is no such setting; it takes none"),
        (["static-force", "x.csv", "--set", "kernel=lin"], "--set kernel=lin: "),
        (["current", "x.csv"], "x.csv: there is no such file; give one that is there"),
    ],
)
def test_a_wrong_call_is_told_in_one_line(arguments, line, capsys):
    assert line in refusal(capsys, *arguments)


def test_a_record_that_no_such_dynamics_made_ends_with_1(samples, tmp_path, capsys):
    rows = np.loadtxt(samples / "dynamics.csv", delimiter=",", skiprows=1)
    rows[:, 2] *= 3.0
    path = tmp_path / "gain.csv"
    np.savetxt(path, rows, delimiter=",", header="time_us,input_N,output_N", comments="")
    assert "do not use these values: a1 = " in refusal(capsys, "dynamics", path)
