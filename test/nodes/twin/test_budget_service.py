# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The error budget as a service: the numbers of the command, the cause of a refusal."""

from typing import Any

import numpy as np
import pytest
from valve_twin_msgs.srv import GetErrorBudget

from test.nodes.conftest import NS
from valve_twin.core.simulation import configure
from valve_twin.core.valves.error_budget import BudgetOptions, error_budget
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation
from valve_twin.nodes.twin import budget_service
from valve_twin.nodes.twin.node import TwinNode

SERVICE = f"{NS}/twin/get_error_budget"

LONGEST_S = budget_service.MOST_S + 60.0
"""What a caller may have to wait on a machine that is busy: until then there is an answer."""


@pytest.fixture
def twin(graph, tmp_path):
    database = f"sqlite:///{tmp_path / 'history.sqlite'}"
    quiet = {"simulation.measurement.noise": 1e-4}
    return graph.host(TwinNode, history_url=database, **quiet)


def test_it_answers_what_the_core_computes_for_the_parameters(graph, twin):
    settings = ["plant.mass=90.0"]
    asked = {"offset": 2e-3, "realisations": 2, "settings": settings}
    answer = graph.call(GetErrorBudget, SERVICE, timeout=LONGEST_S, **asked)
    assert answer.success, answer.message
    model = get_model("press_cartridge")
    given = {"measurement.noise": 1e-4, "plant.mass": 90.0}
    simulation = configure(get_simulation(model.name), given)
    options = BudgetOptions(offset=2e-3, realisations=2)
    budget = error_budget(model, complete_options(model, {}), simulation, options)
    assert list(answer.parameters) == [c.parameter for c in budget.columns]
    assert "".join(answer.rows) == "abcdefghijk"
    errors = np.array(answer.errors).reshape(len(answer.rows), len(answer.parameters))
    assert errors.tolist() == [list(row.errors) for row in budget.rows]
    assert errors.sum(axis=0) == pytest.approx(np.array(answer.totals))


def test_a_setting_that_is_unknown_is_refused_with_its_name(graph, twin):
    answer = graph.call(GetErrorBudget, SERVICE, timeout=LONGEST_S, settings=["plant.mas=90.0"])
    assert not answer.success
    assert "did you mean 'plant.mass'" in answer.message
    assert list(answer.parameters) == []


@pytest.fixture
def ask(graph, twin):
    """Return what asks for a large budget and does not wait for the answer."""
    client = graph.node.create_client(GetErrorBudget, SERVICE)
    graph.spin_until(client.service_is_ready, what="the service")
    return lambda: client.call_async(GetErrorBudget.Request(realisations=64))


def test_no_estimation_waits_for_a_budget_and_others_are_refused_meanwhile(graph, twin, ask):
    asked = [ask() for _ in range(10)]
    graph.spin_until(lambda: sum(a.done() for a in asked) == 9, what="nine refusals")
    estimated: list[Any] = []
    twin._valves[0].jobs.run(int, ("7",), estimated.append)
    graph.spin_until(lambda: estimated, what="a job of the estimating process")
    assert estimated[0].result == 7
    assert sum(a.done() for a in asked) == 9
    for one in asked:
        if one.done():
            told = f"{NS}: no error budget: that of {NS} is being computed; ask again when"
            assert one.result().message.startswith(told)


def test_a_budget_without_an_end_is_ended_and_told(graph, twin, ask, monkeypatch):
    monkeypatch.setattr(budget_service, "MOST_S", 0.5)
    for _ in range(2):  # the next one is taken
        asked = ask()
        answer = graph.spin_until(asked.result, what="the answer")
        assert not answer.success
        assert "it is not done within 0.5 s; ask for fewer realisations" in answer.message


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (["fmu.file=/tmp/a.fmu"], "settings: fmu.file is that of the valve and is not set here"),
        (["period_s=1e-6"], "settings: period_s is that of the valve and is not set here"),
    ],
)
def test_settings_that_would_do_harm_are_refused_in_a_line(graph, twin, settings, told):
    answer = graph.call(GetErrorBudget, SERVICE, timeout=LONGEST_S, settings=settings)
    assert not answer.success
    assert told in answer.message
