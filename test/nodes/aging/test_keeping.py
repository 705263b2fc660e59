# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A monitor that starts again asks only for what is new, and says what one says that knows all."""

from __future__ import annotations

import errno
import os
import shutil
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from test.nodes.aging import test_estimate_buffer
from test.nodes.aging.test_estimate_buffer import CYCLES, STORED, VALVE, Twin
from test.nodes.aging.test_node import aging_valve
from test.nodes.conftest import NS
from test.small_disk import small_disk
from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.past.columns import past_of
from valve_twin.core.types import Maintenance
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import StoreError
from valve_twin.io.history.aging.file import write
from valve_twin.nodes.aging import keeping, monitored_valve
from valve_twin.nodes.aging.node import AgingMonitorNode

AGAIN = 5


class Asked(Twin):
    """A twin that remembers which first cycles it was asked for."""

    def __init__(self, graph) -> None:
        self.asked: list[int] = []
        super().__init__(graph)

    def answer(self, request, response):
        self.asked.append(request.first_cycle)
        return super().answer(request, response)


@pytest.fixture
def twin(graph, monkeypatch):
    monkeypatch.setattr(keeping, "WORTH", 5)
    monkeypatch.setattr(monitored_valve, "AGAIN", AGAIN)
    return Asked(graph)


def start(graph, folder, known=STORED):
    """Start a monitor and wait until it has said its first verdict."""
    node = graph.host(AgingMonitorNode, retry_s=0.2, state_folder=str(folder))
    (valve,) = node._valves
    graph.spin_until(lambda: valve.assessment and valve.cycles == known, what="the history")
    return node, valve


def stop(graph, node, folder):
    """Let a monitor end as by a signal; what it knows is then kept."""
    node.trigger_deactivate()
    graph.spin_until(lambda: list(folder.glob("aging*")), what="the file")
    node.trigger_cleanup()


def said(assessment):
    return repr((assessment.trends, assessment.verdict))


def expected(twin):
    found = assess(
        past_of(twin.history),
        twin.events,
        AgingConfig(),
        parameters=get_model("press_cartridge").parameters,
        valve=NS,
    )
    return said(found)


def test_it_asks_for_what_is_new_and_for_the_newest_it_knows(graph, twin, tmp_path):
    node, _ = start(graph, tmp_path)
    stop(graph, node, tmp_path)
    twin.history = list(VALVE)
    twin.asked.clear()
    _, valve = start(graph, tmp_path, CYCLES)
    assert twin.asked[0] == STORED - AGAIN + 1
    assert min(twin.asked) == STORED - AGAIN + 1
    assert said(valve.assessment) == expected(twin)


def test_it_speaks_though_nothing_is_new(graph, twin, tmp_path):
    node, _ = start(graph, tmp_path)
    stop(graph, node, tmp_path)
    _, valve = start(graph, tmp_path)
    assert said(valve.assessment) == expected(twin)


def test_another_history_is_asked_for_as_a_whole(graph, twin, tmp_path):
    node, _ = start(graph, tmp_path)
    stop(graph, node, tmp_path)
    twin.history = [replace(e, end_ns=e.end_ns + 1) for e in VALVE[:STORED]]
    twin.asked.clear()
    _, valve = start(graph, tmp_path)
    graph.spin_until(lambda: 1 in twin.asked, what="a request for all")
    graph.spin_until(lambda: said(valve.assessment) == expected(twin), what="the verdict")


def test_a_cycle_that_was_stored_late_meanwhile_is_noticed(graph, twin, tmp_path):
    late = twin.history.pop(STORED - 3)
    node, _ = start(graph, tmp_path, STORED - 1)
    stop(graph, node, tmp_path)
    twin.history.insert(STORED - 3, late)
    twin.asked.clear()
    _, valve = start(graph, tmp_path)
    assert 1 in twin.asked
    graph.spin_until(lambda: said(valve.assessment) == expected(twin), what="the verdict")


def test_maintenance_marked_meanwhile_for_a_known_cycle_begins_anew(graph, twin, tmp_path):
    node, _ = start(graph, tmp_path)
    stop(graph, node, tmp_path)
    twin.events = [Maintenance(stamp_ns=VALVE[4].start_ns, cycle=5, note="x", new_reference=True)]
    twin.asked.clear()
    _, valve = start(graph, tmp_path)
    graph.spin_until(lambda: 1 in twin.asked, what="a request for all")
    graph.spin_until(lambda: said(valve.assessment) == expected(twin), what="the verdict")


def test_a_damaged_file_is_told_and_not_used(graph, twin, tmp_path):
    node, _ = start(graph, tmp_path)
    stop(graph, node, tmp_path)
    (file,) = tmp_path.glob("aging*")
    file.write_bytes(file.read_bytes()[:-1])
    twin.asked.clear()
    _, valve = start(graph, tmp_path)
    assert min(twin.asked) == 1
    assert said(valve.assessment) == expected(twin)


