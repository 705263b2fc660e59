# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Storing, services and the worker of the twin node."""

import os
import signal
import sqlite3
import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from valve_twin_msgs.msg import CycleSummary, Estimate, Maintenance, Prediction
from valve_twin_msgs.srv import (
    BackupHistory,
    EstimateNow,
    GetErrorBudget,
    GetHistory,
    MarkMaintenance,
    WithdrawMaintenance,
)

from test.nodes.conftest import NS
from test.nodes.feeding import REARM, Feeder
from valve_twin.core.types import Prediction as PredictionValue
from valve_twin.io.history import spool as spool_module
from valve_twin.io.history.snapshot import save_cycle
from valve_twin.io.history.store import History
from valve_twin.nodes.runtime.messages import prediction_bytes
from valve_twin.nodes.twin import node as node_module
from valve_twin.nodes.twin.node import TwinNode
from valve_twin.nodes.twin.services import EVENTS

TREND_ESTIMATOR = "output_error"


@pytest.fixture
def database(tmp_path):
    return tmp_path / "history.sqlite"


@pytest.fixture
def twin(graph, database):
    parameters = {"history_url": f"sqlite:///{database}", "busy_timeout_s": 0.05, "retry_s": 0.1}
    return graph.host(TwinNode, **parameters, **REARM)


@pytest.fixture
def estimates(graph):
    return graph.record(f"{NS}/twin/estimate", Estimate)


def cycles_of(estimates):
    return [m.cycle for m in estimates if m.estimator == TREND_ESTIMATOR]


def feed_cycles(graph, feeder, estimates, count):
    """Feed whole cycles and wait until the last one that is complete has been estimated."""
    for _ in range(count):
        feeder.feed(feeder.cycle_samples)
        graph.spin(0.01)
    done = feeder.sent // feeder.cycle_samples - 1
    graph.spin_until(lambda: len(cycles_of(estimates)) >= done, 120.0, f"{done} estimates")


def test_a_locked_database_delays_storing_and_loses_nothing(
    graph, database, twin, estimates, capfd
):
    feeder = Feeder(graph, NS)
    feed_cycles(graph, feeder, estimates, 2)
    assert all(m.stored for m in estimates)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    lock = sqlite3.connect(database, isolation_level=None)
    lock.execute("BEGIN EXCLUSIVE")
    feed_cycles(graph, feeder, estimates, 2)
    late = [m for m in estimates if m.cycle >= 2]
    assert late
    assert not any(m.stored for m in late)
    said = capfd.readouterr().err
    assert str(database) in said
    assert "not stored, kept and tried again" in said
    graph.spin_until(
        lambda: diagnostics and diagnostics[-1].status[0].level == DiagnosticStatus.ERROR,
        what="an error in the diagnostics",
    )
    assert "wait for the database" in diagnostics[-1].status[0].message
    lock.execute("ROLLBACK")
    lock.close()
    graph.spin_until(lambda: "all cycles are stored again" in capfd.readouterr().err, 120.0)
    with History(f"sqlite:///{database}", read_only=True) as history:
        assert [c.cycle for c in history.cycles(NS)] == [1, 2, 3]


def test_an_estimation_whose_process_is_killed_is_repeated(graph, twin, estimates):
    feeder = Feeder(graph, NS)
    feed_cycles(graph, feeder, estimates, 2)
    os.kill(twin._worker.pid, signal.SIGKILL)
    feed_cycles(graph, feeder, estimates, 2)
    assert cycles_of(estimates) == [1, 2, 3]
    assert twin._worker.restarts == 1


def test_cycles_beyond_the_budget_wait_on_disk_and_give_the_same_estimates(graph, tmp_path):
    names, found, spools = ("/press/a", "/press/b"), [], []
    for name, budget_mb in zip(names, (400.0, 0.01), strict=True):
        found.append(graph.record(f"{name}/twin/estimate", Estimate))
        url = f"sqlite:///{tmp_path}/{name[-1]}.sqlite"
        node = graph.host(TwinNode, ns=name, history_url=url, memory_budget_mb=budget_mb, **REARM)
        spools.append(node._valves[0].spool)
    feeders = [Feeder(graph, name) for name in names]
    for _ in range(4):
        for feeder in feeders:
            feeder.feed(feeder.cycle_samples)
    graph.spin_until(lambda: all(len(cycles_of(f)) >= 3 for f in found), what="the estimates")
    assert [spool.written > 0 for spool in spools] == [False, True]
    assert spools[0].spooled == spools[1].spooled == spools[1].dropped == 0
    values = [{(m.cycle, m.estimator): repr(m.values) for m in f} for f in found]
    assert values[0] == values[1]
    assert not list(tmp_path.rglob("*.cycle"))


