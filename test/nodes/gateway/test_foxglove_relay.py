# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the relay passes on; a type of another machine that is not installed here ends nothing."""

from __future__ import annotations

from types import SimpleNamespace

from valve_twin.nodes.gateway.foxglove_relay import DISCOVER_EVERY, FoxgloveRelay

KNOWN = "valve_twin_msgs/msg/Prediction"


class Desk:
    """Reader and face in one: tells what is published and takes what is offered."""

    def __init__(self, published: list[tuple[str, list[str]]]) -> None:
        self.published, self.offered = published, list[str]()
        self.said: list[str] = []

    def get_topic_names_and_types(self):
        return self.published

    def get_logger(self):
        return SimpleNamespace(warning=self.said.append)

    def offer(self, topic: str, type_name: str):
        self.offered.append(topic)
        return SimpleNamespace(has_sinks=lambda: False, close=lambda: None)


def test_a_type_that_is_not_installed_is_told_once_and_the_others_are_passed_on():
    topics = [("/v/plc", ["plant_msgs/msg/Word"]), ("/v/twin/prediction", [KNOWN])]
    desk = Desk([*topics, ("/v/else", [KNOWN])])
    signals = {"a": SimpleNamespace(topic="/v/plc")}
    relay = FoxgloveRelay(desk, desk, {"/v": SimpleNamespace(name="/v", signals=signals)})  # type: ignore[arg-type, dict-item]
    for _ in range(3 * DISCOVER_EVERY):
        relay.look()
    assert desk.offered == ["/v/twin/prediction"]
    text = "/v/plc: not passed on to Foxglove: plant_msgs/msg/Word is not installed here"
    assert desk.said == [text]
