# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""First cycles with and without a reference of sisters: what was published, what makes none."""

import json

import pytest

from valve_twin.cli.strangers import setup_of
from valve_twin.validation.strangers import early
from valve_twin.validation.strangers.sisters import family


def test_sisters_without_features_make_no_reference(monkeypatch):
    monkeypatch.setattr(early, "estimated", lambda stranger, setup: [()] * stranger.cycles)
    found = early.judge(family(73000, 2), setup_of(None))
    assert found.refused == "no sister has features"
    assert found.score.shares == {"sisters make a reference": [0, 1]}


def test_a_campaign_with_references_runs_and_counts_each_press(monkeypatch):
    monkeypatch.setattr(early, "family", lambda seed, sisters: seed)
    monkeypatch.setattr(early, "judge", lambda presses, setup: presses)
    told = []
    met = early.meet_families([3, 5], setup_of(None), sisters=2, advance=lambda: told.append(1))
    assert len(list(met)) == 2
    assert told == [1, 1]


@pytest.mark.parametrize("sisters", ["three sisters", "eight sisters"])
def test_the_table_is_of_the_frozen_seeds_and_no_worse_than_without(root, sisters):
    path = root / "docs" / "campaigns" / "strangers_reference.json"
    whole = json.loads(path.read_text(encoding="utf-8"))
    base, count = early.REFERENCE_BASE, early.REFERENCE_COUNT
    assert whole["seeds"] == [base, base + count - 1]
    shares = whole[sisters]["shares"]
    for size in ("medium", "large"):
        for since in ("1", "2-8"):
            told, cases = shares[f"with: {size} from {since}, told at 15"]
            without, same = shares[f"without: {size} from {since}, told at 15"]
            assert (cases, told > without) == (same, True)
            before = whole[sisters]["before"][f"with: {size} from {since}, told at 15"]
            assert told >= before[0]