def test_a_folder_that_somebody_removed_is_made_anew(graph, twin, tmp_path):
    folder = tmp_path / "state"
    node, _ = start(graph, folder)
    shutil.rmtree(folder)
    stop(graph, node, folder)
    twin.asked.clear()
    start(graph, folder)
    assert 1 not in twin.asked


def test_a_folder_that_cannot_be_made_at_the_start_keeps_nobody_from_starting(
    graph, twin, tmp_path, capfd
):
    """The monitor stayed unconfigured for good; what is kept saves asking and decides nothing."""
    folder = tmp_path / "state"
    folder.write_text("in the way of a folder")
    node, valve = start(graph, folder)
    assert said(valve.assessment) == expected(twin)
    node.trigger_deactivate()
    graph.spin(0.3)  # it tries to write what is known
    node.trigger_activate()
    graph.spin_until(lambda: valve._caught_up, what="the newest")
    told = capfd.readouterr().err
    assert (
        told.count(f"state_folder {folder}: cannot be written: File exists: check the folder") == 1
    )
    assert told.count("[WARN]") == 1
    folder.unlink()
    node.trigger_deactivate()
    graph.spin_until(lambda: "what is known is kept again" in capfd.readouterr().err, what="it")
    assert list(folder.glob("aging*"))


def _is_assessed(valve, cycles):
    """Return whether so many cycles are assessed: what was to be written before them is over."""
    return valve.cycles == cycles and not valve._busy


def test_a_full_disk_over_hundreds_of_estimates_is_told_once_and_tried_every_ten(
    graph, monkeypatch, tmp_path, capfd
):
    monkeypatch.setattr(keeping, "WORTH", 5)
    cycles, tries = 260, list[object]()
    estimates = [replace(e, missed_cycles=0) for e in aging_valve(cycles + 20)]
    monkeypatch.setattr(test_estimate_buffer, "VALVE", estimates)

    def counted(path, content) -> None:
        tries.append(path)
        write(path, content)

    monkeypatch.setattr(keeping, "write", counted)
    twin = Twin(graph)
    with small_disk(tmp_path / "disk", "1m") as disk:
        disk.fill()
        node = graph.host(AgingMonitorNode, retry_s=0.2, state_folder=str(disk.place / "state"))
        (valve,) = node._valves
        graph.spin_until(lambda: valve.assessment and valve.cycles == STORED, what="the history")
        for number in range(STORED + 1, cycles + 1):
            twin.publish_cycle(number)
            graph.spin_until(lambda of=number: _is_assessed(valve, of), what="a cycle")
        said = capfd.readouterr().err
        assert said.count("cannot be written: No space left on device: free some space") == 1
        assert 1 < len(tries) <= (cycles - keeping.EVERY) // keeping.AGAIN + 1
        disk.empty()
        for number in range(cycles + 1, cycles + 20):
            twin.publish_cycle(number)
            graph.spin_until(lambda of=number: _is_assessed(valve, of), what="a cycle")
        graph.spin_until(lambda: list(disk.place.glob("state/aging*")), what="the file")
        graph.spin_until(lambda: not valve._busy, what="the last work")
        assert "what is known is kept again" in capfd.readouterr().err
        node.trigger_deactivate()


def test_what_could_not_be_written_is_tried_again_soon_and_at_the_end(tmp_path, monkeypatch, root):
    """It was not tried at the end, and before that only after 200 estimates more."""
    room = False

    def write(path, content) -> None:
        if not room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        path.write_bytes(content)

    monkeypatch.setattr(keeping, "WORTH", 1)
    monkeypatch.setattr(keeping, "write", write)
    monkeypatch.setattr(keeping, "freeze", lambda state: state)
    monkeypatch.setattr(keeping, "pack", lambda *_: b"known")
    (config,) = load_config(root / "config" / "first_order.yaml")
    keeper = keeping.Keeper(str(tmp_path), config)
    buffer: Any = SimpleNamespace(counts={"a": keeping.EVERY}, state=None, place=dict)
    assert keeper.due(buffer)
    with pytest.raises(StoreError, match="cannot be written: No space left on device: free"):
        keeper.saving(buffer, Memory())()
    keeper.done(failed=True)
    assert not keeper.due(buffer)
    assert keeper.due(buffer, ends=True)
    buffer.counts["a"] += keeping.AGAIN
    assert keeper.due(buffer)
    room = True
    keeper.saving(buffer, Memory())()
    keeper.done(failed=False)
    assert not keeper.due(buffer, ends=True)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"known"]