@pytest.mark.parametrize("budget_mb", [0.01, 0.4])
def test_cycles_on_disk_at_a_stop_are_estimated_after_the_restart(
    graph, tmp_path, capfd, monkeypatch, budget_mb
):
    """With the larger budget the stop has some to put there, at the pace of a slow disk."""
    url = f"sqlite:///{tmp_path}/h.sqlite"
    given = {"history_url": url, "memory_budget_mb": budget_mb, **REARM}
    node = graph.host(TwinNode, **given)
    feeder = Feeder(graph, NS)
    graph.spin_until(lambda: node._worker.pid, what="the estimating process")
    os.kill(node._worker.pid, signal.SIGSTOP)  # it is slower than the data
    feeder.feed(6 * feeder.cycle_samples)
    spool = node._valves[0].spool
    on_disk = 4 if budget_mb < 0.1 else 1
    graph.spin_until(lambda: spool.spooled >= on_disk, what="cycles on disk")
    if spool.held:

        def save_slowly(*arguments):
            time.sleep(node_module.FLUSH_S)
            save_cycle(*arguments)

        monkeypatch.setattr(spool_module, "save_cycle", save_slowly)
        monkeypatch.setattr(node_module, "KEPT_B_S", 5e3)  # 22 s a cycle: nor is this one fast
    else:
        monkeypatch.setattr(node_module, "FLUSH_S", 60.0)  # however slow this disk is
    assert bool(spool.held) == (budget_mb > 0.1)
    node.stop()
    monkeypatch.undo()
    assert len(list(tmp_path.rglob("*.cycle"))) >= 4
    graph.executor.remove_node(node)
    graph.hosted.remove(node)
    node.destroy_node()
    capfd.readouterr()
    found = graph.record(f"{NS}/twin/estimate", Estimate)
    again = graph.host(TwinNode, **given)
    feeder.restart()
    feeder.feed(2 * feeder.cycle_samples)
    graph.spin_until(lambda: len(cycles_of(found)) >= 5, what="the estimates of what waited")
    assert cycles_of(found)[:5] == [1, 2, 3, 4, 5]
    assert "were not estimated" not in capfd.readouterr().err
    assert again._valves[0].spool.dropped == 0


def test_estimate_now_closes_the_running_cycle(graph, twin, estimates):
    feeder = Feeder(graph, NS)
    predictions = graph.record(f"{NS}/twin/prediction", Prediction)
    feeder.feed(700)
    graph.spin_until(lambda: len(predictions) == 700)
    answer = graph.call(EstimateNow, f"{NS}/twin/estimate_now")
    assert answer.success
    assert answer.cycle == 1
    graph.spin_until(lambda: cycles_of(estimates) == [1], what="the estimate")


def test_estimate_now_without_a_cycle_says_what_to_do(graph, twin):
    answer = graph.call(EstimateNow, f"{NS}/twin/estimate_now")
    assert not answer.success
    assert "no cycle is running; wait for a command or look at the inputs" in answer.message


def test_the_history_comes_in_pages(graph, twin, estimates):
    feed_cycles(graph, Feeder(graph, NS), estimates, 4)
    name = f"{NS}/twin/get_history"
    first = graph.call(GetHistory, name, limit=2)
    rest = graph.call(GetHistory, name, limit=2, first_cycle=3)
    assert first.success
    assert [m.cycle for m in first.estimates] == [1, 2]
    assert first.more
    assert [m.cycle for m in rest.estimates] == [3]
    assert not rest.more
    assert list(first.missed_cycles) == [0, 0]
    other = graph.call(GetHistory, name, estimator="equation_error_qp4")
    assert {m.estimator for m in other.estimates} == {"equation_error_qp4"}


def test_maintenance_is_noted_from_the_next_cycle_on(graph, twin, estimates):
    told = graph.record(f"{NS}/twin/maintenance", Maintenance, EVENTS)
    feed_cycles(graph, Feeder(graph, NS), estimates, 2)
    answer = graph.call(
        MarkMaintenance, f"{NS}/twin/mark_maintenance", note="new pilot", new_reference=True
    )
    assert answer.success
    assert answer.cycle == 3
    events = graph.call(GetHistory, f"{NS}/twin/get_history").maintenance
    assert [(e.cycle, e.note, e.new_reference) for e in events] == [(3, "new pilot", True)]
    graph.spin_until(lambda: told, what="the event on its topic")
    assert told == list(events)


def test_a_mark_can_be_withdrawn(graph, twin, estimates):
    told = graph.record(f"{NS}/twin/maintenance", Maintenance, EVENTS)
    feed_cycles(graph, Feeder(graph, NS), estimates, 2)
    mark, withdraw = f"{NS}/twin/mark_maintenance", f"{NS}/twin/withdraw_maintenance"
    assert graph.call(MarkMaintenance, mark, note="new pilot", new_reference=True).success
    for cycle, note, why in (
        (2**63, "why", f"at cycle {2**63} is not there: in force are those at cycle 3"),
        (3, " ", "the note is empty: say why"),
        (3, "x" * 2049, "2049 bytes, 2048 at most"),
    ):
        answer = graph.call(WithdrawMaintenance, withdraw, cycle=cycle, note=note)
        assert not answer.success
        assert why in answer.message
    answer = graph.call(WithdrawMaintenance, withdraw, cycle=3, note="it was valve 2")
    assert answer.success, answer.message
    again = graph.call(WithdrawMaintenance, withdraw, cycle=3, note="once more")
    assert not again.success
    assert "was withdrawn already: it was valve 2" in again.message
    (event,) = graph.call(GetHistory, f"{NS}/twin/get_history").maintenance
    assert (event.withdrawn, event.withdrawn_note) == (True, "it was valve 2")
    graph.spin_until(lambda: len(told) == 2, what="mark and withdrawal on their topic")
    assert not told[0].withdrawn
    assert told[1] == event


