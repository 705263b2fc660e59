# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parameter sets as SSV: along the trend to a date, and draws that scatter as the intervals."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from datetime import datetime, timezone

import numpy as np
import pytest

from test.gateway.fmu.test_valve import made, record
from valve_twin.cli import main
from valve_twin.core.types import ParameterStatus, ParameterValue
from valve_twin.gateway.fmu.parameter_sets import LEAST_PAIRS, correlation, draw_sets, ssv
from valve_twin.gateway.fmu.valve import law_of, valve_of
from valve_twin.io.history.store import History
from valve_twin.io.history.tables import CycleRecord

DAY_NS = 86_400_000_000_000
LAW = law_of("first_order").law
SPACE = {
    "v": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "c": "http://ssp-standard.org/SSP1/SystemStructureCommon",
}


def read(text):
    root = ET.fromstring(text)
    found = root.findall("v:Parameters/v:Parameter", SPACE)
    values = {p.get("name"): dict(p[0].items()) for p in found}
    units = {u.get("name") for u in root.findall("v:Units/c:Unit", SPACE)}
    assert {r.get("unit") for r in values.values()} == units
    return root, {name: float(r["value"]) for name, r in values.items()}


def test_draws_scatter_as_the_interval_says_and_stay_in_the_bounds():
    values = (
        ParameterValue("time_constant", 0.4, lower_95=0.38, upper_95=0.42),
        ParameterValue("dead_band", 0.001, lower_95=0.0, upper_95=0.011),
    )
    estimate = made(values=values)
    valve = valve_of("db", "/v", estimate, record())
    drawn = [s.values for s in draw_sets(valve, LAW, estimate, 4000, 1)]
    tau = np.array([d["time_constant"] for d in drawn])
    assert np.mean((tau >= 0.38) & (tau <= 0.42)) == pytest.approx(0.95, abs=0.012)  # 3.5 sigma
    assert min(d["dead_band"] for d in drawn) == 0.0
    again = [s.values for s in draw_sets(valve, LAW, estimate, 4000, 1)]
    assert again == drawn


NAMES = "time_constant", "dead_band"
SIGMAS = np.array([0.01, 0.002])


def cycles(seed, rho, count=101):
    """Return estimates whose errors go together; the valve drifts and is mended once."""
    random = np.random.default_rng(seed)
    errors = random.multivariate_normal([0.0, 0.0], [[1.0, rho], [rho, 1.0]], count)
    past = []
    for k, error in enumerate(errors):
        truth = np.array([0.4 + 1e-4 * k, 0.05]) + (0.1 if k > 60 else 0.0)
        values = truth + SIGMAS * error
        bounds = [(v - 1.96 * s, v + 1.96 * s) for v, s in zip(values, SIGMAS, strict=True)]
        found = [ParameterValue(n, v, lower_95=lower, upper_95=upper)
                 for n, v, (lower, upper) in zip(NAMES, values, bounds, strict=True)]  # fmt: skip
        past.append(made(k + 1, tuple(found)))
    return past


def drawn_of(past, seed):
    """Return draws of the last estimate, in its standard deviations."""
    valve = valve_of("db", "/v", past[-1], record(past[-1].cycle))
    sets = draw_sets(valve, LAW, past[-1], 500, seed, past)
    found = np.array([[s.values[name] for name in NAMES] for s in sets])
    return (found - [p.value for p in past[-1].parameters]) / SIGMAS, sets[0].text


@pytest.mark.parametrize("rho", [-0.9, 0.0, 0.6])
def test_draws_go_together_as_the_errors_of_the_estimates_do(rho):
    seeds = 60
    draws = [drawn_of(cycles(seed, rho), seed)[0] for seed in range(seeds)]
    found = np.array([np.corrcoef(d, rowvar=False)[0, 1] for d in draws])
    # by ranks of 100 changes with an error in common: (1 - rho^2) sqrt(1.5 * 1.1 / 100), draws
    # add 1 / sqrt(500); what cannot be told from none is none, which at 0.6 never happens
    scatter = (1.0 - rho**2) * np.sqrt(1.65 / 100 + 1.0 / 500)
    assert abs(found.mean() - rho) < 4.0 * scatter / np.sqrt(seeds) + 0.01
    assert found.std() < 1.5 * scatter
    whole = np.concatenate(draws)
    assert np.std(whole, axis=0) == pytest.approx([1.0, 1.0], abs=0.02)  # the intervals stay
    assert np.var(whole.sum(axis=1)) == pytest.approx(2.0 * (1.0 + rho), abs=0.15)


