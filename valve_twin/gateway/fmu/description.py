# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""modelDescription.xml of FMI 2.0 and 3.0 and buildDescription.xml."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from math import isfinite
from typing import TYPE_CHECKING

from valve_twin import __version__

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.gateway.fmu.valve import FmuValve, Quantity

SOURCES = {2: ("fmi2.c",), 3: ("fmi3.c",)}
"""What is compiled, by version."""

_BASE = {
    **{unit: {unit: 1} for unit in ("m", "s", "A", "K", "rad", "kg")},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "Wb": {"kg": 1, "m": 2, "s": -2, "A": -1},
    "Hz": {"s": -1},
    "1": {},
}
"""Exponents of the SI base units, of coherent units only."""
_NOT_OF_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_FACTOR = re.compile(r"([A-Za-z]+|1)(?:\^?(-?\d+))?")


def base_units(unit: str) -> dict[str, int] | None:
    """Return the exponents of SI's base units of a product such as "N s/m^2"; None = not known.

    Parameters
    ----------
    unit : str
        Coherent SI unit.
    """
    total: dict[str, int] = {}
    for k, part in enumerate(unit.split("/")):
        for factor in part.replace("*", " ").strip("() ").split():
            match = _FACTOR.fullmatch(factor)
            if match is None or match[1] not in _BASE:
                return None
            times = int(match[2] or 1) * (1 if k == 0 else -1)
            for base, exponent in _BASE[match[1]].items():
                total[base] = total.get(base, 0) + exponent * times
    return {base: n for base, n in total.items() if n}


def model_description(valve: FmuValve, version: int) -> bytes:
    """Return modelDescription.xml.

    Parameters
    ----------
    valve : FmuValve
        What it says.
    version : int
        2 or 3.
    """
    token = {"guid": valve.token} if version == 2 else {"instantiationToken": valve.token}
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{version}.0",
            "modelName": valve.identifier,
            **token,
            "description": valve.text,
            "version": valve.version,
            "generationTool": f"valve_twin {__version__}",
            "generationDateAndTime": valve.made,
            "variableNamingConvention": "flat",
        },
    )
    state = "FMUstate" if version == 2 else "FMUState"
    face = ET.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": valve.identifier,
            "canHandleVariableCommunicationStepSize": "true",
            f"canGetAndSet{state}": "true",
            f"canSerialize{state}": "true",
        },
    )
    if version == 2:
        files = ET.SubElement(face, "SourceFiles")
        for name in SOURCES[2]:
            ET.SubElement(files, "File", {"name": name})
    else:
        face.set("fixedInternalStepSize", repr(valve.period_s))
    _units(root, ["s", *(q.unit for q in valve.variables)])
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", {"name": "logStatusError"})
    ET.SubElement(
        root,
        "DefaultExperiment",
        {"startTime": "0.0", "stopTime": repr(valve.stop_s), "stepSize": repr(valve.period_s)},
    )
    (_variables_2 if version == 2 else _variables_3)(root, valve)
    return xml_bytes(root)


def build_description(valve: FmuValve) -> bytes:
    """Return buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    one = ET.SubElement(root, "BuildConfiguration", {"modelIdentifier": valve.identifier})
    files = ET.SubElement(one, "SourceFileSet", {"language": "C99"})
    for name in SOURCES[3]:
        ET.SubElement(files, "SourceFile", {"name": name})
    return xml_bytes(root)


def _units(root: ET.Element, units: Sequence[str]) -> None:
    section = ET.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(u for u in units if u):
        known = base_units(unit)
        one = ET.SubElement(section, "Unit", {"name": unit})
        if known is not None:
            ET.SubElement(one, "BaseUnit", {k: str(n) for k, n in known.items()})


def _roles(valve: FmuValve) -> list[tuple[Quantity, dict[str, str], bool]]:
    """Return the variables from reference 1 on: role in both versions, whether it has a start."""
    calculated = {"initial": "calculated"}
    return [
        *((q, {"causality": "input", "variability": "discrete"}, True) for q in valve.inputs),
        (valve.output, {"causality": "output", "variability": "discrete", **calculated}, False),
        (valve.first, {"causality": "parameter", "variability": "fixed"}, True),
        *(
            (q, {"causality": "parameter", "variability": "tunable"}, True)
            for q in valve.parameters
        ),
        *(
            (q, {"causality": "local", "variability": "discrete", **calculated}, False)
            for q in valve.states
        ),
        (valve.delay, {"causality": "local", "variability": "constant"}, True),
    ]


def _numbers(q: Quantity, *, start: bool) -> dict[str, str]:
    found = {"unit": q.unit} if q.unit else {}
    found |= {k: repr(v) for k, v in (("min", q.lower), ("max", q.upper)) if isfinite(v)}
    return {**found, "start": repr(q.start)} if start else found


def _variables_2(root: ET.Element, valve: FmuValve) -> None:
    section = ET.SubElement(root, "ModelVariables")
    time = {"name": "time", "valueReference": "0", "causality": "independent"}
    one = ET.SubElement(section, "ScalarVariable", {**time, "variability": "continuous"})
    ET.SubElement(one, "Real", {"unit": "s"})
    for k, (q, role, start) in enumerate(_roles(valve), start=1):
        head = {"name": q.name, "valueReference": str(k), "description": q.text, **role}
        one = ET.SubElement(section, "ScalarVariable", head)
        ET.SubElement(one, "Real", _numbers(q, start=start))
    structure = ET.SubElement(root, "ModelStructure")
    index = str(len(valve.inputs) + 2)  # counted from 1, time is the first
    for name in ("Outputs", "InitialUnknowns"):
        part = ET.SubElement(structure, name)
        on = "" if name == "Outputs" else str(len(valve.inputs) + 3)
        ET.SubElement(part, "Unknown", {"index": index, "dependencies": on})


def _variables_3(root: ET.Element, valve: FmuValve) -> None:
    section = ET.SubElement(root, "ModelVariables")
    time = {"name": "time", "valueReference": "0", "causality": "independent"}
    ET.SubElement(section, "Float64", {**time, "variability": "continuous", "unit": "s"})
    for k, (q, role, start) in enumerate(_roles(valve), start=1):
        head = {"name": q.name, "valueReference": str(k), "description": q.text, **role}
        ET.SubElement(section, "Float64", {**head, **_numbers(q, start=start)})
    structure = ET.SubElement(root, "ModelStructure")
    reference = str(len(valve.inputs) + 1)
    first = str(len(valve.inputs) + 2)
    ET.SubElement(structure, "Output", {"valueReference": reference, "dependencies": ""})
    ET.SubElement(
        structure, "InitialUnknown", {"valueReference": reference, "dependencies": first}
    )


def xml_bytes(root: ET.Element) -> bytes:
    """Return an XML file."""
    for element in root.iter():
        for key, value in element.items():
            element.set(key, _NOT_OF_XML.sub("\N{REPLACEMENT CHARACTER}", value))
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"