def test_a_backup_can_be_read_while_the_twin_goes_on(graph, twin, estimates, tmp_path):
    feed_cycles(graph, Feeder(graph, NS), estimates, 2)
    answer = graph.call(BackupHistory, f"{NS}/twin/backup_history", path="copy.sqlite")
    assert answer.success, answer.message
    path = Path(answer.path)
    assert (path.name, path.parent.name) == ("copy.sqlite", "backups")
    with History(f"sqlite:///{answer.path}", read_only=True) as copy:
        assert copy.last_cycle(NS) == 1
    for name, why in (
        ("copy.sqlite", f"{path}: exists already"),
        (str(tmp_path / "elsewhere.sqlite"), "is no name for a backup"),
        ("../up.sqlite", "is no name for a backup"),
        ("two\nlines", "is no name for a backup"),
    ):
        again = graph.call(BackupHistory, f"{NS}/twin/backup_history", path=name)
        assert not again.success
        assert why in again.message
    assert not (tmp_path / "elsewhere.sqlite").exists()
    assert len(list(path.parent.iterdir())) == 1


def test_what_names_a_place_or_bounds_what_is_kept_is_not_set_from_afar(graph, twin):
    for name, value in (
        ("history_url", "sqlite:////tmp/others.sqlite"),
        ("backup_folder", "/etc"),
        ("allow_remote_configuration", True),
        ("use_sim_time", True),
        ("backups_kept", 1_000_000),
        ("events_kept", 10),
        ("memory_budget_mb", 1e6),
        ("unsaved_limit", 1),
    ):
        (result,) = twin.set_parameters([Parameter(name, value=value)])
        assert not result.successful
        assert "is not changed from afar" in result.reason


def test_services_refuse_what_would_harm(graph, twin, estimates):
    feed_cycles(graph, Feeder(graph, NS), estimates, 2)
    for cycle, note, why in (
        (0, "  ", "the note is empty"),
        (0, "x" * 2049, "2049 bytes, 2048 at most"),
        (9, "a service", "cycle 9 is to come, the next one is 3"),
    ):
        mark = f"{NS}/twin/mark_maintenance"
        answer = graph.call(MarkMaintenance, mark, note=note, cycle=cycle)
        assert not answer.success
        assert why in answer.message
    history = f"{NS}/twin/get_history"
    assert not graph.call(GetHistory, history).maintenance
    unknown = graph.call(GetHistory, history, estimator="output_eror")
    assert not unknown.estimates
    assert "did you mean 'output_error'" in unknown.message
    budget = graph.call(GetErrorBudget, f"{NS}/twin/get_error_budget", realisations=4 * 10**9)
    assert not budget.success
    assert "realisations = 4000000000: 64 at most" in budget.message


def test_a_cycle_summary_tells_samples_and_gaps(graph, twin, estimates):
    summaries = graph.record(f"{NS}/twin/cycle", CycleSummary)
    feeder = Feeder(graph, NS)
    feed_cycles(graph, feeder, estimates, 2)
    assert summaries[0].samples == feeder.cycle_samples
    assert summaries[0].lost == 0
    assert summaries[0].accepted


def test_the_fast_serialization_is_that_of_the_message():
    import numpy as np

    values = np.array([0.1, np.nan])
    prediction = PredictionValue(
        7, np.array([1_500_000_007, 2_000_000_000]), values, values + 1, values + 2, values + 3,
        0.25, np.array([0, 5], dtype=np.uint8), False,
    )  # fmt: skip
    first, second = (deserialize_message(b, Prediction) for b in prediction_bytes(prediction))
    assert (first.header.stamp.sec, first.header.stamp.nanosec, first.cycle) == (1, 500_000_007, 7)
    assert (first.measured, first.predicted, first.simulated) == (0.1, 1.1, 2.1)
    assert (first.residual, first.residual_sigma, first.validity) == (3.1, 0.25, 0)
    assert not first.reproducible
    assert np.isnan(second.measured)
    assert second.validity == Prediction.BAD_INPUT


def test_the_twin_publishes_no_command(graph, twin):
    own = graph.node.get_publisher_names_and_types_by_node
    graph.spin_until(lambda: "twin" in graph.node.get_node_names())
    names = [name for name, _ in own("twin", NS)]
    assert f"{NS}/twin/prediction" in names
    assert not [name for name in names if "command" in name]
