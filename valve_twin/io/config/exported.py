# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A parameter file for a designed valve: another file with numbers of its own in it."""

from __future__ import annotations

import textwrap
from types import MappingProxyType
from typing import TYPE_CHECKING, cast

import yaml

from valve_twin.core.quantity import describe
from valve_twin.core.valves.interface import option_descriptors
from valve_twin.core.valves.registry import get_model, get_simulation
from valve_twin.io.config.parameter_file import WRAPPER
from valve_twin.io.errors import ConfigError
from valve_twin.io.limits import load_yaml

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

_ALL = "/**"
_WIDTH = 120
_HEADER = ("# SPDX-License-Identifier: Apache-2.0", "# Copyright 2026 valve_twin maintainers")


def exported_yaml(
    like: Path,
    model: str,
    shared: Mapping[str, object],
    own: Mapping[str, object],
    title: str,
    twin: Mapping[str, object] = MappingProxyType({}),
) -> str:
    """Return a parameter file with other numbers for the twin and for the simulated valve.

    Parameters
    ----------
    like : Path
        File of that model, whose other keys are kept.
    model : str
        Name of the model.
    shared : mapping
        Options of the twin, which the simulated valve has as well, by dotted name [unit by
        option].
    own : mapping
        Settings of the simulated valve alone, by dotted name [unit by setting].
    title : str
        What the file is, one line.
    twin : mapping
        Options of the twin alone [unit by option].

    Raises
    ------
    ConfigError
        If the file cannot be read or is none of that model.
    """
    try:
        tree = load_yaml(like.read_text(encoding="utf-8"))
        section = tree[_ALL][WRAPPER]
        found = section["model"]
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as err:
        msg = f"{like}: is no parameter file with a section '{_ALL}' and a model ({err})"
        raise ConfigError(msg) from err
    except (KeyError, TypeError) as err:
        msg = f"{like}: is no parameter file with a section '{_ALL}' and a model"
        raise ConfigError(msg) from err
    if found != model:
        msg = f"{like}: is of model '{found}'; give one of '{model}'"
        raise ConfigError(msg)
    both = _nested(shared)
    section["options"] = {**_part(like, section, "options"), **both, **twin}
    section["simulation"] = simulation = _part(like, section, "simulation")
    simulation["plant"] = {**_part(like, simulation, "plant"), **both, **_nested(own)}
    known = (*option_descriptors(get_model(model), "options."),
             *describe(get_simulation(model), "simulation."))  # fmt: skip
    notes = {d.name: f"{d.text} [{d.unit}]" if d.unit else d.text for d in known}
    lines = [*_HEADER, f"# {title}", *_lines(tree, "", notes, "")]
    return "\n".join(lines) + "\n"


def _part(like: Path, tree: Mapping[str, object], key: str) -> dict[str, object]:
    """Return a section; one that is missing or empty has no keys.

    Raises
    ------
    ConfigError
        If it is none.
    """
    found = tree.get(key)
    if found is None:
        return {}
    if not isinstance(found, dict):
        msg = f"{like}: {key} = {found!r}: must be a section with keys"
        raise ConfigError(msg)
    return found


def _nested(given: Mapping[str, object]) -> dict[str, object]:
    """Return dotted names as sections."""
    found: dict[str, object] = {}
    for name, value in given.items():
        *sections, last = name.split(".")
        at = found
        for section in sections:
            at = cast("dict[str, object]", at.setdefault(section, {}))
        at[last] = value
    return found


def _lines(
    tree: Mapping[str, object], indent: str, notes: Mapping[str, str], prefix: str
) -> Iterator[str]:
    for key, value in tree.items():
        name = "" if key in {_ALL, WRAPPER} or key.startswith("/") else f"{prefix}{key}"
        if isinstance(value, dict):
            yield f"{indent}{key}:"
            yield from _lines(value, f"{indent}  ", notes, f"{name}." if name else "")
            continue
        note = f"  # {notes[name]}" if name in notes else ""
        if isinstance(value, (list, tuple)):
            yield f"{indent}{key}:{note}"
            text = ", ".join(_scalar(item) for item in value)
            yield from textwrap.wrap(
                f"[{text}]", _WIDTH, initial_indent=f"{indent}  ", subsequent_indent=f"{indent}   "
            )
        else:
            yield f"{indent}{key}: {_scalar(value)}{note}"


def _scalar(value: object) -> str:
    """Return a value as YAML writes it, on one line."""
    return yaml.safe_dump(value, width=10**6).removesuffix("...\n").strip()
