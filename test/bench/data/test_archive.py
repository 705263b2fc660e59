# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The archive benchmark compares equal cycles with equal costs, or refuses."""

from __future__ import annotations

import dataclasses

import pytest

from valve_twin.bench.data import archive
from valve_twin.io.config.valve import parse_config


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Return a record of three cycles as both ways fit it."""
    path = tmp_path_factory.mktemp("archive") / "bag"
    archive.write_record(path, 3)
    (config,) = parse_config(archive.CONFIG, "test", namespace="/press")
    return archive.estimate_by_us(config, path), archive.estimate_by_rosbags(path), path


def test_both_ways_cut_and_fit_the_same_cycles(both):
    ours, theirs, path = both
    assert len(ours) == len(theirs) == 3
    archive._require_equal_cycles(ours, theirs, path)


def test_no_ratio_is_given_of_other_costs_or_cycles(both):
    ours, theirs, path = both
    dearer = [*theirs[:2], dataclasses.replace(theirs[2], cost=1.00001 * theirs[2].cost)]
    with pytest.raises(AssertionError, match="the costs of the cycle at"):
        archive._require_equal_cycles(ours, dearer, path)
    with pytest.raises(AssertionError, match="the cycles differ"):
        archive._require_equal_cycles(ours[:2], theirs, path)


def test_the_trend_is_compared_with_gains_of_scipy_that_are_alike(both):
    _, _, path = both
    (config,) = parse_config(archive.TRENDED, "test", namespace="/press")
    found = archive.estimate_by_us(config, path)
    assert archive._trend_by_rosbags(path, found) > 0.0
    wrong = [
        dataclasses.replace(e, parameters=tuple(
            dataclasses.replace(p, value=2.0 * p.value) if p.name == "K_out" else p
            for p in e.parameters
        ))
        for e in found
    ]  # fmt: skip
    with pytest.raises(AssertionError, match="the gains of the cycle at"):
        archive._trend_by_rosbags(path, wrong)
