# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The texts of faults name keys that exist."""

import re

import pytest

from valve_twin.core.faults.kinds import FAULT_KINDS
from valve_twin.core.quantity import describe
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.io.config.keys import valve_keys
from valve_twin.io.config.node_parameters import NODE_PARAMETERS

NAME = re.compile(r"\b[a-z]+(?:\.\w+)+|\b[a-z]+(?:_[a-z0-9]+)+\b")
"""What looks like a key: parts joined by points, or words joined by underscores."""

PAIR = re.compile(r"(signals\.NAME)\.(\w+) and (\w+)(?!\.)\b")
"""Two keys of a signal, the second in short."""

OF_ROS = {"use_sim_time"}


@pytest.fixture(scope="module")
def keys():
    """Return all keys of files and nodes, those of a signal under the name NAME, and sections."""
    models = [get_model(name) for name in model_names()]
    names = {key.name for model in models for key in valve_keys(model)}
    names |= {key.name for table in NODE_PARAMETERS.values() for key in table}
    simulations = [s for model in models if (s := model.simulation()) is not None]
    names |= {key.name for s in simulations for key in describe(s, "simulation.")}
    names |= {re.sub(r"^signals\.\w+\.", "signals.NAME.", name) for name in names}
    sections = {name.rpartition(".")[0] for name in names}
    return names | sections | {kind.code for kind in FAULT_KINDS} | OF_ROS


@pytest.mark.parametrize("kind", FAULT_KINDS, ids=lambda kind: kind.code)
def test_every_key_that_a_fault_names_exists(kind, keys):
    text = re.sub(PAIR, r"\1.\2 and \1.\3", f"{kind.meaning} {kind.remedy}")
    named = set(NAME.findall(text))
    assert named <= keys
