# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A hydraulic rig without a recorded command, from its file of cycles to lag and leakage.

The record is CC BY 4.0 and stands whole in `samples/measured`.
"""

from __future__ import annotations

import gzip
import json
import sys

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.core.aging.series import cut, order_history, series_of
from valve_twin.core.types import Estimate
from valve_twin.io.config.valve import load_config
from valve_twin.io.offline.run import estimate_bag

LEVELS = (100, 90, 80, 73)  # % of the valve's switching: healthy, small, severe lag, near failure
LAG_CHANGES = (12, 23, 33, 43, 53, 74, 84, 94)  # and 2: no piece is cut that is so short
LEAK_CHANGES = (22, 73)


class Rig:
    """The estimates of all cycles beside what was switched."""

    def __init__(self, root, data, folder):
        with gzip.open(data / "fs1_cycles_0_102.txt.gz", "rt", encoding="ascii") as file:
            values = file.read().split()
        (folder / "fs1.csv").write_text("\n".join(["flow", *values, ""]), encoding="ascii")
        profile = np.loadtxt(data / "profile_cycles_0_102.txt").astype(int)
        self.level, self.leakage = profile[:, 1], profile[:, 2]
        config = str(root / "config" / "hydraulic_rig.yaml")
        bag, out = str(folder / "bag"), folder / "estimates.json"
        assert main(["import", str(folder / "fs1.csv"), "--config", config, "--out", bag]) == 0
        assert main(["estimate", bag, "--config", config, "--json", str(out)]) == 0
        self.lines = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
        (self.config,) = load_config(config)
        self.estimates = [
            e
            for event in estimate_bag(self.config, bag)
            if hasattr(event, "estimates")
            for e in event.estimates
            if isinstance(e, Estimate)
        ]

    def values(self, name):
        return np.array([e.value(name) for e in self.estimates])

    def changes(self, name):
        history = order_history(self.estimates, self.config.aging.axis)
        pieces = cut(series_of(history, name), (), self.config.aging)
        return pieces.starts[1:].tolist()


@pytest.fixture(scope="module")
def rig(root, measured, tmp_path_factory):
    return Rig(root, measured / "zema_hydraulic_rig", tmp_path_factory.mktemp("rig"))


def say(line):
    """Show a measured figure; pytest -s or -rP prints it."""
    sys.stdout.write(f"{line}\n")


def right_levels(values, labels):
    """Return how many labels the nearest mean of the other blocks names (leave one block out)."""
    block = np.concatenate(([0], np.cumsum(np.diff(labels) != 0)))
    right = 0
    for one in np.unique(block):
        inside = block == one
        means = {k: values[~inside & (labels == k)].mean() for k in np.unique(labels[~inside])}
        right += sum(
            min(means, key=lambda k: abs(means[k] - v)) == labels[inside][0]
            for v in values[inside]
        )
    return right


def test_every_cycle_of_the_rig_is_estimated(rig):
    assert len(rig.estimates) == len(rig.level) == 103
    assert {e.status.name for e in rig.estimates} == {"ACCEPTED"}
    assert sum(line["kind"] == "estimate" for line in rig.lines) == 103


def test_the_levels_of_the_valve_are_told_from_its_lag(rig):
    lag = rig.values("valve_lag")
    means = [lag[rig.level == level].mean() for level in LEVELS]
    right = right_levels(lag, rig.level)
    say(f"\nrig: {right} of {len(lag)} valve levels right, lag by level [s] {np.round(means, 3)}")
    assert right >= 0.95 * len(lag)
    assert means[0] == pytest.approx(0.0, abs=0.002)
    assert np.diff(means) == pytest.approx([0.03, 0.11, 0.17], abs=0.02)


def test_the_leakage_of_the_pump_is_told_from_the_steady_flow(rig):
    leakage = rig.values("pump_leakage")
    means = [leakage[rig.leakage == level].mean() for level in range(3)]
    spread = max(leakage[rig.leakage == level].std() for level in range(3))
    say(
        f"rig: leakage by level [l/min] {np.round(np.array(means) * 6e4, 3)}, "
        f"scatter {spread * 6e4:.4f}"
    )
    assert np.diff(means).min() > 10.0 * spread


def test_lag_and_leakage_are_independent(rig):
    """At equal level of one, the other does not change by more than a third of its least step."""
    lag, leakage = rig.values("valve_lag"), rig.values("pump_leakage") * 6e4
    for level in (100, 90, 80):
        of = [lag[(rig.level == level) & (rig.leakage == k)] for k in range(3)]
        assert np.ptp([v.mean() for v in of if len(v)]) < 0.025
    for k in range(3):
        of = [leakage[(rig.level == level) & (rig.leakage == k)] for level in LEVELS]
        assert np.ptp([v.mean() for v in of if len(v)]) < 0.04


def test_the_changes_are_found_where_they_were_switched(rig):
    lag, leakage = rig.changes("valve_lag"), rig.changes("pump_leakage")
    say(f"rig: lag changes at {lag}, switched at {LAG_CHANGES}")
    say(f"rig: leakage changes at {leakage}, switched at {LEAK_CHANGES}")
    assert len(lag) == len(LAG_CHANGES)
    assert np.abs(np.array(lag) - LAG_CHANGES).max() <= 1
    for switched in LEAK_CHANGES:
        assert np.abs(np.array(leakage) - switched).min() <= 1
    assert len(leakage) <= len(LEAK_CHANGES) + 3


def test_no_verdict_of_aging_is_given_for_the_rig(rig):
    (verdict,) = [line for line in rig.lines if line["kind"] == "verdict"]
    assert verdict["text"] == "not enough data"
