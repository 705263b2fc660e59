# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The configuration of a valve: one YAML file for the nodes and for the offline command.

A file holds ROS 2 parameters. One file may configure many valves: `valves` lists their names, and
a section of a valve's name overrides the common keys for that valve.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.quantity import replaced, suggest
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.interface import ModelOptions, Options
from valve_twin.core.valves.registry import get_model
from valve_twin.io.cdr.message_types import full_type_name
from valve_twin.io.cdr.signals import SERIES_TYPE, SignalSource
from valve_twin.io.config.csv import CsvConfig
from valve_twin.io.config.keys import (
    DEFAULT_HISTORY,
    VALVE_KEYS,
    SignalKeys,
    ValveKeys,
    constant_keys,
    default_topics,
    valve_keys,
)
from valve_twin.io.config.nameplate import Nameplate
from valve_twin.io.config.node_parameters import NODE_PARAMETERS
from valve_twin.io.config.parameter_file import merged, read_parameter_file
from valve_twin.io.config.topic_names import resolve_topic
from valve_twin.io.config.valve_names import expand_names
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.quantity import Descriptor
    from valve_twin.core.valves.interface import ValveModel

T = TypeVar("T")

_ROS_OWN = ("use_sim_time", "start_type_description_service")
_ROS_OWN_PREFIX = "qos_overrides."
_NO_RULE = ("valves", "history_url")  # keys of a valve that change nothing of what is computed


@dataclass(frozen=True, slots=True)
class ValveConfig:
    """Everything that is configured about one valve.

    Attributes
    ----------
    name : str
        The valve's namespace, such as "/press/valve_1".
    model : str
        Name of the valve model.
    period_s : float
        Nominal sampling time of the position [s].
    hold_back_s : float
        Longest time by which a silent signal delays the others [s].
    signals : dict
        Where each signal comes from, by signal name; topics are absolute.
    cycles : CycleConfig
        What cuts the stream into cycles.
    options : dataclass
        Options of the model, checked.
    aging : AgingConfig
        How trends are made.
    history_url : str
        Database of the history.
    simulation : dict
        Overrides of the simulated valve by dotted field name.
    csv : CsvConfig
        How measured CSV files are read.
    nameplate : Nameplate
        Tag, serial number, type, place and maker.
    given : dict
        What was written for the valve by full dotted name, without names and addresses.
    """

    name: str
    model: str
    period_s: float
    hold_back_s: float
    signals: dict[str, SignalSource]
    cycles: CycleConfig = field(default_factory=CycleConfig)
    options: Options = field(default_factory=ModelOptions)
    aging: AgingConfig = field(default_factory=AgingConfig)
    history_url: str = DEFAULT_HISTORY
    simulation: dict[str, object] = field(default_factory=dict)
    csv: CsvConfig = field(default_factory=CsvConfig)
    nameplate: Nameplate = field(default_factory=Nameplate)
    given: dict[str, object] = field(default_factory=dict, compare=False, repr=False)


def load_config(path: str | Path, *, without: tuple[str, ...] = ()) -> list[ValveConfig]:
    """Read the valves of a file as the node would that is started with it.

    Parameters
    ----------
    path : path
        YAML file of ROS 2 parameters.
    without : tuple of str
        Keys that are not heeded, of any valve.

    Returns
    -------
    list of ValveConfig
        At least one, in the order of the file.

    Raises
    ------
    ConfigError
        One line that names the file, the key, the value and what to do.
    """
    path = Path(path)
    sections = read_parameter_file(path)
    namespaces = dict.fromkeys(
        s.namespace for s in sections if s.namespace is not None and s.pattern.endswith("/twin")
    )
    configs: list[ValveConfig] = []
    for namespace in namespaces or {"/": None}:
        own = str(namespace)
        whole = merged(s for s in sections if s.matches(f"{own.rstrip('/')}/twin"))
        flat = {key: value for key, value in whole.values.items() if not key.endswith(without)}
        configs += parse_config(
            flat, str(path), namespace=own, fallback=path.stem, lines=whole.lines
        )
    _check_distinct(configs, str(path))
    return configs


def _check_distinct(configs: Sequence[ValveConfig], where: str) -> None:
    names = [c.name for c in configs]
    for valve in names:
        if names.count(valve) > 1:
            msg = (
                f"{where}: key 'valves': '{valve}' stands twice; give every valve a name of "
                "its own"
            )
            raise ConfigError(msg)


