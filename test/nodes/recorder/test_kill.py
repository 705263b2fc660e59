# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A recorder killed with SIGKILL loses at most one second of what it had received.

What was sent and had not reached its middleware is counted beside: after a kill Fast DDS may give
a publisher's messages to the shared memory of the dead, and to the living seconds later.
"""

import itertools
import json
import os
import time
from pathlib import Path

import numpy as np
import pytest
from valve_twin_msgs.msg import Float64Stamped

from test.nodes.conftest import NS, own_domain
from test.nodes.recorder_kills import KillingField, kill_many
from valve_twin.io.bags.read import bag_info
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.offline.recover import recover

CAMPAIGN = Path(__file__).resolve().parents[3] / "docs" / "campaigns" / "kills.json"


@pytest.fixture
def field(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    made = KillingField(tmp_path, own_domain())
    yield made
    made.close()


def test_what_is_older_than_a_second_survives_a_kill(field):
    results, deaf = kill_many(field, kills=8, at_once=4, seed=1)
    assert not deaf
    assert min(r.expected for r in results) > 0
    assert min(r.received for r in results) > 0
    assert [r.received_missing for r in results] == [0] * 8
    assert max(r.received_lost_s for r in results) < 1.0


def spread(name, values):
    """Name the median, 99 % and worst of values in seconds."""
    found = [float(np.quantile(values, q)) for q in (0.5, 0.99, 1.0)]
    names = ("median", "99 %", "worst")
    return {f"{name}, {n} [s]": round(v, 3) for n, v in zip(names, found, strict=True)}


def told(results, deaf):
    """Return the figures of a campaign."""
    return {
        "kills": len(results),
        "further recorders to which the middleware gave nothing in 40 s": len(deaf),
        "topics": 3,
        "rate [messages/s]": 600,
        "load average of 15 minutes": round(os.getloadavg()[2], 1),
        "messages read": sum(r.found for r in results),
        "messages received more than 1 s before the kill": sum(r.received for r in results),
        "of these missing": sum(r.received_missing for r in results),
        **spread(
            "age of the oldest lost message since it was received",
            [r.received_lost_s for r in results],
        ),
        "messages sent more than 1 s before the kill": sum(r.expected for r in results),
        "of these missing or still on their way": sum(r.missing for r in results),
        **spread("age of the oldest lost message since it was sent", [r.lost_s for r in results]),
        **spread(
            "from sent to received",
            np.maximum(np.concatenate([r.delivery_s for r in results]), 0.0),
        ),
        **spread("from received to taken", np.concatenate([r.wait_s for r in results])),
        **spread("loop stood at the kill", [r.stood_s for r in results]),
    }


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_thousand_kills_lose_less_than_a_second_each(field):
    kills = int(os.environ.get("VALVE_TWIN_KILLS", "1000"))
    results, deaf = kill_many(field, kills=kills, at_once=6, seed=2)
    figures = told(results, deaf)
    CAMPAIGN.parent.mkdir(exist_ok=True)
    CAMPAIGN.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    assert figures["of these missing"] == 0
    assert len(deaf) <= kills // 20, deaf[0]


def spans(folder):
    """Return first and last log time of every recording of a name that holds messages [ns]."""
    found = []
    for bag in sorted(folder.iterdir(), key=lambda p: (len(p.name), p.name)):
        recover(bag, folder.parent / f"{bag.name}_recovered")
        info = bag_info(folder.parent / f"{bag.name}_recovered")
        if any(t.count for t in info.topics):
            found.append((info.start_ns, info.end_ns))
    return found


def kill_and_restart(graph, folder, kills, keep):
    """Kill a recorder that is always on, again and again; return the spans of its recordings."""
    rng, topic = np.random.default_rng(3), f"{NS}/spool_position"
    publisher = graph.node.create_publisher(Float64Stamped, topic, 1000)
    for _ in range(kills):
        recorder = graph.start(
            "bag_recorder", bag=str(folder / "on"), keep_files=keep, max_bag_duration=1.0
        )
        graph.spin_until(lambda: f"recording {topic}" in recorder.log, what="the recorder")  # noqa: B023
        end = time.monotonic() + rng.uniform(1.0, 2.0)
        while time.monotonic() < end:
            publisher.publish(encode_stamped(time.time_ns(), 0.5))
            graph.spin(0.02)
        recorder.kill()
        assert len(list(folder.rglob("*.mcap"))) <= keep
    return spans(folder)


def test_a_recorder_that_is_killed_and_started_again_records_on(graph, tmp_path):
    found = kill_and_restart(graph, tmp_path / "bags", kills=3, keep=2)
    assert 1 <= len(found) <= 2


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_recorder_that_is_killed_200_times_is_off_for_seconds(graph, tmp_path):
    """A recorder that was killed before it had written anything makes two gaps into one."""
    kills = int(os.environ.get("VALVE_TWIN_KILLS", "200"))
    found = kill_and_restart(graph, tmp_path / "bags", kills, keep=kills)
    gaps = [1e-9 * (b[0] - a[1]) for a, b in itertools.pairwise(found)]
    assert len(found) > kills // 4
    assert max(gaps) < 10.0
    assert np.median(gaps) < 3.0, f"{len(found)} recordings, gaps {np.round(gaps, 2)} s"
