# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The keys of a valve's configuration: what each is, from dataclasses."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.quantity import Descriptor, assumed, describe, quantity, setting
from valve_twin.core.types import CONDITIONS
from valve_twin.core.valves.interface import option_descriptors
from valve_twin.core.valves.registry import DEFAULT_MODEL
from valve_twin.io.cdr.signals import STAMPED_TYPE
from valve_twin.io.config.csv import CsvConfig
from valve_twin.io.config.nameplate import Nameplate

if TYPE_CHECKING:
    from valve_twin.core.valves.interface import ValveModel

DEFAULT_HISTORY = "sqlite:///valve_twin_history.sqlite"
"""History database in the working directory."""

_TOLERANCES = "options.tolerances."

OPTIONAL_SIGNALS = ("cycle_counter", "reference", *CONDITIONS)
"""Signals that any valve may map beside its model's inputs and output."""


@dataclass(frozen=True, slots=True)
class ValveKeys:
    """Keys of a valve outside its sections."""

    valves: tuple[str, ...] = setting(
        (),
        "Names of the valves of this process, relative to the node's namespace, "
        "press/valve_{01..50} for fifty; empty = one valve, the namespace itself.",
    )
    model: str = setting(
        DEFAULT_MODEL,
        "Valve model: a name of those in the sections below or one added by a package.",
    )
    period_s: float = quantity(
        0.03, "s", "Nominal sampling time of the position.", lower=1e-6, upper=3600.0
    )
    hold_back_s: float = assumed(
        2.0,
        "s",
        "Longest time, on the data's clock, by which a silent signal delays the others.",
        0.0,
        3600.0,
    )
    topic_prefix: str = setting(
        "",
        "Put before every signal's topic: /sim for a simulated valve, /replay for a replayed bag.",
    )
    history_url: str = setting(
        DEFAULT_HISTORY,
        "Database of estimates: sqlite:///FILE or a PostgreSQL address.",
        local=True,
    )


@dataclass(frozen=True, slots=True)
class SignalKeys:
    """Where one signal comes from."""

    topic: str = setting("", "Topic, relative to the valve's name unless it begins with /")
    type: str = setting(STAMPED_TYPE, "Message type of the topic.")
    field: str = setting(
        "",
        "Field of the message: value, position[2], pose.position.x, values[] for "
        "batches; empty = value or values[].",
    )
    scale: float = quantity(1.0, "signal/field", "The signal is scale * field + offset.")
    offset: float = quantity(0.0, "signal", "The signal is scale * field + offset.")
    lower: float = quantity(-math.inf, "signal", "Values below are not believed.")
    upper: float = quantity(math.inf, "signal", "Values above are not believed.")
    column: str = setting("", "Column of a CSV file: its name, or its number counted from 0.")


VALVE_KEYS = describe(ValveKeys)


def default_topics(model: ValveModel) -> dict[str, str]:
    """Return the topic of every signal of a model by its name, empty where it is optional."""
    topics = {name: name if name == "command" else f"command/{name}" for name in model.inputs}
    return {**topics, model.output: model.output, **dict.fromkeys(OPTIONAL_SIGNALS, "")}


def signal_keys(signal: str, topic: str) -> tuple[Descriptor, ...]:
    """Return the keys of one signal's mapping."""
    first, *others = describe(SignalKeys(topic=topic), f"signals.{signal}.")
    return (first if topic else replace(first, note="empty = not mapped"), *others)


def valve_keys(model: ValveModel) -> tuple[Descriptor, ...]:
    """Return every key of a valve of this model, in the order of the reference."""
    names = [p.name for p in model.parameters]
    return (
        *VALVE_KEYS,
        *(key for item in default_topics(model).items() for key in signal_keys(*item)),
        *describe(CycleConfig, "cycles."),
        *option_descriptors(model, "options."),
        *describe(AgingConfig, "aging.", names),
        *describe(Nameplate, "nameplate."),
        *describe(CsvConfig, "csv."),
    )


def constant_keys(model: ValveModel) -> dict[str, Descriptor]:
    """Return the keys behind `options.NAME: {value: ..., tolerance: ...}` by these two names.

    A known constant and its tolerance stand apart among the keys; a file may write them as one.
    """
    known = {key.name: key for key in option_descriptors(model, "options.")}
    found: dict[str, Descriptor] = {}
    for key in known.values():
        constant = f"options.{key.name.removeprefix(_TOLERANCES)}"
        if key.name.startswith(_TOLERANCES) and constant in known:
            found |= {f"{constant}.value": known[constant], f"{constant}.tolerance": key}
    return found
