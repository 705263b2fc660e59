# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin backtest` over a stored history: table, JSON, exit codes, one line of error."""

import json

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.core.types import Estimate, EstimateStatus, Maintenance, ParameterValue
from valve_twin.io.history.store import CycleRecord, History

CONFIG = """\
/**:
  ros__parameters:
    model: press_cartridge
    valves: [press/worn, press/still, press/other]
    aging:
      parameters: [K_in]
      thresholds: {K_in: {value: -20.0}}
"""
CYCLES = 140
STEP_NS = 30_000_000_000


def store(history, valve, values):
    for cycle, value in enumerate(values, 1):
        start, end = cycle * STEP_NS, cycle * STEP_NS + STEP_NS - 1
        found = Estimate(
            "press_cartridge",
            "output_error",
            cycle,
            start,
            end,
            (ParameterValue("K_in", float(value)),),
            EstimateStatus.ACCEPTED,
            "",
            used_by_trend=True,
        )
        history.store(valve, CycleRecord(cycle, start, end, 800), [found])


@pytest.fixture(scope="module")
def url(tmp_path_factory):
    """Return a database of a valve that wears and is renewed once, and of one that does not."""
    path = tmp_path_factory.mktemp("backtest") / "history.sqlite"
    rng = np.random.default_rng(1)
    fall = 0.01 * (1.0 - 0.002 * np.arange(1, CYCLES + 1))
    with History(path) as history:
        store(history, "/press/worn", np.tile(fall, 2) + 1e-4 * rng.standard_normal(2 * CYCLES))
        renewed = Maintenance(0, CYCLES + 1, "cartridge changed", new_reference=True)
        history.add_maintenance("/press/worn", renewed)
        store(history, "/press/still", 0.01 + 1e-4 * rng.standard_normal(40))
    return str(path)


@pytest.fixture
def command(tmp_path, url):
    """Return the arguments of the verb for a valve."""
    path = tmp_path / "valves.yaml"
    path.write_text(CONFIG, encoding="utf-8")
    return ["backtest", "--url", url, "--config", str(path), "--forecasts", "10"]


def objects(capsys):
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_each_life_of_a_stored_history_is_judged(command, capsys):
    assert main([*command, "--json"]) == 0
    first, second = objects(capsys)
    assert (first["start"], second["start"]) == (1.0, CYCLES + 1.0)
    for life in (first, second):
        assert life["service_limit_reached"]
        assert life["limit"] == -20.0
        # the reference is the mean of cycles 1 to 10; the line is at 80 % of it at cycle 104.4
        assert life["end"] - life["start"] + 1 == pytest.approx(104.4, abs=4.0)
        assert len(life["forecasts"]) + life["silent"] == 10
        held = [f["low"] <= f["truth"] <= float(f["high"]) for f in life["forecasts"]]
        assert life["coverage"] == pytest.approx(np.mean(held))
        assert [a["lambda"] for a in life["alpha_lambda"]] == [0.25, 0.5, 0.75]


def test_the_table_says_what_was_judged(command, capsys):
    assert main(command) == 0
    shown = capsys.readouterr().out
    for word in ("/press/worn", "K_in", "(-20.0 %)", "in 90%", "error 25/50/75 %", "judged"):
        assert word in shown


def test_limits_of_another_confidence_are_wider(command, capsys):
    widths = []
    for confidence in ("0.5", "0.99"):
        assert main([*command, "--json", "--confidence", confidence]) == 0
        last = objects(capsys)[0]["forecasts"][-1]
        widths.append(last["high"] - last["low"])
    assert widths[1] > 2.0 * widths[0]


@pytest.mark.parametrize(
    ("valve", "says"),
    [
        ("press/still", "nothing to judge: no limit reached and no drift to foresee"),
        ("press/other", "holds no estimate of /press/other that feeds a trend"),
    ],
)
def test_nothing_to_judge_is_said_in_one_line(command, capsys, valve, says):
    assert main([*command, "--valve", valve]) == 1
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "give --url and --config, or --study"),
        (["--url", "x.sqlite"], "give --url and --config, or --study"),
    ],
)
def test_what_is_missing_is_named(capsys, arguments, says):
    assert main(["backtest", *arguments]) == 2
    assert says in capsys.readouterr().err


def test_a_share_is_a_number_between_zero_and_one(command, capsys):
    with pytest.raises(SystemExit, match="2"):
        main([*command, "--alpha", "20"])
    assert "'20' is refused: write a number between 0 and 1" in capsys.readouterr().err


def test_the_study_prints_coverage_and_the_unbounded_share(capsys):
    assert main(["backtest", "--study", "20", "--json"]) == 0
    every = objects(capsys)
    rows = [r for r in every if r["kind"] == "coverage"]
    assert [(r["samples"], r["autocorrelation"]) for r in rows] == [
        (60, 0.0),
        (105, 0.0),
        (60, 0.5),
        (105, 0.5),
    ]
    for row in rows:
        parts = row["covered"] + row["too_early"] + row["too_late"] + row["silent"]
        assert parts == pytest.approx(1.0)
        assert 0.0 <= row["unbounded"] <= 1.0
    laws = [r for r in every if r["kind"] == "law_coverage"]
    assert [r["law"] for r in laws] == ["line", "exponential", "power", "saturating"]
    for row in laws:
        assert row["covered"] + row["too_early"] + row["too_late"] == pytest.approx(1.0)
    assert main(["backtest", "--study", "20"]) == 0
    shown = capsys.readouterr().out
    assert "20 simulated lines each, known to be lines, 90% limits" in shown
    assert "20 random histories of each law" in shown
    assert "Brier skill" in shown
