# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from test.io.configure.test_survey import slew_valve, survey, switched
from valve_twin.core.aging.drift import wanted_limits
from valve_twin.io.config.valve import load_config
from valve_twin.io.configure.channels import look
from valve_twin.io.configure.limits import LEAST_CYCLES, Limit, justified_limits, limit_of
from valve_twin.io.configure.proposal import yaml_text
from valve_twin.io.configure.survey import choose
from valve_twin.io.instruments.clock import ClockChoice


@pytest.mark.parametrize("seed", range(20))
def test_no_limit_lies_inside_the_scatter(seed):
    rng = np.random.default_rng(seed)
    scatter = rng.uniform(0.001, 0.3)
    draw = [rng.normal, rng.standard_cauchy][seed % 2]  # some cycles may lie far off
    values = -3.0 * (1.0 + scatter * np.asarray(draw(size=rng.integers(10, 40))))
    limit = limit_of("speed", values)
    centre = np.median(values)
    worst = 100.0 * np.max(np.abs(values / centre - 1.0))
    if np.isfinite(limit.percent):
        assert limit.percent > worst
        assert limit.percent >= 20.0
        assert "scatter by" in limit.reason
    else:
        assert worst > 20.0
        assert limit.reason.startswith("none: ")


@pytest.mark.parametrize(
    ("values", "why"),
    [
        (np.full(LEAST_CYCLES - 1, 2.0), "9 estimates"),
        (np.array([]), "0 estimates"),
        (np.full(30, 2.0), "does not vary"),
        (np.tile([-1.0, 1.0], 10), "scatters about 0"),
        (np.tile([3.0, 4.0], 10), "single cycles scatter by"),
    ],
)
def test_what_supports_no_limit_gets_none_with_the_reason(values, why):
    limit = limit_of("speed", values)
    assert np.isnan(limit.percent)
    assert why in limit.reason


@pytest.mark.usefixtures("one_model")
def test_a_proposed_limit_stands_up_and_down(tmp_path):
    command = switched()
    survey(tmp_path / "a.csv", {"command [mm]": command, "stroke [mm]": slew_valve(command)})
    seen, choice = choose(look([tmp_path / "a.csv"], ClockChoice()))
    text = yaml_text(seen, choice, ["a.csv"], [Limit("time_constant", 20.0, "as the test says")])
    (tmp_path / "valve.yaml").write_text(text)
    aging = load_config(tmp_path / "valve.yaml")[0].aging
    assert [t.value for t in wanted_limits(aging, "time_constant")] == [-20.0, 20.0]
    assert not wanted_limits(aging, "dead_band")


def test_too_few_cycles_are_not_estimated():
    text = "/**:\n  ros__parameters:\n    model: first_order\n    period_s: 0.01\n"
    limits = justified_limits(text, [Path("not there.csv")], count=3.0)
    assert [limit.parameter for limit in limits] == ["time_constant", "dead_band"]
    assert {limit.reason for limit in limits} == {"none: 3 cycles, 10 tell the scatter"}


@pytest.mark.no_cover
@pytest.mark.usefixtures("no_black_box")
def test_the_gain_of_a_static_curve_is_followed_where_the_proposal_has_one(tmp_path):
    text = "/**:\n  ros__parameters:\n    model: positioner\n    period_s: 0.01\n"
    names = [x.parameter for x in justified_limits(text, [Path("not there.csv")], count=3.0)]
    assert "static_gain" not in names
    text += "    options:\n      static_curve: true\n"
    more = [x.parameter for x in justified_limits(text, [Path("not there.csv")], count=3.0)]
    assert more == [*names, "dead_command", "static_gain"]
    levels = np.repeat(np.random.default_rng(5).choice([10.0, 20.0, 35.0], 15), 100)
    levels[np.arange(len(levels)) % 100 < 40] = 0.0
    flow = slew_valve(np.clip(1.4 * levels - 8.0, 0.0, None))
    found = survey(tmp_path / "flow.csv", {"valve command [%]": levels, "flow [l/min]": flow})
    timed, choice = choose(found)
    assert choice.trials[0].options.get("static_curve") is True
    limits = [Limit(name, np.nan, "none") for name in more]
    written = tmp_path / "valve.yaml"
    written.write_text(yaml_text(timed, choice, ["flow.csv"], limits), encoding="utf-8")
    assert load_config(written)[0].aging.parameters == tuple(more)
    assert "      parameters:" not in yaml_text(timed, choice, ["flow.csv"])
