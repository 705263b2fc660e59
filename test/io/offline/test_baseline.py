# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A model beside ARX and a line through the inputs."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from valve_twin.cli import main
from valve_twin.core.types import Cycle, Estimate, EstimateStatus, Frames
from valve_twin.io.offline.baseline import Baselines, compare_baselines

N = 400


def cycle(number, seed=0):
    """A second-order lag of two commands, free of noise."""
    u = np.repeat(np.random.default_rng(seed).uniform(size=(N // 20, 2)), 20, axis=0)
    y = lfilter([0.1], [1.0, -1.2, 0.3], u @ [1.0, 0.5])
    nothing = np.full(N, np.nan)
    stamps = (number * N + np.arange(N)) * 10**8
    frames = Frames(stamps, y, u, nothing, nothing, np.ones(N, dtype=np.bool_))
    return Cycle(number, 0.1, frames)


def estimate(number, fit):
    return Estimate(
        model="any", estimator="any", cycle=number, start_ns=0, end_ns=1, parameters=(),
        status=EstimateStatus.ACCEPTED, reason="", fit_test=fit, used_by_trend=True,
    )  # fmt: skip


def record(fits, driven=(0, 1)):
    driven = list(driven)
    return SimpleNamespace(
        newest=[cycle(n, n) for n in range(1, len(fits) + 1)],
        estimates=[estimate(n + 1, fit) for n, fit in enumerate(fits)],
        driven=driven,
    )


def test_arx_of_the_cycle_before_follows_a_linear_valve_of_two_commands():
    found = compare_baselines(record([math.nan, 90.0, 80.0]))
    assert found is not None
    assert (found.cycles, found.model) == (2, 85.0)
    assert found.arx > 99.9
    assert found.line < 60.0
    assert found.worse
    assert "free run, test" in found.text
    assert "do not rely" in found.text


def test_a_baseline_sees_what_the_free_run_of_the_model_sees():
    one = compare_baselines(record([math.nan, 90.0, 80.0], driven=[1]))
    assert one is not None
    assert one.arx < 90.0
    assert compare_baselines(record([math.nan, 90.0], driven=[])) is None


def test_a_model_that_follows_better_is_not_doubted():
    found = Baselines(3, 97.0, 96.0, 10.0)
    assert not found.worse
    assert "do not rely" not in found.text
    assert not replace(found, arx=97.5).worse  # less than a point decides nothing
    assert replace(found, arx=math.nan, line=99.0).worse


def test_there_is_nothing_to_compare_in_one_cycle_or_without_a_test():
    assert compare_baselines(record([90.0])) is None
    assert compare_baselines(record([90.0, math.nan])) is None


def test_a_refused_estimate_is_not_compared():
    given = record([90.0, 90.0])
    given.estimates[1] = replace(given.estimates[1], status=EstimateStatus.REFUSED)
    assert compare_baselines(given) is None


def test_estimate_and_report_tell_the_baselines(root, tmp_path, capsys):
    bag, page = tmp_path / "bag", tmp_path / "page.html"
    config = ["--config", str(root / "config" / "first_order.yaml")]
    assert main(["simulate", *config, "--cycles", "4", "--out", str(bag)]) == 0
    capsys.readouterr()
    main(["estimate", str(bag), *config])
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    (line,) = [x for x in lines if x["kind"] == "baseline"]
    assert line["error"] == "free run, test"
    assert line["cycles"] == 3
    assert line["model_fit"] > line["arx_fit"] > line["line_fit"] > 0.0
    assert line["worse_than_baseline"] is False
    assert main(["report", str(bag), *config, "--out", str(page)]) == 0
    assert f"ARX {line['arx_fit']:.1f} %" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("fit", [math.nan, math.inf])
def test_a_fit_that_is_not_known_is_null(fit):
    assert Baselines(1, 50.0, fit, 1.0).fields("v")["arx_fit"] is None