def parse_config(
    flat: Mapping[str, object],
    where: str,
    *,
    namespace: str = "/",
    fallback: str = "valve",
    lines: Mapping[str, int] | None = None,
    refused: dict[str, str] | None = None,
) -> list[ValveConfig]:
    """Build the configurations of the valves of one process from flat dotted parameters.

    Parameters
    ----------
    flat : mapping
        Values by full dotted name; what is not given keeps its default.
    where : str
        File or node for error messages.
    namespace : str
        Namespace of the node.
    fallback : str
        Name of the only valve where the namespace is "/" and `valves` is empty.
    lines : mapping, optional
        Line in the file by key.
    refused : dict, optional
        Takes, by name, why a valve of several cannot be used; without it the first is an error.

    Returns
    -------
    list of ValveConfig
        At least one.

    Raises
    ------
    ConfigError
        One line that names the file or node, the key, the value and what to do.
    """
    reader = _Reader(where, lines or {})
    valves = reader.valves(flat)
    if not valves:
        own = namespace.strip("/") or fallback
        reader.refuse_sections(flat, ())
        return [reader.valve("/" + own, dict(flat), {key: key for key in flat})]
    reader.refuse_sections(flat, valves)
    configs: list[ValveConfig] = []
    first: ConfigError | None = None
    for valve in valves:
        values, origin = _of_valve(flat, valve, valves)
        name = "/" + "/".join(p for p in (namespace.strip("/"), valve.strip("/")) if p)
        try:
            configs.append(reader.valve(name, values, origin))
        except ConfigError as err:
            if refused is None:
                raise
            refused[name] = str(err)
            first = first or err
    if first is not None and not configs:
        raise first
    return configs


def _of_valve(
    flat: Mapping[str, object], valve: str, valves: Sequence[str]
) -> tuple[dict[str, object], dict[str, str]]:
    """Return the values of one valve, its own over the common ones, and the key of each."""
    values: dict[str, object] = {}
    origin: dict[str, str] = {}
    for own in (False, True):
        for key, value in flat.items():
            section = next((v for v in valves if key.startswith(f"{v}.")), None)
            if (section == valve) if own else (section is None):
                short = key[len(valve) + 1 :] if own else key
                values[short], origin[short] = value, key
    return values, origin


