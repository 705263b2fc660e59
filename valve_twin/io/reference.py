# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write the parameter reference from the tables that nodes declare and files are checked by."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from valve_twin.core.simulation import list_settings
from valve_twin.core.valves.registry import get_model, get_simulation
from valve_twin.io.config.node_parameters import NODE_PARAMETERS
from valve_twin.io.config.schema import Spec, descriptor_specs, example, limits
from valve_twin.io.config.valve import VALVE_SPECS, signal_specs, valve_specs

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

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
    first = get_model(models[0])
    names = [p.name for p in first.parameters]
    common = [s for s in valve_specs(first) if s.name.split(".")[0] in {"cycles", "csv"}]
    aging = [s for s in valve_specs(first) if s.name.startswith("aging.")]
    parts = [
        _HEAD,
        _section("Valve", VALVE_SPECS),
        _section("Signals", signal_specs(_SIGNAL, "")),
        f"`{_SIGNAL}` is an input or the output of the model, `cycle_counter`, `reference`, or a "
        "condition that a trend may take out: `supply_pressure`, `load`, `temperature`.\n",
        _section("Cycles", [s for s in common if s.name.startswith("cycles.")]),
        _section("Aging", _once(aging, names)),
        f"`{_PARAMETER}` is a parameter of the model.\n",
        _section("CSV files", [s for s in common if s.name.startswith("csv.")]),
    ]
    for name in models:
        parts += _model_sections(name)
    for node, specs in NODE_PARAMETERS.items():
        parts.append(_section(f"Node {node}", specs))
    return "\n".join(parts)


def _model_sections(name: str) -> list[str]:
    model = get_model(name)
    options = [s for s in valve_specs(model) if s.name.startswith("options.")]
    parts = [_section(f"Options of {name}", options), _parameters(name)]
    try:
        settings = list_settings(get_simulation(name))
    except ValueError:
        return parts
    specs = [replace(s, name=f"simulation.{s.name}") for s in descriptor_specs(settings)]
    return [*parts, _section(f"Simulation of {name}", specs)]


def _parameters(name: str) -> str:
    rows = [
        f"| `{p.name}` | {p.unit} | {'yes' if p.trend else ''} | {_cell(p.description)} |"
        for p in get_model(name).parameters
    ]
    head = f"## Estimated by {name}\n\n| parameter | unit | trend | meaning |\n|---|---|---|---|\n"
    return head + "\n".join(rows) + "\n"


def _once(specs: Iterable[Spec], names: Sequence[str]) -> list[Spec]:
    """Replace the name of a parameter by its place holder, each key once."""
    found: dict[str, Spec] = {}
    for spec in specs:
        parts = [_PARAMETER if part in names else part for part in spec.name.split(".")]
        found.setdefault(".".join(parts), spec)
    return [
        Spec(name, s.kind, s.default, s.description, s.unit, s.lower, s.upper, s.choices)
        for name, s in found.items()
    ]


def _section(title: str, specs: Iterable[Spec]) -> str:
    rows = [
        f"| `{s.name}` | {s.kind.value} | {_default(s)} | {s.unit} | {_allowed(s)} | "
        f"{_cell(s.description)} |"
        for s in specs
    ]
    head = f"## {title}\n\n| key | type | default | unit | allowed | meaning |\n"
    return head + "|---|---|---|---|---|---|\n" + "\n".join(rows) + "\n"


def _default(spec: Spec) -> str:
    if isinstance(spec.default, (list, tuple)) and not spec.default:
        return "none"
    text = example(spec.default)
    return "not given" if text == ".nan" else f"`{text}`"


def _allowed(spec: Spec) -> str:
    return ", ".join(f"`{c}`" for c in spec.choices) or limits(spec)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
