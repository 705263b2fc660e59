# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Units of parameters as OPC UA tells them: common codes of UNECE recommendation 20."""

from __future__ import annotations

from asyncua import ua

NAMESPACE = "http://www.opcfoundation.org/UA/units/un/cefact"

CODES = {
    "%": "P1",
    "1": "C62",
    "1/s": "C97",
    "A": "AMP",
    "H": "81",
    "N": "NEW",
    "N s/m": "C58",
    "N/A": "H40",
    "N/m": "4P",
    "Pa": "PAL",
    "Pa s": "C65",
    "kg": "KGM",
    "kg m^2": "B32",
    "kg/m^3": "KMQ",
    "m": "MTR",
    "m/s": "MTS",
    "m^2": "MTK",
    "m^3/s": "MQS",
    "ohm": "OHM",
    "rad/s": "2A",
    "s": "SEC",
}
"""Common code by unit; a unit without one is told by its sign alone."""


def unit_number(code: str) -> int:
    """Return the number of a common code (OPC 10000-8): its characters, the first one highest."""
    return int.from_bytes(code.encode("ascii"), "big")


def engineering_unit(unit: str) -> ua.EUInformation:
    """Return a unit as a client reads it; -1 stands for a unit without common code."""
    code = CODES.get(unit)
    return ua.EUInformation(
        NamespaceUri=NAMESPACE if code else "",
        UnitId=unit_number(code) if code else -1,
        DisplayName=ua.LocalizedText(unit),
        Description=ua.LocalizedText(unit),
    )
