# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The campaign of faults on the simulated valve: in short, as committed, and in full."""

import json
from dataclasses import replace

import pytest

from valve_twin.core.diagnosis.campaign import run_campaign
from valve_twin.core.diagnosis.isolability import isolability
from valve_twin.io.config.campaign import load_campaign


@pytest.fixture(scope="module")
def campaign(root):
    return load_campaign(root / "config" / "faults_press.yaml")


@pytest.fixture(scope="module")
def committed(root):
    text = (root / "docs" / "campaigns" / "faults.json").read_text(encoding="utf-8")
    return json.loads(text)


def share(rows, size, name):
    chosen = [r for r in rows if r["size"] == size]
    return sum(r[name] for r in chosen) / sum(r["cases"] for r in chosen)


def test_a_short_campaign_finds_and_names_medium_faults(campaign, table):
    config = replace(campaign.config, seeds=(31, 32), sizes=("medium",), after=7, onset=61)
    config = replace(config, cycles=110)
    result = run_campaign(campaign.rig, table, config)
    assert result.alarms == ()
    for row in result.rows:
        assert row.within_5 == row.cases, row
    # 22 cases; 99 % are named right in full
    assert sum(r.in_class for r in result.rows) >= sum(r.cases for r in result.rows) - 1


def test_the_campaign_as_committed_is_the_configured_one(campaign, committed, table):
    config = campaign.config
    assert committed["healthy_cycles"] == config.cycles * len(config.seeds)
    assert list(dict.fromkeys(r["fault"] for r in committed["rows"])) == list(config.severities)
    assert committed["faults"] == list(isolability(table).faults)
    for row in committed["rows"]:
        sizes = config.severities[row["fault"]]
        assert row["severity"] == pytest.approx(
            sizes[("small", "medium", "large").index(row["size"])]
        )
        assert row["cases"] == len(config.seeds)


def test_the_campaign_as_committed_reaches_its_goals(committed):
    assert len(committed["false_alarms"]) <= 1
    for row in committed["rows"]:
        if row["size"] != "small":
            assert row["within_5"] == row["cases"], row
            assert row["in_class"] >= 0.9 * row["cases"], row
    assert share(committed["rows"], "medium", "in_class") >= 0.9


@pytest.mark.slow
def test_the_full_campaign_reaches_its_goals(campaign, table):
    result = run_campaign(campaign.rig, table, campaign.config)
    assert len(result.alarms) <= 1
    told = isolability(table)
    assert result.isolability.classes == told.classes
    for row in result.rows:
        if row.size != "small":
            assert row.within_5 == row.cases, row
            assert row.in_class >= 0.9 * row.cases, row
