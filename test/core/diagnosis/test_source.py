# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A table of signatures becomes the module that a valve ships."""

from valve_twin.core.diagnosis.source import table_source


def test_a_table_becomes_a_module_and_back(table):
    names: dict[str, object] = {}
    exec(table_source(table), names)  # our own text
    assert names["TABLE"] == table
