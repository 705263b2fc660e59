# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Units of a model description; the rest of it is checked by FMPy in test_export."""

import pytest

from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.gateway.fmu.description import base_units


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("1", {}),
        ("1/s", {"s": -1}),
        ("N s/m", {"kg": 1, "s": -1}),
        ("m^3/s", {"m": 3, "s": -1}),
        ("kg/m^3", {"kg": 1, "m": -3}),
        ("V s/A", {"kg": 1, "m": 2, "s": -2, "A": -2}),
        ("bar", None),
        ("m/", {"m": 1}),
    ],
)
def test_a_unit_is_a_product_of_base_units(unit, exponents):
    assert base_units(unit) == exponents


def test_the_units_of_our_valves_are_known_but_for_those_of_a_signal():
    units = {p.unit for name in model_names() for p in get_model(name).parameters}
    unknown = {u for u in units if base_units(u) is None}
    assert len(unknown) < len(units) / 4, sorted(unknown)
