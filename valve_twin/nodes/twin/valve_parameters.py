# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The parameters of the valves that a node hosts, from the tables and the reader of files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.keys import VALVE_KEYS, constant_keys, valve_keys
from valve_twin.io.config.valve import ValveConfig, parse_config
from valve_twin.io.config.valve_names import expand_names

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.quantity import Descriptor
    from valve_twin.nodes.runtime.node import ValveNode

SQLITE = "sqlite:///"

ON_USE = ("aging.thresholds.", "aging.commissioning.", "options.tolerances.")
"""Keys of every parameter or constant of a model, of which a user sets a few."""


def read_valves(node: ValveNode, refused: dict[str, str] | None = None) -> list[ValveConfig]:
    """Declare the parameters of the node's valves and read them.

    A valve of several whose own section is wrong is left out and named in the log: the others do
    their work.

    Parameters
    ----------
    node : ValveNode
        The node.
    refused : dict, optional
        Takes, by name, why a valve is left out.

    Returns
    -------
    list of ValveConfig
        At least one; the file of a history is absolute.

    Raises
    ------
    ConfigError
        One line that names the node, the key, the value and what to do.
    """
    parameters = node.parameters
    parameters.declare(VALVE_KEYS)
    model = str(parameters["model"])
    always, on_use = shared_out(list(_keys(model)))
    parameters.declare(always)
    parameters.offer(on_use)
    parameters.declare(s for s in _constants(model) if s.name in parameters.overrides)
    names = _names(parameters["valves"])
    for valve in names:
        own = str(parameters.overrides.get(f"{valve}.model", model))
        prefixed = [replace(s, name=f"{valve}.{s.name}") for s in (*_keys(own), *_constants(own))]
        parameters.declare(s for s in prefixed if s.name in parameters.overrides)
    if _is_known(model):  # else nothing that belongs to it is
        parameters.warn_unknown(hosts_valves=True)
    wrong = {v: parameters.take_errors(f"{v}.") for v in names} if len(names) > 1 else {}
    parameters.check()
    given = parameters.given() | {
        name: value for name, value in parameters.overrides.items() if ".simulation." in f".{name}"
    }
    for valve, errors in wrong.items():
        if errors:  # the reader names it: the value itself, not the default that stands for it
            given |= {k: v for k, v in parameters.overrides.items() if k.startswith(f"{valve}.")}
    left_out: dict[str, str] = {}
    where = node.get_fully_qualified_name()
    configs = parse_config(given, where, namespace=node.get_namespace(), refused=left_out)
    for valve, why in left_out.items():
        node.get_logger().error(f"{valve} is left out: {why}")
    if refused is not None:
        refused |= left_out
    return [replace(c, history_url=absolute_url(c.history_url)) for c in configs]


def shared_out(keys: Sequence[Descriptor]) -> tuple[list[Descriptor], list[Descriptor]]:
    """Return which keys of a model a node has as parameters always, and which once they are used.

    Of a signal that a plant may lack, whose topic is empty, only the topic is there always.

    Parameters
    ----------
    keys : sequence of Descriptor
        Of one model.
    """
    lacking = {
        key.name.removesuffix("topic")
        for key in keys
        if key.name.startswith("signals.") and key.name.endswith(".topic") and not key.default
    }

    def is_on_use(key: Descriptor) -> bool:
        signal = key.name[: key.name.rfind(".") + 1]
        return key.name.startswith(ON_USE) or (signal in lacking and key.name != f"{signal}topic")

    on_use = [key for key in keys if is_on_use(key)]
    return [key for key in keys if not is_on_use(key)], on_use


def absolute_url(url: str) -> str:
    """Return a database with the whole path where it is a file.

    Parameters
    ----------
    url : str
        File or URL, as a configuration has it.
    """
    head, file = (SQLITE, url.removeprefix(SQLITE)) if url.startswith(SQLITE) else ("", url)
    if "://" in file or not file.strip() or file == ":memory:":
        return url
    return f"{head}{Path(file).absolute()}"


def _is_known(model: str) -> bool:
    try:
        get_model(model)
    except ValueError:
        return False
    return True


def _names(given: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the valves; what is wrong with them the reader says."""
    try:
        return expand_names(given)
    except ValueError:
        return ()


def _keys(model: str) -> Iterable[Descriptor]:
    """Return the table of a model; of an unknown one what all share: the reader then names it."""
    try:
        return valve_keys(get_model(model))
    except ValueError:
        return VALVE_KEYS


def _constants(model: str) -> Iterable[Descriptor]:
    """Return the keys of constants that are written with their tolerances."""
    try:
        return [replace(key, name=name) for name, key in constant_keys(get_model(model)).items()]
    except ValueError:
        return ()
