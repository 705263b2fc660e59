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
from valve_twin.core.cycles import CycleConfig
from valve_twin.core.quantity import Kind
from valve_twin.core.types import CONDITIONS, CycleRule
from valve_twin.core.valves.interface import NoOptions, Options, option_descriptors
from valve_twin.core.valves.registry import DEFAULT_MODEL, complete_options, get_model
from valve_twin.io.cdr.message_types import full_type_name
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE, SignalSource
from valve_twin.io.config.csv import CsvConfig
from valve_twin.io.config.node_parameters import NODE_PARAMETERS
from valve_twin.io.config.parameter_file import Section, read_parameter_file
from valve_twin.io.config.schema import Spec, build, dataclass_specs, descriptor_specs
from valve_twin.io.config.topic_names import resolve_topic
from valve_twin.io.config.valve_names import expand_names
from valve_twin.io.errors import ConfigError, suggest

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.valves.interface import ValveModel

T = TypeVar("T")

DEFAULT_HISTORY = "sqlite:///valve_twin_history.sqlite"
"""History database in the working directory."""

OPTIONAL_SIGNALS = ("cycle_counter", "reference", *CONDITIONS)
"""Signals that any valve may map beside its model's inputs and output."""

_ROS_OWN = ("use_sim_time", "start_type_description_service")
_ROS_OWN_PREFIX = "qos_overrides."


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
    """

    name: str
    model: str
    period_s: float
    hold_back_s: float
    signals: dict[str, SignalSource]
    cycles: CycleConfig = field(default_factory=CycleConfig)
    options: Options = field(default_factory=NoOptions)
    aging: AgingConfig = field(default_factory=AgingConfig)
    history_url: str = DEFAULT_HISTORY
    simulation: dict[str, object] = field(default_factory=dict)
    csv: CsvConfig = field(default_factory=CsvConfig)


VALVE_SPECS = (
    Spec(
        "valves",
        Kind.STRINGS,
        (),
        "Names of the valves of this process, relative to the node's namespace, "
        "press/valve_{01..50} for fifty; empty = one valve, the namespace itself.",
    ),
    Spec(
        "model",
        Kind.STRING,
        DEFAULT_MODEL,
        "Valve model: a name of those in the sections below or one added by a package.",
    ),
    Spec(
        "period_s", Kind.FLOAT, 0.03, "Nominal sampling time of the position.", "s", 1e-6, 3600.0
    ),
    Spec(
        "hold_back_s",
        Kind.FLOAT,
        2.0,
        "Longest time, on the data's clock, by which a silent signal delays the others.",
        "s",
        0.0,
        3600.0,
    ),
    Spec(
        "topic_prefix",
        Kind.STRING,
        "",
        "Put before every signal's topic: /sim for a simulated valve, /replay for a replayed bag.",
    ),
    Spec(
        "history_url",
        Kind.STRING,
        DEFAULT_HISTORY,
        "Database of estimates: sqlite:///FILE or a PostgreSQL address.",
    ),
)


def signal_specs(signal: str, topic: str) -> tuple[Spec, ...]:
    """Return the parameters of one signal's mapping."""
    prefix = f"signals.{signal}."
    return (
        Spec(
            f"{prefix}topic",
            Kind.STRING,
            topic,
            "Topic, relative to the valve's name unless it begins with /"
            + ("; empty = not mapped." if not topic else "."),
        ),
        Spec(f"{prefix}type", Kind.STRING, STAMPED_TYPE, "Message type of the topic."),
        Spec(
            f"{prefix}field",
            Kind.STRING,
            "",
            "Field of the message: value, position[2], pose.position.x, values[] for "
            "batches; empty = value or values[].",
        ),
        Spec(
            f"{prefix}scale",
            Kind.FLOAT,
            1.0,
            "The signal is scale * field + offset.",
            "signal/field",
        ),
        Spec(
            f"{prefix}offset", Kind.FLOAT, 0.0, "The signal is scale * field + offset.", "signal"
        ),
        Spec(f"{prefix}lower", Kind.FLOAT, -math.inf, "Values below are not believed.", "signal"),
        Spec(f"{prefix}upper", Kind.FLOAT, math.inf, "Values above are not believed.", "signal"),
        Spec(
            f"{prefix}column",
            Kind.STRING,
            "",
            "Column of a CSV file: its name, or its number counted from 0.",
        ),
    )


_CYCLE_LIMITS = {
    "cycles.min_cycle_s": (0.0, math.inf),
    "cycles.max_cycle_s": (1e-3, math.inf),
    "cycles.idle_close_s": (1e-3, math.inf),
    "cycles.window_s": (1e-3, math.inf),
    "cycles.reference_hysteresis": (0.0, math.inf),
}


