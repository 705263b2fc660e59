# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write the parameter reference from the tables that nodes declare and files are checked by."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.quantity import describe, example
from valve_twin.core.valves.interface import option_descriptors
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.csv import CsvConfig
from valve_twin.io.config.keys import VALVE_KEYS, signal_keys
from valve_twin.io.config.nameplate import Nameplate
from valve_twin.io.config.node_parameters import NODE_PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.quantity import Descriptor

_HEAD = """# Parameters

Written from the source by `tools/parameters`; do not edit. One YAML file serves the nodes and the
offline command; `config/` holds commented examples. Units: `1` = dimensionless; positions are
normalised to the stroke, commands to full scale.

A key in a section named like a valve of `valves` overrides the common key for that valve.
"""

_SIGNAL, _PARAMETER = "SIGNAL", "PARAMETER"


def parameter_reference(models: Sequence[str]) -> str:
    """Return the reference of all parameters in Markdown.

    Parameters
    ----------
    models : sequence of str
        Valve models whose options are listed, each in a section of its own.
    """
    parts = [
        _HEAD,
        _section("Valve", VALVE_KEYS),
        _section("Signals", signal_keys(_SIGNAL, "")),
        f"`{_SIGNAL}` is an input or the output of the model, `cycle_counter`, `reference`, or a "
        "condition that a trend may take out: `supply_pressure`, `load`, `temperature`.\n",
        _section("Cycles", describe(CycleConfig, "cycles.")),
        _section("Aging", describe(AgingConfig, "aging.", [_PARAMETER])),
        f"`{_PARAMETER}` is a parameter of the model. A node has one below `aging.thresholds` or "
        "`aging.commissioning` once a file gives it or it is set or read by its name, not before; "
        "so it is with `options.tolerances` and, of a signal whose topic is empty, all but the "
        "topic.\n",
        _section("Nameplate", describe(Nameplate, "nameplate.")),
        _section("CSV files", describe(CsvConfig, "csv.")),
    ]
    for name in models:
        parts += _model_sections(name)
    for node, specs in NODE_PARAMETERS.items():
        parts.append(_section(f"Node {node}", specs))
    return "\n".join(parts)


def _model_sections(name: str) -> list[str]:
    model = get_model(name)
    options = option_descriptors(model, "options.")
    parts = [_section(f"Options of {name}", options), _parameters(name)]
    simulation = model.simulation()
    if simulation is not None:
        settings = describe(simulation, "simulation.")
        parts.append(_section(f"Simulation of {name}", settings))
    return parts


def _parameters(name: str) -> str:
    rows = [
        f"| `{p.name}` | {p.unit} | {'yes' if p.trend else ''} | {_cell(p.description)} |"
        for p in get_model(name).parameters
    ]
    head = f"## Estimated by {name}\n\n| parameter | unit | trend | meaning |\n|---|---|---|---|\n"
    return head + "\n".join(rows) + "\n"


def _section(title: str, specs: Iterable[Descriptor]) -> str:
    rows = [
        f"| `{s.name}` | {s.kind.value} | {_default(s)} | {s.unit} | {_allowed(s)} | "
        f"{_cell(s.description)} |"
        for s in specs
    ]
    head = f"## {title}\n\n| key | type | default | unit | allowed | meaning |\n"
    return head + "|---|---|---|---|---|---|\n" + "\n".join(rows) + "\n"


def _default(spec: Descriptor) -> str:
    if isinstance(spec.default, (list, tuple)) and not spec.default:
        return "none"
    text = example(spec.default)
    return "not given" if text == ".nan" else f"`{text}`"


def _allowed(spec: Descriptor) -> str:
    return ", ".join(f"`{c}`" for c in spec.choices) or spec.limits


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
