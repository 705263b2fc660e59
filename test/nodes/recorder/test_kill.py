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
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from valve_twin_msgs.msg import Float64Stamped

from test.nodes.conftest import NS, own_domain
from test.nodes.recorder_kills import KillingField, kill_many
from valve_twin.io.bags.read import bag_info, read_columns
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.io.offline.recover import recover

BASE_NS = 10**18
RESTARTS = Path(__file__).resolve().parents[3] / "docs" / "campaigns" / "restarts.json"
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


@dataclass
class AlwaysOn:
    """What a recorder that was killed and started again and again left.

    Attributes
    ----------
    starts_s : list of float
        From each start until the recorder said that it records [s].
    sent, found : int
        Messages that were sent, and that the recordings hold.
    spans_ns : list of (int, int)
        First and last log time of every recording that holds messages [ns].
    files : int
        Most files that stood there at a time.
    """

    starts_s: list[float]
    sent: int
    found: int
    spans_ns: list[tuple[int, int]]
    files: int

    @property
    def gaps_s(self) -> list[float]:
        """From the end of a recording until the begin of the next [s]."""
        return [1e-9 * (b[0] - a[1]) for a, b in itertools.pairwise(self.spans_ns)]


def kill_and_restart(graph, folder, kills, keep):
    """Kill a recorder that is always on at random times, while somebody sends all the time."""
    rng, topic = np.random.default_rng(3), f"{NS}/spool_position"
    publisher = graph.node.create_publisher(Float64Stamped, topic, 1000)
    sent, files, starts_s = 0, 0, []

    def send(until):
        nonlocal sent
        while not until():
            publisher.publish(encode_stamped(BASE_NS + sent, 0.5))
            sent += 1
            graph.spin(0.02)

    for _ in range(kills):
        begin = time.monotonic()
        recorder = graph.start(
            "bag_recorder", bag=str(folder / "on"), keep_files=keep, max_bag_duration=1.0
        )
        send(lambda: f"recording {topic}" in recorder.log or time.monotonic() > begin + 120.0)  # noqa: B023
        starts_s.append(time.monotonic() - begin)
        end = time.monotonic() + rng.uniform(1.0, 2.0)
        send(lambda: time.monotonic() >= end)  # noqa: B023
        recorder.kill()
        files = max(files, len(list(folder.rglob("*.mcap"))))
    stamps, spans = [], []
    for bag in sorted(folder.iterdir(), key=lambda p: (len(p.name), p.name)):
        if not any(bag.glob("*.mcap")):
            continue  # killed before it had a message: a busy machine gave it no core
        whole = folder.parent / f"{bag.name}_recovered"
        recover(bag, whole)
        info = bag_info(whole)
        if any(t.name == topic and t.count for t in info.topics):
            (column,) = read_columns(whole, [SignalSource("x", topic)])
            stamps += column.stamp_ns.tolist()
            spans.append((info.start_ns, info.end_ns))
    assert len(stamps) == len(set(stamps)), "a message is there twice"
    return AlwaysOn(starts_s, sent, len(stamps), spans, files)


def test_a_recorder_that_is_killed_and_started_again_records_on(graph, tmp_path):
    found = kill_and_restart(graph, tmp_path / "bags", kills=3, keep=2)
    assert found.files <= 2
    assert 1 <= len(found.spans_ns) <= 2


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_recorder_that_is_killed_200_times_is_off_for_seconds(graph, tmp_path):
    """The start of Python is in the gap: it is 3 s at most where a start takes 2 s."""
    kills = int(os.environ.get("VALVE_TWIN_KILLS", "200"))
    load = os.getloadavg()[2]
    found = kill_and_restart(graph, tmp_path / "bags", kills, keep=5 * kills)
    figures = {
        "kills": kills,
        "recordings that hold messages": len(found.spans_ns),
        "messages sent": found.sent,
        "of these recorded": found.found,
        **spread("from a start until it says that it records", found.starts_s),
        **spread("gap between two recordings", found.gaps_s),
        "load average of 15 minutes": round(load, 1),
    }
    RESTARTS.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    assert len(found.spans_ns) == kills
    late_s = np.array(found.gaps_s) - np.array(found.starts_s[1:])
    assert np.quantile(late_s, 0.99) < 1.0
