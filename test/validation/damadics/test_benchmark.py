# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import pytest

from valve_twin.validation import Verdict, get_benchmark
from valve_twin.validation.damadics.benchmark import WHY_NOT


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_benchmark_keeps_its_goals_and_names_what_it_does_not_see():
    benchmark = get_benchmark("damadics")
    steps = []
    found = benchmark.run(lambda: steps.append(1))
    assert len(steps) == benchmark.steps
    failed = [f"{c.item}, {c.quantity}: {c.obtained}" for c in found.checks
              if c.verdict is Verdict.FAIL]  # fmt: skip
    assert failed == []
    official = next(iter(found.tables.values()))
    missed = {
        r["scenario"] for r in official if r["scenario"] != "healthy" and float(r["r_td"]) <= 0.5
    }
    assert missed <= set(WHY_NOT)


def test_an_unknown_benchmark_is_refused_with_those_that_are():
    with pytest.raises(ValueError, match="known are damadics"):
        get_benchmark("damadic")
