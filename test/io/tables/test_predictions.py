# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Predictions as a table; errors on unknown cycles; a model that stops learning."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.core.types import Prediction, Validity
from valve_twin.io.config.valve import load_config
from valve_twin.io.offline.run import estimate_bag, run_bag
from valve_twin.io.tables.predictions import COLUMNS, cycle_error, write_predictions

CONFIG = Path(__file__).resolve().parents[3] / "config" / "simulated_press.yaml"
CYCLES, LEARNT = 24, 8


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Return a press valve whose filling area shrinks by 1 % a cycle."""
    path = tmp_path_factory.mktemp("predictions") / "bag"
    rate = "aging.area_in.rate=-0.01"
    simulate = ["simulate", "--config", str(CONFIG), "--cycles", str(CYCLES), "--set", rate]
    assert main([*simulate, "--out", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def config():
    return load_config(CONFIG)[0]


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_a_row_a_sample_holds_the_bits_of_the_twin(bag, config, tmp_path):
    out = tmp_path / "p.csv"
    write_predictions(config, bag, out)
    parts = [e for e in estimate_bag(config, bag) if isinstance(e, Prediction)]
    rows = rows_of(out)
    assert tuple(rows[0]) == COLUMNS
    assert [int(r["stamp_ns"]) for r in rows] == np.concatenate(
        [p.stamp_ns for p in parts]
    ).tolist()
    for column, name in (("one_step", "predicted"), ("free_run", "simulated")):
        expected = np.concatenate([getattr(p, name) for p in parts])
        np.testing.assert_array_equal([float(r[column]) for r in rows], expected)
    valid = [r for r in rows if r["validity"] == "valid"]
    assert len(valid) > 1000
    difference = [float(r["measured"]) - float(r["one_step"]) for r in valid]
    np.testing.assert_array_equal(difference, [float(r["residual"]) for r in valid])
    assert {r["validity"] for r in rows} <= {v.name.lower() for v in Validity}


def test_parquet_holds_what_csv_holds(bag, config, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    first, second = tmp_path / "p.csv", tmp_path / "p.parquet"
    assert write_predictions(config, bag, first) == write_predictions(config, bag, second)
    table, rows = parquet.read_table(second), rows_of(first)
    assert tuple(table.column_names) == COLUMNS
    assert table["stamp_ns"].to_pylist() == [int(r["stamp_ns"]) for r in rows]
    np.testing.assert_array_equal(
        table["free_run"].to_numpy(), [float(r["free_run"]) for r in rows]
    )


def test_a_frozen_model_stays_what_it_was_and_falls_behind_the_valve(bag, config, tmp_path):
    learning = write_predictions(config, bag, tmp_path / "a.csv")
    frozen = write_predictions(config, bag, tmp_path / "b.csv", freeze_after=LEARNT)
    assert [e.cycle for e in learning] == [e.cycle for e in frozen]
    for ours, theirs in zip(frozen, learning, strict=True):
        assert ours.frozen == (ours.cycle > LEARNT)
        if ours.cycle <= LEARNT:
            assert (ours.one_step_rmse, ours.free_run_fit) == (
                theirs.one_step_rmse,
                theirs.free_run_fit,
            )
    assert learning[-1].free_run_fit > 90.0
    assert frozen[-1].free_run_fit < learning[-1].free_run_fit - 10.0
    fits = [e.free_run_fit for e in frozen if e.cycle > LEARNT + 2]
    assert fits[-1] < fits[len(fits) // 2] < fits[0]


def test_estimates_of_a_frozen_run_are_made_of_each_cycle_and_tested_on_the_frozen_model(
    bag, config
):
    learning = [e for e in run_bag(config, bag, predict=False).estimates if e.used_by_trend]
    run = run_bag(config, bag, predict=False, freeze_after=LEARNT)
    frozen = [e for e in run.estimates if e.used_by_trend]
    assert [e.cycle for e in frozen] == [e.cycle for e in learning]
    gain = [e.value("K_in") for e in frozen]
    assert gain[-1] == pytest.approx(learning[-1].value("K_in"), rel=0.02)
    assert gain[-1] < 0.9 * gain[2]
    assert frozen[-1].fit_test < learning[-1].fit_test - 10.0


def test_too_few_valid_samples_have_no_error():
    ones = np.ones(9)
    part = Prediction(1, np.arange(9), ones, ones, ones, 0 * ones, 0.1, np.zeros(9, np.uint8))
    error = cycle_error(1, [part], frozen=False)
    assert math.isnan(error.one_step_rmse)
    assert math.isnan(error.free_run_fit)


def test_the_command_says_which_model_and_which_error(bag, tmp_path, capsys):
    out = tmp_path / "p.csv"
    command = ["predict", str(bag), "--config", str(CONFIG), "--out", str(out), "--freeze", "8"]
    assert main(command) == 0
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 2
    assert "model learnt from the cycles before; median on cycles that it does not know" in said[0]
    assert "model frozen" in said[1]
    assert main([*command, "--json"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [x["model"] for x in lines if x["cycle"] > LEARNT] == ["frozen"] * (CYCLES - LEARNT)


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (["--out", "p.txt"], "end it in .csv or .parquet"),
        (["--out", "p.csv", "--freeze", "0"], "a number of cycles, 1 or more"),
        (["--out", "none/p.csv"], "check the folder"),
    ],
)
def test_wrong_arguments_get_one_line(bag, tmp_path, monkeypatch, capsys, extra, said):
    monkeypatch.chdir(tmp_path)
    try:
        code: object = main(["predict", str(bag), "--config", str(CONFIG), *extra])
    except SystemExit as err:
        code = err.code
    assert code in (1, 2)
    assert said in capsys.readouterr().err
