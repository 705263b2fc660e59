# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A twin condenses the old cycles of its histories by itself, and stores meanwhile."""

import pytest
from valve_twin_msgs.msg import Estimate

from test.io.history.tiers.test_condense import store
from test.nodes.conftest import NS
from test.nodes.feeding import REARM, Feeder
from valve_twin.core.aging.config import AgingConfig
from valve_twin.io.config.node_parameters import TwinParameters
from valve_twin.io.errors import ConfigError, StoreError
from valve_twin.io.history.aging import WORTH
from valve_twin.io.history.aging.file import load, origin_of
from valve_twin.io.history.fleet import describe_valve
from valve_twin.io.history.store import History
from valve_twin.io.history.tiers import condense as tiers
from valve_twin.io.history.tiers.condense import LEAST, condense
from valve_twin.io.history.tiers.extent import condensed, condensed_until
from valve_twin.io.history.tiers.retention import Retention
from valve_twin.nodes.twin.history import upkeep as module
from valve_twin.nodes.twin.history.upkeep import Upkeep, keep_up, retention_of
from valve_twin.nodes.twin.node import TwinNode

KEPT = Retention(cycles=1)

CYCLES = LEAST + 600
"""Of 144 a day: four whole days are older than the thousand that are always kept."""


@pytest.fixture
def database(tmp_path):
    path = tmp_path / "history.sqlite"
    with History(path) as history:
        store(history, CYCLES, valve=NS)
    return path


def upkeep(database, *valves, aging=None, rule=KEPT):
    return Upkeep(f"sqlite:///{database}", valves, (aging,) * len(valves), rule, 5.0)


def test_nothing_is_let_go_of_unless_it_is_asked_for():
    assert retention_of(TwinParameters()) is None
    given = TwinParameters(keep_days=30.0, keep_hours_for_days=7.0)
    assert retention_of(given) == Retention(0, 30.0, 7.0)
    assert retention_of(TwinParameters(keep_cycles=5000)) == Retention(5000, 0.0, 90.0)


def test_parameters_that_do_not_go_together_are_told_by_their_names():
    with pytest.raises(ConfigError, match="keep_cycles, keep_days"):
        retention_of(TwinParameters(keep_days=-1.0))


def test_each_valve_of_which_something_was_condensed_gives_a_line_once(database):
    def ask():
        return keep_up(upkeep(database, NS, "/young"))

    (line,) = ask()
    assert line.startswith(f"{NS}: cycles 1 to 575 are condensed to hours and days")
    assert ask() == []


def test_a_valve_that_cannot_be_condensed_is_told_and_the_others_go_on(database, monkeypatch):
    with History(database) as history:
        store(history, CYCLES, valve="/other")
        until = condensed_until(history, NS)

    why = "is locked"

    def refuse(history, valve, rule):
        if valve == "/other":
            raise StoreError(why)
        return condense(history, valve, rule)

    monkeypatch.setattr(tiers, "condense", refuse)
    first, second = keep_up(upkeep(database, "/other", NS))
    assert first == "/other: its history is not kept up: is locked"
    assert "are condensed" in second
    with History(database, read_only=True) as history:
        assert until == condensed_until(history, "/other") == 0
        assert condensed_until(history, NS) == 575


def test_a_twin_condenses_by_itself_and_stores_meanwhile(graph, database, monkeypatch, capfd):
    monkeypatch.setattr(module, "FIRST_S", 0.2)
    with History(database, read_only=True) as history:
        before = describe_valve(history, NS, AgingConfig())
    estimates = graph.record(f"{NS}/twin/estimate", Estimate)
    url = f"sqlite:///{database}"
    node = graph.host(TwinNode, history_url=url, keep_cycles=1, **REARM)
    keeper = node._keeper
    with History(database, read_only=True) as history:
        graph.spin_until(lambda: condensed(history, NS), 240.0, "condensed cycles")
        assert describe_valve(history, NS, AgingConfig()).trends == before.trends
        feeder = Feeder(graph, NS)
        for _ in range(4):
            feeder.feed(feeder.cycle_samples)
            graph.spin(0.05)
        graph.spin_until(
            lambda: any(e.stored and e.cycle > CYCLES for e in estimates), 120.0, "a cycle"
        )
        graph.spin_until(lambda: keeper._worker is None, 120.0, "the end of the process")
        assert condensed_until(history, NS) == 575
        assert history.last_cycle(NS) > CYCLES
    assert "cycles 1 to 575 are condensed" in capfd.readouterr().err


def test_a_twin_that_is_told_nothing_keeps_all(graph, database, monkeypatch):
    monkeypatch.setattr(module, "FIRST_S", 0.0)
    node = graph.host(TwinNode, history_url=f"sqlite:///{database}", **REARM)
    timer = node._keeper._timer
    graph.spin_until(lambda: node._keeper._timer not in (None, timer), 30.0, "another day")
    assert node._keeper._worker is None  # nothing to do, no process
    with History(database, read_only=True) as history:
        assert condensed_until(history, NS) == 0


def test_a_long_history_is_read_so_that_who_asks_next_reads_little(graph, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "FIRST_S", 0.2)
    database, aging = tmp_path / "history.sqlite", AgingConfig()
    with History(database) as history:
        store(history, WORTH + 200, valve=NS)
        kept = history.snapshot_path(NS, "aging")
    assert kept is not None
    node = graph.host(TwinNode, history_url=f"sqlite:///{database}", **REARM)
    graph.spin_until(kept.exists, 120.0, "what was read")
    graph.spin_until(lambda: node._keeper._worker is None, 120.0, "the end of the process")
    with History(database, read_only=True) as history:
        assert condensed_until(history, NS) == 0  # no rule, so nothing is let go of
        known = load(kept, origin_of(NS, "press_cartridge"), aging)
        assert known is not None
        assert known.place["at"][0] == WORTH + 200
        said = describe_valve(history, NS, aging)
        kept.unlink()
        assert repr(describe_valve(history, NS, aging)) == repr(said)
