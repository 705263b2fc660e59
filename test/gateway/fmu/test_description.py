# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Units of a model description; the rest of it is checked by FMPy in test_export."""

import xml.etree.ElementTree as ET

import pytest

from test.gateway.fmu.test_valve import VALUES, made, record
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.gateway.fmu.description import base_units, model_description
from valve_twin.gateway.fmu.valve import valve_of


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


@pytest.mark.parametrize("version", [2, 3])
def test_a_name_that_no_xml_can_hold_is_told_without_what_it_cannot(version):
    name = '/press/<&">\x01\udcff valve'
    valve = valve_of("db", name, made(values=VALUES), record())
    root = ET.fromstring(model_description(valve, version))
    assert root.get("description", "").startswith('/press/<&">\ufffd\\udcff valve as estimated')
