# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a publisher does to a recorder that listens to it from another process."""

import time

import pytest

from test.nodes.conftest import NS
from test.nodes.feeding import Feeder
from valve_twin.io.bags.read import bag_info


@pytest.mark.slow
def test_a_message_of_0_bytes_costs_what_is_sent_in_half_a_second(graph, tmp_path):
    recorder = graph.start("bag_recorder", bag=str(tmp_path / "bag"))
    feeder = Feeder(graph, NS)
    graph.be_heard(f"{NS}/bag_recorder")
    end = time.monotonic() + 14.0
    bad = 0
    while time.monotonic() < end:
        feeder.feed(1)
        graph.spin(0.02)
        if feeder.sent == 50:
            feeder.publishers[2].publish(b"")
            bad += 1
    graph.spin(1.0)
    recorder.end()
    counts = {t.name: t.count for t in bag_info(tmp_path / "bag").topics}
    assert bad == 1
    assert counts[f"{NS}/command/v_in"] == feeder.sent
    assert counts[f"{NS}/spool_position"] > feeder.sent - 40
    assert recorder.log.count("a message of 0 bytes") == 1
