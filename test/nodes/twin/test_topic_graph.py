# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When the graph is asked for the publishers of a topic."""

from typing import Any

from valve_twin.nodes.twin.topic_graph import KNOWN_S, SUGGEST_S, TopicGraph


class FakeNode:
    """A graph of one topic; counts how often it is asked for all that it knows."""

    def __init__(self):
        self.names = ["a"]
        self.asked = self.searched = 0

    def count_publishers(self, topic):
        del topic
        return len(self.names)

    def get_publishers_info_by_topic(self, topic):
        del topic
        self.asked += 1
        return list(self.names)

    def get_topic_names_and_types(self):
        self.searched += 1
        return [("/position", ["kind"])]


def test_publishers_are_asked_for_anew_only_where_their_number_changes_or_they_are_old_news():
    node: Any = FakeNode()
    graph: Any = TopicGraph(node, "/topic", "kind")
    told = [graph.publishers(now_s) for now_s in (0.0, 1.0, 2.0)]
    assert (told, node.asked) == ([["a"]] * 3, 1)
    node.names = []
    assert graph.publishers(2.1) == []
    node.names = ["b"]
    assert graph.publishers(2.2) == ["b"]
    node.names = ["c"]
    assert graph.publishers(2.2 + KNOWN_S) == ["c"]


def test_another_name_is_searched_for_now_and_then():
    node: Any = FakeNode()
    graph: Any = TopicGraph(node, "/positon", "kind")
    assert "/position" in graph.suggestion(0.0)
    graph.suggestion(0.5 * SUGGEST_S)
    assert node.searched == 1
    graph.suggestion(SUGGEST_S)
    assert node.searched == 2
