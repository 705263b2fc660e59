# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A fleet is ranked by how far each valve went from its own past; one spoils no other."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.core.aging.config import AgingConfig, Threshold
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.past.columns import past_of
from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue
from valve_twin.io.history.fleet import FleetOrder, FleetRow, rank_fleet, ranked, recent_residual
from valve_twin.io.history.store import CycleRecord, History

CYCLES = 60
START_NS = 1_700_000_000_000_000_000
STEP_NS = 25_000_000_000
RATES = {"/press/valve_1": 0.0, "/press/valve_2": -0.002, "/press/valve_3": -0.0045}
"""Relative change of the inflow gain a cycle, by valve."""


def estimate(cycle, values, *, model="press_cartridge", status=EstimateStatus.ACCEPTED, mse=1e-6):
    start = START_NS + cycle * STEP_NS
    parameters = tuple(ParameterValue(name, value) for name, value in values.items())
    return Estimate(
        model,
        "output_error",
        cycle,
        start,
        start + STEP_NS - 1,
        parameters,
        status,
        "accepted",
        mse_test=mse,
        used_by_trend=True,
    )


def record(cycle):
    start = START_NS + cycle * STEP_NS
    return CycleRecord(cycle, start, start + STEP_NS - 1, 800)


@pytest.fixture(scope="module")
def url(tmp_path_factory):
    """Return a database of five valves: three that age, a silent one and one of a lost model."""
    path = tmp_path_factory.mktemp("fleet") / "history.sqlite"
    rng = np.random.default_rng(3)
    with History(path) as history:
        for valve, rate in RATES.items():
            for cycle in range(1, CYCLES + 1):
                doubtful = valve.endswith("2") and cycle % 2
                found = estimate(
                    cycle,
                    {
                        "K_in": 0.01 * (1 + rate * cycle) * (1 + 0.004 * rng.normal()),
                        "K_out": 0.045 * (1 + 0.004 * rng.normal()),
                        "leak": 1e-3 * (1 + 0.02 * rng.normal()),
                    },
                    status=EstimateStatus.PARTIAL if doubtful else EstimateStatus.ACCEPTED,
                    mse=1e-6 * (1.0 + (cycle > 40) * 8.0 * (valve.endswith("1"))),
                )
                history.store(valve, record(cycle), (found,))
        history.store("/press/valve_4", record(1))
        history.store("/press/valve_5", record(1), (estimate(1, {"x": 1.0}, model="gone"),))
    return str(path)


def rows_of(url, order=FleetOrder.URGENCY, **kind):
    with History(url, read_only=True) as history:
        return rank_fleet(history, order=order, **kind)


def test_the_valve_that_went_farthest_from_its_own_past_comes_first(url):
    rows = rows_of(url)
    assert [row.valve[-1] for row in rows] == ["3", "4", "5", "2", "1"]
    worst = rows[0]
    assert worst.verdict is VerdictKind.VALVE
    assert worst.needs_attention
    assert worst.parameter == "K_in"
    assert worst.drift_lower_95 < worst.drift < worst.drift_upper_95 < -20.0
    assert worst.drift == pytest.approx(-25.0, abs=2.0)
    assert worst.cycle == CYCLES
    assert not rows[4].needs_attention


@pytest.mark.parametrize(
    ("order", "first"),
    [
        (FleetOrder.DRIFT, "/press/valve_3"),
        (FleetOrder.RESIDUAL, "/press/valve_1"),
        (FleetOrder.CONFIDENCE, "/press/valve_4"),
        (FleetOrder.NAME, "/press/valve_1"),
    ],
)
def test_it_can_be_sorted(url, order, first):
    assert rows_of(url, order)[0].valve == first


def test_residual_and_confidence_are_those_of_the_newest_cycles(url):
    rows = {row.valve: row for row in rows_of(url)}
    assert rows["/press/valve_1"].residual == pytest.approx(3e-3)
    assert rows["/press/valve_1"].residual_ratio == pytest.approx(3.0)
    assert rows["/press/valve_3"].residual_ratio == pytest.approx(1.0)
    assert rows["/press/valve_2"].confidence == 0.5
    assert rows["/press/valve_3"].confidence == 1.0