class _Reader:
    """Checks keys and values and knows how to name their place."""

    def __init__(self, where: str, lines: Mapping[str, int]) -> None:
        self._where = where
        self._lines = lines

    def _at(self, key: str, problem: str) -> ConfigError:
        line = f":{self._lines[key]}" if key in self._lines else ""
        return ConfigError(f"{self._where}{line}: key '{key}': {problem}")

    def _of(self, origin: Mapping[str, str], key: str, problem: str) -> ConfigError:
        """Return what is wrong with a key of a valve, told by the key that was written."""
        return self._at(origin.get(key, key), problem)

    def valves(self, flat: Mapping[str, object]) -> tuple[str, ...]:
        key = VALVE_KEYS[0].name
        try:
            given = VALVE_KEYS[0].check(flat.get(key, ()))
            assert isinstance(given, tuple)
            names = expand_names(given)
        except ValueError as err:
            raise self._at(key, str(err)) from None
        for name in names:
            parts = name.strip("/").split("/")
            if not all(p.isidentifier() and p.isascii() for p in parts):
                problem = (
                    f"'{name}' is no name; write letters, digits and _ only, parts divided by /"
                )
                raise self._at(key, problem)
            if names.count(name) > 1:
                problem = f"'{name}' stands twice; give every valve a name of its own"
                raise self._at(key, problem)
        return names

    def refuse_sections(self, flat: Mapping[str, object], valves: Sequence[str]) -> None:
        for key in flat:
            section = key.split(".", 1)[0]
            known = {s.name.split(".", 1)[0] for s in VALVE_KEYS}
            if "/" in section and "." in key and section not in valves and section not in known:
                problem = f"there is no valve '{section}' in 'valves'; {suggest(section, valves)}"
                raise self._at(key, problem)

    def valve(
        self, name: str, values: Mapping[str, object], origin: Mapping[str, str]
    ) -> ValveConfig:
        model = self._model(values, origin)
        known = {key.name: key for key in valve_keys(model)}
        constants = constant_keys(model)
        given: dict[str, object] = {}
        simulation: dict[str, object] = {}
        for key, value in values.items():
            if key in known:
                given[key] = self._checked(known[key], value, origin[key])
            elif key in constants:
                given[constants[key].name] = self._checked(constants[key], value, origin[key])
            elif key.startswith("simulation."):
                simulation[key.removeprefix("simulation.")] = value
            elif not _of_a_node(key):
                hint = suggest(key, [*known, *_node_keys()])
                raise self._at(origin[key], f"is unknown; {hint}")
        keys = replaced(ValveKeys(), given)
        signals = self._signals(name, model, keys.topic_prefix, given, origin)
        return ValveConfig(
            name=name,
            model=model.name,
            period_s=keys.period_s,
            hold_back_s=keys.hold_back_s,
            signals=signals,
            cycles=self._cycles(given, model, signals, origin),
            options=self._section("options", model.options, given),
            aging=self._aging(given, model, keys.period_s, origin),
            history_url=keys.history_url,
            simulation=simulation,
            csv=self._section("csv", CsvConfig(), given),
            nameplate=self._section("nameplate", Nameplate(), given),
            given={
                key: value
                for key, value in values.items()
                if key not in _NO_RULE and (key in known or not _of_a_node(key))
            },
        )

    def _model(self, values: Mapping[str, object], origin: Mapping[str, str]) -> ValveModel:
        key, model = origin.get("model", "model"), VALVE_KEYS[1]
        name = self._checked(model, values.get("model", model.default), key)
        try:
            return get_model(str(name))
        except ValueError as err:
            raise self._at(key, str(err)) from None

    def _checked(self, known: Descriptor, value: object, key: str) -> object:
        try:
            return known.check(value)
        except ValueError as err:
            raise self._at(key, str(err)) from None

    def _signals(
        self,
        valve: str,
        model: ValveModel,
        topic_prefix: str,
        given: Mapping[str, object],
        origin: Mapping[str, str],
    ) -> dict[str, SignalSource]:
        sources: dict[str, SignalSource] = {}
        for signal, topic in default_topics(model).items():
            prefix = f"signals.{signal}."
            keys = replaced(SignalKeys(topic=topic), given, prefix)
            if not keys.topic:
                if topic:
                    problem = "is empty; write the topic that carries this signal"
                    raise self._of(origin, f"{prefix}topic", problem)
                continue
            self._check_numbers(prefix, keys, origin)
            try:
                type_name = full_type_name(keys.type)
            except ValueError as err:
                raise self._of(origin, f"{prefix}type", str(err)) from None
            sources[signal] = SignalSource(
                signal=signal,
                topic=resolve_topic(keys.topic, valve, topic_prefix),
                type=type_name,
                field=keys.field or _default_field(type_name),
                column=keys.column,
                scale=keys.scale,
                offset=keys.offset,
                lower=keys.lower,
                upper=keys.upper,
            )
        return sources

    def _check_numbers(self, prefix: str, keys: SignalKeys, origin: Mapping[str, str]) -> None:
        problem = "value {!r} makes every sample useless; write a finite number"
        if not math.isfinite(keys.scale) or keys.scale == 0.0:
            text = problem.format(keys.scale) + " other than 0"
            raise self._of(origin, f"{prefix}scale", text)
        if not math.isfinite(keys.offset):
            raise self._of(origin, f"{prefix}offset", problem.format(keys.offset))
        if not keys.lower < keys.upper:
            text = f"value {keys.lower!r} is not below upper = {keys.upper!r}; swap or widen them"
            raise self._of(origin, f"{prefix}lower", text)

    def _cycles(
        self,
        given: Mapping[str, object],
        model: ValveModel,
        signals: Mapping[str, SignalSource],
        origin: Mapping[str, str],
    ) -> CycleConfig:
        cycles = self._section("cycles", CycleConfig(), given)
        for key in ("start_signal", "rearm_signal"):
            name = getattr(cycles, key)
            if name and name not in model.inputs:
                hint = suggest(name, model.inputs)
                problem = f"'{name}' is no command of model '{model.name}'; {hint}"
                raise self._of(origin, f"cycles.{key}", problem)
        if cycles.rule is CycleRule.COMMANDS and not model.inputs:
            problem = (
                f"'{cycles.rule.value}' needs a command and model '{model.name}' has none; write "
                "window, counter or reference"
            )
            raise self._of(origin, "cycles.rule", problem)
        if cycles.max_cycle_s <= cycles.min_cycle_s:
            problem = (
                f"value {cycles.max_cycle_s!r} s is not above cycles.min_cycle_s = "
                f"{cycles.min_cycle_s!r} s; raise it"
            )
            raise self._of(origin, "cycles.max_cycle_s", problem)
        needs = {CycleRule.COUNTER: "cycle_counter", CycleRule.REFERENCE: "reference"}
        signal = needs.get(cycles.rule)
        if signal and signal not in signals:
            problem = (
                f"'{cycles.rule.value}' needs the signal '{signal}'; write signals.{signal}.topic"
            )
            raise self._of(origin, "cycles.rule", problem)
        return cycles

    def _aging(
        self,
        given: Mapping[str, object],
        model: ValveModel,
        period_s: float,
        origin: Mapping[str, str],
    ) -> AgingConfig:
        aging = self._section("aging", AgingConfig(), given)
        if not aging.feature_reference:
            return aging
        # what reads and holds a reference is not loaded for a valve without one
        from valve_twin.io.feature_reference import read_reference

        try:
            reference = read_reference(aging.feature_reference, model, period_s)
        except ConfigError as err:
            raise self._of(origin, "aging.feature_reference", str(err)) from None
        return replace(aging, reference=reference)

    def _section(self, section: str, default: T, given: Mapping[str, object]) -> T:
        try:
            return replaced(default, given, f"{section}.")
        except ValueError as err:
            msg = f"{self._where}: section '{section}': {err}"
            raise ConfigError(msg) from None


def _default_field(type_name: str) -> str:
    if type_name == SERIES_TYPE:
        return "values[]"
    return "data" if type_name.startswith("std_msgs/") else "value"


def _node_keys() -> list[str]:
    return [known.name for table in NODE_PARAMETERS.values() for known in table]


def _of_a_node(key: str) -> bool:
    return key in _node_keys() or key in _ROS_OWN or key.startswith(_ROS_OWN_PREFIX)