def test_too_few_cycles_tell_no_correlation_and_the_set_says_so():
    past = cycles(1, -0.9, LEAST_PAIRS)
    drawn, text = drawn_of(past, 1)
    assert abs(np.corrcoef(drawn, rowvar=False)[0, 1]) < 4.0 / np.sqrt(500)
    assert f"independent: fewer than {LEAST_PAIRS} pairs" in text
    _, text = drawn_of(cycles(1, -0.9, LEAST_PAIRS + 1), 1)
    assert f"correlated as the estimates of {LEAST_PAIRS} pairs" in text


def test_a_parameter_that_never_changes_goes_with_none():
    past = [
        replace(e, parameters=(e.parameters[0], replace(e.parameters[1], value=0.05)))
        for e in cycles(1, 0.9)
    ]
    found = correlation(past, NAMES)
    assert found is not None
    assert found.matrix.tolist() == [[1.0, 0.0], [0.0, 1.0]]


def test_what_rests_on_a_bound_is_not_drawn():
    estimate = made()
    assert estimate.parameters[1].status is ParameterStatus.AT_BOUND
    valve = valve_of("db", "/v", estimate, record())
    assert {s.values["dead_band"] for s in draw_sets(valve, LAW, estimate, 20, 1)} == {0.0}


def test_a_set_names_its_units_and_where_it_comes_from():
    estimate = made()
    valve = valve_of("db", "/v", estimate, record())
    (one,) = draw_sets(valve, LAW, estimate, 1, 7)
    root, values = read(ssv(valve, one))
    assert values == one.values
    assert root.get("version") == "1.0"
    assert "seed 7" in root.get("description")
    assert "/v as estimated from cycle 3" in root.get("description")


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    """Return a history of a valve whose time constant grows 0.001 s a day, a cycle each."""
    path = tmp_path_factory.mktemp("sets") / "history.sqlite"
    random = np.random.default_rng(4)
    with History(path) as history:
        for cycle in range(1, 61):
            start = (18_000 + cycle) * DAY_NS
            tau = 0.4 + 0.001 * cycle + 2e-4 * random.standard_normal()
            values = (
                ParameterValue("time_constant", tau, lower_95=tau - 4e-4, upper_95=tau + 4e-4),
                ParameterValue("dead_band", 0.01 + 1e-5 * random.standard_normal()),
            )
            estimate = made(cycle, values)
            end = start + 19_950_000_000
            estimate = replace(estimate, start_ns=start, end_ns=end, used_by_trend=True)
            history.store("/v", CycleRecord(cycle, start, end, 400), (estimate,))
    return path


def test_a_drifting_parameter_is_aged_along_its_trend_and_a_steady_one_is_not(worn, tmp_path):
    pytest.importorskip("fmpy")
    pytest.importorskip("ziglang")
    date = datetime.fromtimestamp((18_060 + 100) * 86_400, tz=timezone.utc)
    out = tmp_path / "v.fmu"
    arguments = ["--aged-to", f"{date:%Y-%m-%d}", "--draws", "20", "--out", str(out)]
    assert main(["export-fmu", "--url", str(worn), "--valve", "v", *arguments]) == 0
    _, aged = read((tmp_path / f"v_aged_{date:%Y-%m-%d}.ssv").read_bytes())
    assert aged["time_constant"] == pytest.approx(0.56, abs=0.003)
    assert aged["dead_band"] == pytest.approx(0.01, abs=1e-4)
    assert len(list(tmp_path.glob("v_draw_*.ssv"))) == 20


@pytest.mark.parametrize(
    ("date", "code", "said"),
    [("2019-05-01", 1, "lies before the last cycle"), ("May", 2, "write a date as YYYY-MM-DD")],
)
def test_a_date_that_cannot_be_is_one_line(worn, tmp_path, capsys, date, code, said):
    arguments = ["--url", str(worn), "--valve", "v", "--out", str(tmp_path / "v.fmu")]
    got: object
    try:
        got = main(["export-fmu", *arguments, "--aged-to", date])
    except SystemExit as end:
        got = end.code
    text = capsys.readouterr().err
    assert (got, text.count("\n")) == (code, 1)
    assert said in text
