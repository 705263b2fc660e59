# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A twin whose history is on a server that is killed: nothing is lost, nothing is there twice."""

from __future__ import annotations

import shutil

from test.io.history.conftest import make_server, postgres  # noqa: F401  fixtures
from test.nodes.conftest import NS
from test.nodes.test_history_trouble import Plant
from test.small_disk import small_disk
from valve_twin.io.history.store import History


class OnServer(Plant):
    """A plant whose twin stores its cycles on a server."""

    def in_database(self) -> list[int]:
        with History(str(self.database), read_only=True) as history:
            assert [e.cycle for e in history.estimates(NS, "output_error")] == [
                c.cycle for c in history.cycles(NS)
            ]
            return [c.cycle for c in history.cycles(NS)]


def test_what_a_killed_server_missed_is_stored_when_both_are_back(graph, postgres, tmp_path):  # noqa: F811
    given = {"history_url": postgres.url, "state_folder": str(tmp_path), "unsaved_limit": 2}
    plant = OnServer(graph, postgres.url, **given)
    plant.feed(2)
    plant.wait_stored([1])
    postgres.kill()
    plant.feed(5)
    assert plant.told(stored=True) == [1]
    files = {p.name for p in tmp_path.glob("history-*/*")}
    assert [f"{n:012d}" for n in range(2, 7)] == sorted(f.rpartition(".")[2] for f in files)
    assert int(plant.figure("cycles dropped unsaved")) == 0
    postgres.start()
    plant.wait_stored([1, 2, 3, 4, 5, 6])  # more than are kept in memory, in order
    assert not list(tmp_path.glob("history-*/*"))

    postgres.kill()
    plant.feed(3)
    plant.twin.kill()
    assert len(list(tmp_path.glob("history-*/*"))) == 3
    postgres.start()
    twin = graph.start("twin", **plant.parameters)
    graph.wait_log(twin, "3 cycles that waited on disk are stored")
    assert plant.in_database() == list(range(1, 10))
    assert not list(tmp_path.glob("history-*/*"))


def test_a_state_folder_that_is_full_or_gone_is_told_once_and_costs_what_memory_cannot_hold(
    graph,
    make_server,  # noqa: F811
    tmp_path,
):
    """A node whose folder could not be made did not start, with a traceback."""
    postgres = make_server()  # noqa: F811
    postgres.initialise()
    postgres.start()
    with small_disk(tmp_path / "disk") as disk:
        disk.fill()
        disk.mount("remount,ro")
        folder = disk.place / "state"
        given = {"history_url": postgres.url, "state_folder": str(folder), "unsaved_limit": 3}
        plant = OnServer(graph, postgres.url, **given)
        plant.feed(2)
        plant.wait_stored([1])
        graph.wait_log(plant.twin, "make the disk writable again; cycles that wait")
        assert plant.twin.log.count("make the disk writable again; cycles that wait") == 1
        disk.mount("remount,rw")
        postgres.kill()
        plant.feed(2)
        graph.wait_log(plant.twin, "No space left on device")
        disk.empty()
        plant.feed(1)
        graph.wait_log(plant.twin, "is written again")
        away = folder.rename(folder.with_name("away"))
        shutil.rmtree(away)  # what is in memory, too, is written anew
        plant.feed(2)
        graph.spin_until(lambda: len(list(folder.glob("history-*/*"))) >= 4, what="the files")
        postgres.start()
        plant.wait_stored([*range(1, 7)])
        assert int(plant.figure("cycles dropped unsaved")) == 0
        assert plant.twin.log.count("for the history are kept in memory") == 2, plant.twin.log
        assert "Traceback" not in plant.twin.log
