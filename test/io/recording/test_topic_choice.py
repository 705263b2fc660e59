# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import pytest

from valve_twin.io.errors import ConfigError
from valve_twin.io.recording.topic_choice import TopicChoice

TOPICS = {
    "/press/v1/spool_position": "a/msg/A",
    "/press/v1/twin/estimate": "b/msg/B",
    "/press/v1/_hidden/x": "a/msg/A",
    "/sim/press/v1/spool_position": "a/msg/A",
    "/press/v10/spool_position": "a/msg/A",
    "/rosout": "r/msg/Log",
}


def chosen(**options) -> set[str]:
    choice = TopicChoice(namespace="/press/v1", **options)
    choice.check()
    return {name for name, kind in TOPICS.items() if choice.takes(name, kind)}


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ({}, {"/press/v1/spool_position", "/press/v1/twin/estimate"}),
        ({"topics": ("/rosout",)}, {"/rosout"}),
        ({"topics": ("/press/v1/_hidden/x",)}, {"/press/v1/_hidden/x"}),
        ({"regex": "v10|estimate$"}, {"/press/v10/spool_position", "/press/v1/twin/estimate"}),
        ({"types": ("b/msg/B",), "topics": ("/rosout",)}, {"/rosout", "/press/v1/twin/estimate"}),
        ({"everything": True}, set(TOPICS) - {"/press/v1/_hidden/x"}),
        ({"everything": True, "hidden": True}, set(TOPICS)),
        (
            {"everything": True, "exclude_regex": "^/press", "exclude_types": ("r/msg/Log",)},
            {"/sim/press/v1/spool_position"},
        ),
        ({"topics": ("/rosout",), "exclude_topics": ("/rosout",)}, set()),
    ],
)
def test_inclusions_add_up_and_exclusions_win(options, wanted):
    sim = {"/sim/press/v1/spool_position"} if not options else set()
    assert chosen(**options) == wanted | sim


@pytest.mark.parametrize(
    ("choice", "name"),
    [(TopicChoice(regex="("), "regex"), (TopicChoice(exclude_regex="("), "exclude_regex")],
)
def test_an_expression_that_is_none_is_named(choice, name):
    with pytest.raises(ConfigError, match=rf"'{name}': '\(' is no regular expression"):
        choice.check()
