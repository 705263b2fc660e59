# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A twin whose history is on a server that is killed: nothing is lost, nothing is there twice."""

from __future__ import annotations

from test.io.history.conftest import make_server, postgres  # noqa: F401  fixtures
from test.nodes.conftest import NS
from test.nodes.test_history_trouble import Plant
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
    graph.spin_until(lambda: "3 cycles that waited on disk are stored" in twin.log, 120.0, "word")
    assert plant.in_database() == list(range(1, 10))
    assert not list(tmp_path.glob("history-*/*"))