def test_a_valve_without_a_trend_says_why(url):
    rows = {row.valve: row for row in rows_of(url)}
    assert rows["/press/valve_4"].evidence == "no stored estimate feeds a trend"
    assert "'gone' is unknown" in rows["/press/valve_5"].evidence
    assert rows["/press/valve_5"].verdict is VerdictKind.NOT_ENOUGH_DATA


def test_the_limits_of_the_configuration_count(url):
    strict = AgingConfig(thresholds=(Threshold("K_in", -8.0),))
    rows = {row.valve: row for row in rows_of(url, aging={"/press/valve_2": strict})}
    assert rows["/press/valve_2"].concern == 3
    assert {r.valve: r for r in rows_of(url)}["/press/valve_2"].concern < 3


def test_what_is_not_known_comes_last():
    rows = [FleetRow("/a"), FleetRow("/b", drift=1.0), FleetRow("/c", drift=-2.0)]
    assert [r.valve for r in ranked(rows, FleetOrder.DRIFT)] == ["/c", "/b", "/a"]
    assert [r.valve for r in ranked(rows, FleetOrder.URGENCY)] == ["/a", "/b", "/c"]


def test_worst_first_is_by_the_state_of_ne_107():
    rows = [FleetRow(f"/{state.name}", ne107=state.value) for state in reversed(Ne107)]
    assert "".join(r.valve[1] for r in ranked(rows, FleetOrder.URGENCY)) == "FOCMG"


def test_a_young_valve_has_no_residual_to_compare_with():
    first = [estimate(n, {}, mse=4e-6) for n in range(1, 6)]
    residual, ratio = recent_residual(past_of(first).trend)
    assert residual == pytest.approx(2e-3)
    assert math.isnan(ratio)
    assert all(map(math.isnan, recent_residual(past_of([estimate(1, {}, mse=math.nan)]).trend)))


def test_the_table_shows_one_line_a_valve(url, capsys):
    assert main(["fleet", "--url", url]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    lines = [line for line in out.splitlines() if "/press/valve_" in line]
    assert [line.split()[0].strip("│") for line in lines] == [r.valve for r in rows_of(url)]
    assert "5 valves" in out
    assert "K_in" in lines[0]


def test_an_ok_says_which_parameters_it_does_not_judge(tmp_path, capsys):
    """A press is ok with a leak of -50 .. +130 %: nobody saw that in the table."""
    rng = np.random.default_rng(7)
    url = str(tmp_path / "history.sqlite")
    with History(url) as history:
        for cycle in range(1, 31):
            gains = {name: 0.01 * (1.0 + 0.004 * rng.normal()) for name in ("K_in", "K_out")}
            leak = {"leak": 1e-3 * (1.0 + 0.4 * rng.normal())}
            history.store("/press", record(cycle), (estimate(cycle, gains | leak),))
    (row,) = rows_of(url)
    assert (row.verdict, row.unjudged) == (VerdictKind.OK, "leak")
    assert row.evidence.startswith("a limit of leak is within the doubt: ")
    assert main(["fleet", "--url", url]) == 0
    assert "not judged: leak" in " ".join(capsys.readouterr().out.split())
    assert main(["fleet", "--url", url, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unjudged"] == "leak"


def test_json_lines_are_ranked_and_strict(url, capsys):
    assert main(["fleet", "--url", url, "--json", "--sort", "drift"]) == 0
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["rank"] for row in found] == [1, 2, 3, 4, 5]
    assert found[0]["valve"] == "/press/valve_3"
    assert found[0]["verdict"] == "VALVE"
    assert found[-1]["drift"] is None


def test_check_fails_where_a_valve_needs_attention(url, tmp_path, capsys):
    assert main(["fleet", "--url", url, "--json", "--check"]) == 1
    healthy = tmp_path / "healthy.sqlite"
    with History(healthy) as history:
        history.store("/a", record(1))
    assert main(["fleet", "--url", str(healthy), "--check"]) == 0
    capsys.readouterr()


def test_an_empty_or_missing_database_is_one_line(tmp_path, capsys):
    empty = tmp_path / "empty.sqlite"
    History(empty).close()
    assert main(["fleet", "--url", str(empty)]) == 1
    assert "holds no valve" in capsys.readouterr().err
    assert main(["fleet", "--url", str(tmp_path / "none.sqlite")]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1
