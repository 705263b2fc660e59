# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A recorder killed with SIGKILL loses at most one second."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from test.nodes.recorder_kills import KillingField, kill_many

CAMPAIGN = Path(__file__).resolve().parents[2] / "docs" / "campaigns" / "kills.json"


@pytest.fixture
def field(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    made = KillingField(tmp_path, 1 + os.getpid() % 99)
    yield made
    made.close()


def test_what_is_older_than_a_second_survives_a_kill(field):
    results = kill_many(field, kills=8, at_once=4, seed=1)
    assert min(r.expected for r in results) > 0
    assert [r.missing for r in results] == [0] * 8
    assert max(r.lost_s for r in results) < 1.0


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_thousand_kills_lose_less_than_a_second_each(field):
    kills = int(os.environ.get("VALVE_TWIN_KILLS", "1000"))
    results = kill_many(field, kills=kills, at_once=6, seed=2)
    lost_s = np.array([r.lost_s for r in results])
    figures = {
        "kills": len(results),
        "topics": 3,
        "rate [messages/s]": 600,
        "messages older than 1 s": sum(r.expected for r in results),
        "of these missing": sum(r.missing for r in results),
        "messages read": sum(r.found for r in results),
        "age of the oldest lost message, median [s]": round(float(np.median(lost_s)), 3),
        "age of the oldest lost message, 99 % [s]": round(float(np.quantile(lost_s, 0.99)), 3),
        "age of the oldest lost message, worst [s]": round(float(lost_s.max()), 3),
    }
    CAMPAIGN.parent.mkdir(exist_ok=True)
    CAMPAIGN.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    assert figures["of these missing"] == 0
