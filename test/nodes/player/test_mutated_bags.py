# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Mutated bags through the player's process: each ends, with all that was played or with a word.

The mutations are those of the fuzzer of files; what is heard is compared with the sound bag.
"""

from __future__ import annotations

import time
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
from valve_twin_msgs.msg import Float64Stamped

from test.io.foreign import START_NS, bag, metadata, mutations
from valve_twin.nodes.runtime.stamps import from_time

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

TOPICS = ("/press/position", "/press/command")
LONGEST_S = 120.0
"""A player that has not ended by then hangs; it has nothing to wait for but us [s]."""

QUIET, QUIET_AFTER_AN_ERROR = 100, 15
"""So many turns of the executor without a message say that none is left; a turn waits for one for
20 ms, however long this process had no core [1]."""


class Desk:
    """Starts players one after another and hears what they play."""

    def __init__(self, graph) -> None:
        self._graph = graph
        self.heard: Counter[tuple[str, int, float]] = Counter()
        for topic in TOPICS:
            self._listen(topic)

    def _listen(self, topic: str) -> None:
        def take(message: Float64Stamped) -> None:
            self.heard[topic, from_time(message.header.stamp), message.value] += 1

        self._graph.node.create_subscription(Float64Stamped, f"/replay{topic}", take, 1000)

    def played(
        self, path: Path, wanted: Counter[tuple[str, int, float]]
    ) -> tuple[int | None, str]:
        """Play a bag to its end; return exit code, None of one that hung, and what was said."""
        self.heard.clear()
        given = {"bag": str(path), "rate": 0.0, "exit_at_end": True, "wait_for_subscribers": 1}
        player = self._graph.start("bag_player", **given)
        begun = time.monotonic()
        while player.process.poll() is None and time.monotonic() < begun + LONGEST_S:
            self._graph.executor.spin_once(timeout_sec=0.02)
        code = player.process.poll()
        player.kill()
        self._graph.processes.remove(player)
        quiet = last = 0
        while self.heard != wanted and quiet < (QUIET if code == 0 else QUIET_AFTER_AN_ERROR):
            self._graph.executor.spin_once(timeout_sec=0.02)  # the last ones wait in memory
            quiet = quiet + 1 if self.heard.total() == last else 0
            last = self.heard.total()
        return code, player.log


def cases(folder: Path, seed: int, count: int) -> Iterator[tuple[str, Path, bytes]]:
    """Yield mutated bags: the file alone, and one in its folder whose metadata is mutated."""
    rng = np.random.default_rng(seed)
    file = bag(folder)
    yield "sound", folder / file.name, file.data
    for how, data in mutations(file.data, rng, count):
        yield how, folder / file.name, data
    described = metadata(folder)
    for how, data in mutations(described.data, rng, count // 4):
        yield f"metadata, {how}", folder / described.name, data


def sound_values(how: str) -> Counter[tuple[str, int, float]]:
    count, topics = (5, TOPICS[:1]) if how.startswith("metadata") else (60, TOPICS)
    return Counter(
        (topic, START_NS + i * 10_000_000, sign * i)
        for topic, sign in zip(topics, (0.25, -0.5), strict=False)
        for i in range(count)
    )


def hold(graph, folder: Path, seed: int, count: int) -> None:
    """Play mutated bags; nothing may end in a trace, hang, or be missing without a word."""
    desk, wrong, quiet = Desk(graph), list[str](), ""
    for n, (how, path, data) in enumerate(cases(folder, seed, count)):
        path.write_bytes(data)
        where = path.parent if path.name == "metadata.yaml" else path
        wanted = sound_values(how)
        code, said = desk.played(where, wanted)
        case = f"seed {seed} case {n} ({how}): exit {code}: {said}"
        if how == "sound":
            assert (code, desk.heard) == (0, wanted), case
            quiet = said
        told = str(where) in said.replace(quiet, "") and ("WARN" in said or "ERROR" in said)
        whole = desk.heard == wanted and code == 0
        if code not in (0, 1) or "Traceback" in said or not (whole or told):
            wrong.append(case)
    assert not wrong, "\n".join(wrong)


def test_a_mutated_bag_is_played_whole_or_named(graph, tmp_path):
    hold(graph, tmp_path, 5, 4)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("part", range(3))
def test_each_of_three_hundred_is(graph, tmp_path, part):
    hold(graph, tmp_path, 300 + part, 80)