def valve_specs(model: ValveModel) -> tuple[Spec, ...]:
    """Return every parameter of a valve of this model, in the order of the reference."""
    signals: list[Spec] = []
    for name in model.inputs:
        signals += signal_specs(name, name if name == "command" else f"command/{name}")
    signals += signal_specs(model.output, model.output)
    for name in OPTIONAL_SIGNALS:
        signals += signal_specs(name, "")
    names = [p.name for p in model.parameters]
    return (
        *VALVE_SPECS,
        *signals,
        *_limited(dataclass_specs(CycleConfig, "cycles")),
        *descriptor_specs(option_descriptors(model, "options.")),
        *dataclass_specs(AgingConfig, "aging", names),
        *dataclass_specs(CsvConfig, "csv"),
    )


def _limited(specs: Sequence[Spec]) -> list[Spec]:
    limited = []
    for spec in specs:
        low, high = _CYCLE_LIMITS.get(spec.name, (spec.lower, spec.upper))
        limited.append(replace(spec, lower=low, upper=high))
    return limited


def load_config(path: str | Path, *, node: str = "twin", name: str = "") -> list[ValveConfig]:
    """Read the valves of a file as the node would that is started with it.

    Parameters
    ----------
    path : path
        YAML file of ROS 2 parameters.
    node : str
        Node whose sections count.
    name : str
        Name of the valve where the file gives none; empty = the file's name.

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
        s.namespace for s in sections if s.namespace is not None and s.pattern.endswith(f"/{node}")
    )
    configs: list[ValveConfig] = []
    for namespace in namespaces or {"/": None}:
        own = str(namespace)
        merged = _merge([s for s in sections if s.matches(f"{own.rstrip('/')}/{node}")])
        configs += parse_config(
            merged.values, str(path), namespace=own, fallback=name or path.stem, lines=merged.lines
        )
    _check_distinct(configs, str(path))
    return configs


def _merge(sections: Sequence[Section]) -> Section:
    merged = Section("/**")
    for section in sections:
        merged.values.update(section.values)
        merged.lines.update(section.lines)
    return merged


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

    def valves(self, flat: Mapping[str, object]) -> tuple[str, ...]:
        key = VALVE_SPECS[0].name
        try:
            given = VALVE_SPECS[0].check(flat.get(key, ()))
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
            known = {s.name.split(".", 1)[0] for s in VALVE_SPECS}
            if "/" in section and "." in key and section not in valves and section not in known:
                problem = f"there is no valve '{section}' in 'valves'; {suggest(section, valves)}"
                raise self._at(key, problem)

    def valve(
        self, name: str, values: Mapping[str, object], origin: Mapping[str, str]
    ) -> ValveConfig:
        model = self._model(values, origin)
        specs = {s.name: s for s in valve_specs(model)}
        checked: dict[str, object] = {s.name: s.default for s in specs.values()}
        simulation: dict[str, object] = {}
        for key, value in values.items():
            if key in specs:
                checked[key] = self._checked(specs[key], value, origin[key])
            elif key.startswith("simulation."):
                simulation[key.removeprefix("simulation.")] = value
            elif not _of_a_node(key):
                known = [*specs, *_node_keys()]
                raise self._at(origin[key], f"is unknown; {suggest(key, known)}")
        given = {k: v for k, v in checked.items() if k in values}
        return ValveConfig(
            name=name,
            model=model.name,
            period_s=_float(checked["period_s"]),
            hold_back_s=_float(checked["hold_back_s"]),
            signals=self._signals(name, model, checked, origin),
            cycles=self._cycles(given, model, checked, origin),
            options=self._options(model, given),
            aging=self._built(AgingConfig, "aging", given),
            history_url=str(checked["history_url"]),
            simulation=simulation,
            csv=self._built(CsvConfig, "csv", given),
        )

    def _model(self, values: Mapping[str, object], origin: Mapping[str, str]) -> ValveModel:
        key = origin.get("model", "model")
        name = self._checked(VALVE_SPECS[1], values.get("model", VALVE_SPECS[1].default), key)
        try:
            return get_model(str(name))
        except ValueError as err:
            raise self._at(key, str(err).removeprefix("model: ")) from None

    def _checked(self, spec: Spec, value: object, key: str) -> object:
        try:
            return spec.check(value)
        except ValueError as err:
            raise self._at(key, str(err)) from None

    def _signals(
        self,
        valve: str,
        model: ValveModel,
        checked: Mapping[str, object],
        origin: Mapping[str, str],
    ) -> dict[str, SignalSource]:
        sources: dict[str, SignalSource] = {}
        for signal in (*model.inputs, model.output, *OPTIONAL_SIGNALS):
            prefix = f"signals.{signal}."
            part = {key: checked[prefix + key] for key in ("topic", "type", "field", "column")}
            numbers = {
                key: _float(checked[prefix + key]) for key in ("scale", "offset", "lower", "upper")
            }
            topic_key = origin.get(prefix + "topic", prefix + "topic")
            if not part["topic"]:
                if signal not in OPTIONAL_SIGNALS:
                    raise self._at(topic_key, "is empty; write the topic that carries this signal")
                continue
            self._check_numbers(prefix, numbers, origin)
            try:
                type_name = full_type_name(str(part["type"]))
            except ValueError as err:
                raise self._at(origin.get(prefix + "type", prefix + "type"), str(err)) from None
            topic = resolve_topic(str(part["topic"]), valve, str(checked["topic_prefix"]))
            sources[signal] = SignalSource(
                signal=signal,
                topic=topic,
                type=type_name,
                field=str(part["field"]) or _default_field(type_name),
                column=str(part["column"]),
                **numbers,
            )
        return sources

    def _check_numbers(
        self, prefix: str, numbers: Mapping[str, float], origin: Mapping[str, str]
    ) -> None:
        for key in ("scale", "offset"):
            if not math.isfinite(numbers[key]) or (key == "scale" and numbers[key] == 0.0):
                full = prefix + key
                problem = (
                    f"value {numbers[key]!r} makes every sample useless; write a finite number"
                )
                raise self._at(
                    origin.get(full, full), problem + (" other than 0" if key == "scale" else "")
                )
        if not numbers["lower"] < numbers["upper"]:
            full = prefix + "lower"
            problem = (
                f"value {numbers['lower']!r} is not below upper = {numbers['upper']!r}; swap "
                "or widen them"
            )
            raise self._at(origin.get(full, full), problem)

    def _cycles(
        self,
        given: Mapping[str, object],
        model: ValveModel,
        checked: Mapping[str, object],
        origin: Mapping[str, str],
    ) -> CycleConfig:
        cycles: CycleConfig = build(CycleConfig, "cycles", given)
        for key in ("start_signal", "rearm_signal"):
            name = getattr(cycles, key)
            if name and name not in model.inputs:
                full = f"cycles.{key}"
                problem = (
                    f"'{name}' is no command of model '{model.name}'; "
                    f"{suggest(name, model.inputs)}"
                )
                raise self._at(origin.get(full, full), problem)
        if cycles.rule is CycleRule.COMMANDS and not model.inputs:
            problem = (
                f"'{cycles.rule.value}' needs a command and model '{model.name}' has none; write "
                "window, counter or reference"
            )
            raise self._at(origin.get("cycles.rule", "cycles.rule"), problem)
        if cycles.max_cycle_s <= cycles.min_cycle_s:
            full = "cycles.max_cycle_s"
            problem = (
                f"value {cycles.max_cycle_s!r} s is not above cycles.min_cycle_s = "
                f"{cycles.min_cycle_s!r} s; raise it"
            )
            raise self._at(origin.get(full, full), problem)
        needs = {CycleRule.COUNTER: "cycle_counter", CycleRule.REFERENCE: "reference"}
        signal = needs.get(cycles.rule)
        if signal and not checked[f"signals.{signal}.topic"]:
            problem = (
                f"'{cycles.rule.value}' needs the signal '{signal}'; write signals.{signal}.topic"
            )
            raise self._at(origin.get("cycles.rule", "cycles.rule"), problem)
        return cycles

    def _options(self, model: ValveModel, given: Mapping[str, object]) -> Options:
        part = {
            k.removeprefix("options."): v for k, v in given.items() if k.startswith("options.")
        }
        try:
            return complete_options(model, part)
        except ValueError as err:
            msg = f"{self._where}: {err}"
            raise ConfigError(msg) from None

    def _built(self, cls: type[T], prefix: str, given: Mapping[str, object]) -> T:
        try:
            built: T = build(cls, prefix, given)
        except ValueError as err:
            msg = f"{self._where}: section '{prefix}': {err}"
            raise ConfigError(msg) from None
        return built


def _default_field(type_name: str) -> str:
    if type_name == SERIES_TYPE:
        return "values[]"
    return "data" if type_name.startswith("std_msgs/") else "value"


def _float(value: object) -> float:
    assert isinstance(value, float)
    return value


def _node_keys() -> list[str]:
    return [s.name for specs in NODE_PARAMETERS.values() for s in specs]


def _of_a_node(key: str) -> bool:
    return key in _node_keys() or key in _ROS_OWN or key.startswith(_ROS_OWN_PREFIX)
