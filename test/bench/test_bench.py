# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The short benchmark: same results as the peers, ratios held to their goals."""

from __future__ import annotations

import re

import numpy as np
import pytest

from valve_twin.bench import Ratio, describe, require_equal, run, run_benchmarks
from valve_twin.bench.models import estimation

LINE = re.compile(
    r"(.+): (\S+) x (.+) \(goal (\S+) x(?:, committed \S+ x)?; (\S+) ms against (\S+) ms\) "
    r"(ok|reported, goal (?:not )?reached)"
)


@pytest.mark.alone
def test_every_line_of_an_area_says_what_was_compared_and_how_it_ended():
    """All areas run as a step of `make test`, which fails where a goal is missed by half."""
    lines: list[str] = []
    assert run_benchmarks(quick=True, write=lines.append, areas=["simulation", "estimation"])
    reference, *ratios = "".join(lines).splitlines()
    assert reference.startswith("reference loop")
    found = [match for match in map(LINE.fullmatch, ratios) if match]
    assert len(found) == len(ratios) >= 3
    for match in found:
        value, goal, ours, peer = (float(match[i]) for i in (2, 4, 5, 6))
        assert value >= 0.5 * goal or match[7].startswith("reported")
        assert value == pytest.approx(peer / ours, rel=0.02)


def test_a_ratio_below_half_its_goal_fails():
    def ratio(peer_s: float) -> Ratio:
        return Ratio("ours", "theirs", 1.0, peer_s, goal=20.0)

    assert ratio(10.0).passed
    assert describe(ratio(10.0)).endswith(" ok")
    assert not ratio(9.9).passed
    assert describe(ratio(9.9)).endswith("BELOW HALF ITS GOAL")


def test_what_is_only_reported_fails_nothing_and_says_whether_it_reached_its_goal():
    def ratio(peer_s: float) -> Ratio:
        return Ratio("ours", "theirs", 1.0, peer_s, goal=20.0, held=False)

    assert ratio(9.9).passed
    assert describe(ratio(9.9)).endswith(" reported, goal not reached")
    assert describe(ratio(20.0)).endswith(" reported, goal reached")


def test_one_failed_comparison_fails_the_benchmark(monkeypatch):
    ratios = [Ratio("a", "b", 1.0, 1.0, 20.0), Ratio("c", "d", 1.0, 30.0, 20.0)]
    monkeypatch.setattr(run, "_comparisons", lambda *_: iter(ratios))
    lines: list[str] = []
    assert not run_benchmarks(quick=True, write=lines.append)
    assert sum("BELOW HALF" in line for line in lines) == 1


def test_the_committed_ratio_stands_beside_the_measured_one():
    ratio = Ratio("ours", "theirs", 1.0, 30.0, goal=20.0)
    assert "30 x theirs (goal 20 x, committed 31.5 x; " in describe(ratio, 31.5)


def test_no_ratio_is_given_of_results_that_differ():
    with pytest.raises(AssertionError, match="predictions differ from those of a loop"):
        require_equal(np.ones(3), np.array([1.0, 1.0, 2.0]), "predictions", "a loop")
    with pytest.raises(AssertionError, match="costs differ"):
        estimation._same_cost(1.001, 1.0)
