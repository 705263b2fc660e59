# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Declare parameters from the one table, take 1 for 1.0, name what nobody declared."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeVar, cast

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterUninitializedException
from rclpy.parameter import Parameter

from valve_twin.compat.ros import overrides_of
from valve_twin.core.quantity import Kind, describe, replaced, suggest
from valve_twin.io.config.node_parameters import NODE_PARAMETERS
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from _typeshed import DataclassInstance
    from rclpy.node import Node

    from valve_twin.core.quantity import Descriptor

T = TypeVar("T")

_FOREIGN = ("qos_overrides.", "use_sim_time", "start_type_description_service", "simulation.")
OF_VALVES = (
    *("valves", "model", "period_s", "hold_back_s", "topic_prefix", "history_url"),
    *("signals.", "cycles.", "options.", "aging.", "csv."),
)
_REMOTE = "allow_remote_configuration"
_CLOCK = "use_sim_time"  # of rclpy; who sets it stops a node whose clock nobody publishes
_AT_START = ("simulation.aging.", "simulation.scatter.")
_LARGEST = 2**62


class Parameters:
    """Parameters of a node by name, checked against their specs.

    Parameters
    ----------
    node : Node
        Where they are declared.
    is_idle : callable
        Whether a parameter that takes effect at configure may be changed now.
    """

    def __init__(self, node: Node, is_idle: Callable[[], bool]) -> None:
        self._node = node
        self._is_idle = is_idle
        self._specs: dict[str, Descriptor] = {}
        self._offered: dict[str, Descriptor] = {}
        self._errors: dict[str, str] = {}
        self.overrides: dict[str, object] = overrides_of(node)
        node.add_pre_set_parameters_callback(self._accept_integers)
        node.add_on_set_parameters_callback(self._check_set)

    def __getitem__(self, name: str) -> Any:
        """Return the present value; an empty list of numbers is no value to rclpy."""
        try:
            return self._node.get_parameter(name).value
        except ParameterUninitializedException:
            return []

    def read(self, table: type[T]) -> T:
        """Return the present values of a table of declared parameters."""
        found = describe(cast("type[DataclassInstance]", table))
        return replaced(table(), {d.name: d.check(_python_value(self[d.name])) for d in found})

    def declare(self, specs: Iterable[Descriptor]) -> None:
        """Declare what is not declared yet; a wrong override is kept as an error for `check`."""
        for spec in specs:
            if spec.name in self._specs:
                continue
            value, problem = spec.default, ""
            if spec.name in self.overrides:
                try:
                    value = spec.check(self.overrides[spec.name])
                except ValueError as err:
                    problem = f"parameter '{spec.name}': {err}"
            self._specs[spec.name] = spec
            self._node.declare_parameter(
                spec.name, _ros_value(spec, value), _descriptor(spec), ignore_override=True
            )
            if problem:
                self._errors[spec.name] = problem

    def offer(self, specs: Iterable[Descriptor]) -> None:
        """Declare of many parameters those that were given; the others once they are set.

        A file or a caller may set each by its name; a list of all parameters stays readable.
        """
        specs = list(specs)
        self.declare(s for s in specs if s.name in self.overrides)
        self._offered |= {s.name: s for s in specs}

    def declare_offered(self, names: Iterable[str]) -> None:
        """Declare what is about to be set."""
        self.declare(self._offered[name] for name in names if name in self._offered)

    def check(self) -> None:
        """Raise for the first override of a wrong type or outside its limits.

        Raises
        ------
        ConfigError
            Naming parameter, value and remedy.
        """
        for message in self._errors.values():
            msg = f"{self._node.get_fully_qualified_name()}: {message}"
            raise ConfigError(msg)

    def take_errors(self, section: str) -> list[str]:
        """Return what is wrong with the overrides of a section, which `check` then passes over."""
        names = [name for name in self._errors if name.startswith(section)]
        return [self._errors.pop(name) for name in names]

    def given(self) -> dict[str, object]:
        """Return what was set from outside: declared overrides and values that are no default."""
        return {
            name: _python_value(self[name])
            for name, spec in self._specs.items()
            if name in self.overrides or not _same(_python_value(self[name]), spec.default)
        }

    def warn_unknown(self, *, hosts_valves: bool) -> None:
        """Log one line for every override that no node declares, with the nearest name.

        A node that hosts no valves may be started with the file of one: the valve's keys are not
        its business.
        """
        others = {s.name for table in NODE_PARAMETERS.values() for s in table}
        foreign = _FOREIGN if hosts_valves else (*_FOREIGN, *OF_VALVES)
        for name in sorted(self.overrides):
            if name in self._specs or name in others or name.startswith(foreign):
                continue
            self._node.get_logger().warning(
                f"parameter '{name}' is unknown and has no effect: {suggest(name, self._known())}"
            )

    def _known(self) -> list[str]:
        return list(self._specs | self._offered)

    def unknown(self, names: Iterable[str]) -> str:
        """Return in one line which of the names is no parameter of this node and what to do."""
        name = next((n for n in names if not self._node.has_parameter(n)), "")
        if name.startswith(_AT_START):
            return (
                f"'{name}' is read at start only: start the node with it, or call "
                "simulated_valve/set_aging to change the aging of a running valve"
            )
        return f"'{name}' is no parameter of this node: {suggest(name, self._known())}"

    def _accept_integers(self, parameters: list[Parameter]) -> list[Parameter]:
        """Take 1 for 1.0 where a number is meant."""
        return [self._as_declared(p) for p in parameters]

    def _as_declared(self, parameter: Parameter) -> Parameter:
        spec = self._specs.get(parameter.name)
        if (
            spec is not None
            and spec.kind is Kind.FLOAT
            and parameter.type_ == Parameter.Type.INTEGER
        ):
            return Parameter(parameter.name, Parameter.Type.DOUBLE, float(parameter.value))
        return parameter

    def _check_set(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            spec = self._specs.get(parameter.name)
            declared = self._node.has_parameter(parameter.name)
            local = spec.local if spec is not None else parameter.name == _CLOCK
            if local and declared and not self[_REMOTE]:
                if self._node.get_parameter(parameter.name).value == parameter.value:
                    continue  # as of a file of all that the node has
                reason = (
                    f"'{parameter.name}' takes effect at the start and is not changed from afar: "
                    f"give it when the node is started, or start it with {_REMOTE}"
                )
                return SetParametersResult(successful=False, reason=reason)
            if spec is None:
                continue
            if spec.read_only and not self._is_idle() and declared:
                reason = f"'{spec.name}' takes effect at configure: clean up the node, then set it"
                return SetParametersResult(successful=False, reason=reason)
            try:
                spec.check(_python_value(parameter.value))
            except ValueError as err:
                return SetParametersResult(successful=False, reason=f"'{spec.name}': {err}")
            self._errors.pop(spec.name, None)
        return SetParametersResult(successful=True)


def _same(value: object, default: object) -> bool:
    """Compare a value with a default; NaN is NaN, and an empty list is written as [""]."""
    if isinstance(value, list):
        return bool([v for v in value if v != ""] == list(default))  # type: ignore[call-overload]
    if isinstance(value, float) and isinstance(default, float) and math.isnan(value):
        return math.isnan(default)
    return bool(value == default)


def _python_value(value: object) -> object:
    if isinstance(value, (str, bytes, bool, int, float)):
        return value
    return [] if value is None else list(value)  # type: ignore[call-overload]


def _ros_value(spec: Descriptor, value: object) -> object:
    """Give an empty list the type it needs."""
    if spec.kind is Kind.STRINGS:
        return list(value) or [""]  # type: ignore[call-overload]
    if spec.kind is Kind.FLOATS:
        numbers = [float(v) for v in value]  # type: ignore[attr-defined]
        return numbers or Parameter.Type.DOUBLE_ARRAY
    if spec.kind is Kind.FLOAT:
        return float(value)  # type: ignore[arg-type]
    return value


def _descriptor(spec: Descriptor) -> ParameterDescriptor:
    unit = f" [{spec.unit}]" if spec.unit else ""
    choices = f"One of {', '.join(spec.choices)}." if spec.choices else ""
    descriptor = ParameterDescriptor(
        description=f"{spec.description}{unit}", additional_constraints=choices
    )
    if not (math.isfinite(spec.lower) or math.isfinite(spec.upper)):
        return descriptor
    if spec.kind is Kind.FLOAT and not math.isnan(float(spec.default)):  # type: ignore[arg-type]
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(spec.lower), to_value=float(spec.upper))
        ]
    if spec.kind is Kind.INT:
        descriptor.integer_range = [
            IntegerRange(
                from_value=int(max(spec.lower, -_LARGEST)), to_value=int(min(spec.upper, _LARGEST))
            )
        ]
    return descriptor
