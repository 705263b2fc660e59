# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from valve_twin.core.quantity import describe
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.io.config.node_parameters import NODE_PARAMETERS
from valve_twin.io.config.valve import valve_specs
from valve_twin.io.reference import parameter_reference

MODELS = model_names()


def test_the_committed_reference_is_current(root):
    committed = (root / "docs" / "parameters.md").read_text(encoding="utf-8")
    assert committed == parameter_reference(MODELS), "run tools/run tools/parameters"


def test_every_parameter_is_described():
    tables = [valve_specs(get_model(name)) for name in MODELS]
    for spec in [s for table in (*tables, *NODE_PARAMETERS.values()) for s in table]:
        assert spec.description, spec.name


def test_every_option_and_node_parameter_is_listed():
    text = parameter_reference(MODELS)
    names = [f"options.{d.name}" for name in MODELS for d in describe(get_model(name).options)]
    names += [s.name for specs in NODE_PARAMETERS.values() for s in specs]
    for name in names:
        assert f"`{name}`" in text
