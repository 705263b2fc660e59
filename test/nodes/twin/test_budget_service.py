# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The error budget as a service: the numbers of the command, the cause of a refusal."""

import numpy as np
import pytest
from valve_twin_msgs.srv import GetErrorBudget

from test.nodes.conftest import NS
from valve_twin.core.simulation import configure
from valve_twin.core.valves.error_budget import BudgetOptions, error_budget
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation
from valve_twin.nodes.twin.node import TwinNode

SERVICE = f"{NS}/twin/get_error_budget"


@pytest.fixture
def twin(graph, tmp_path):
    database = f"sqlite:///{tmp_path / 'history.sqlite'}"
    quiet = {"simulation.measurement.noise": 1e-4}
    return graph.host(TwinNode, history_url=database, **quiet)


def test_it_answers_what_the_core_computes_for_the_parameters(graph, twin):
    settings = ["plant.mass=90.0"]
    asked = {"offset": 2e-3, "realisations": 2, "settings": settings}
    answer = graph.call(GetErrorBudget, SERVICE, timeout=60.0, **asked)
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
    answer = graph.call(GetErrorBudget, SERVICE, timeout=60.0, settings=["plant.mas=90.0"])
    assert not answer.success
    assert "did you mean 'plant.mass'" in answer.message
    assert list(answer.parameters) == []
