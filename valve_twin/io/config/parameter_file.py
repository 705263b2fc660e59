# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read a ROS 2 parameter file without ROS: sections by node pattern, dotted names, lines."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import yaml

from valve_twin.core.quantity.names import ODD_NUMBER
from valve_twin.io.errors import ConfigError
from valve_twin.io.limits import CONSTRUCTORS_MEET, check_yaml

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

WRAPPER = "ros__parameters"
_LIST = "tag:yaml.org,2002:seq"


class _OddNumberError(Exception):
    """A number that people read otherwise than YAML does."""


@dataclass(frozen=True, slots=True)
class Section:
    """Parameters of the nodes that a pattern matches.

    Attributes
    ----------
    pattern : str
        Such as "/**", "/press/valve_1/twin" or "/**/twin".
    values : dict
        Values by full dotted name.
    lines : dict
        Line in the file by full dotted name.
    """

    pattern: str
    values: dict[str, object] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)

    def matches(self, node: str) -> bool:
        """Return whether a fully qualified node name takes these parameters."""
        parts = [
            ".*" if p == "**" else "[^/]*" if p == "*" else re.escape(p)
            for p in _parts(self.pattern)
        ]
        expression = "".join("(/.*)?" if p == ".*" else f"/{p}" for p in parts)
        return re.fullmatch(expression, node) is not None

    @property
    def namespace(self) -> str | None:
        """Namespace of a fully qualified pattern, None of one with wildcards."""
        parts = _parts(self.pattern)
        return None if any("*" in p for p in parts) else "/" + "/".join(parts[:-1])


def merged(sections: Iterable[Section]) -> Section:
    """Return sections as one: what comes later counts."""
    whole = Section("/**")
    for section in sections:
        whole.values.update(section.values)
        whole.lines.update(section.lines)
    return whole


def _parts(pattern: str) -> list[str]:
    return [p for p in pattern.split("/") if p]


def read_parameter_file(path: Path) -> list[Section]:
    """Read the sections of a parameter file in their order.

    Raises
    ------
    ConfigError
        If the file cannot be read, is no YAML, holds a key twice or lacks the wrapper that nodes
        need.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        msg = f"{path}: there is no such file; give the path of a YAML file as in config/"
        raise ConfigError(msg) from None
    except (OSError, UnicodeDecodeError) as err:
        msg = f"{path}: cannot be read ({err}); give a YAML file in UTF-8 that you may read"
        raise ConfigError(msg) from err
    try:
        sections = _read_sections(text, path)
    except (yaml.YAMLError, *CONSTRUCTORS_MEET) as err:
        msg = f"{path}: is not valid YAML ({_one_line(err)}); fix that line"
        raise ConfigError(msg) from err
    if not sections:
        msg = (
            f"{path}: no section with '{WRAPPER}:'; write '/**:' in the first line, '  "
            f"{WRAPPER}:' in the second "
            "and the parameters indented below"
        )
        raise ConfigError(msg)
    return sections


def _read_sections(text: str, path: Path) -> list[Section]:
    check_yaml(text)
    loader = yaml.SafeLoader(text)
    try:
        root = loader.get_single_node()
        return list(_sections(loader, root, "", path)) if root is not None else []
    finally:
        loader.dispose()


def _sections(
    loader: yaml.SafeLoader, node: yaml.Node, name: str, path: Path
) -> Iterator[Section]:
    if not isinstance(node, yaml.MappingNode):
        return
    for key, value in node.value:
        if name and not isinstance(value, yaml.MappingNode) and key.value != WRAPPER:
            parent = name.strip("/")
            msg = (
                f"{path}:{key.start_mark.line + 1}: key '{key.value}' below '{parent}' stands "
                f"outside '{WRAPPER}:' and no node reads it; indent it below '{WRAPPER}:'"
            )
            raise ConfigError(msg)
        if key.value == WRAPPER:
            section = Section("/" + name.strip("/"))
            _flatten(loader, value, "", section, path)
            yield section
        else:
            yield from _sections(loader, value, f"{name}/{str(key.value).strip('/')}", path)


def _flatten(
    loader: yaml.SafeLoader, node: yaml.Node, prefix: str, out: Section, path: Path
) -> None:
    if not isinstance(node, yaml.MappingNode):
        msg = (
            f"{path}:{node.start_mark.line + 1}: '{WRAPPER}' holds no keys; write 'key: "
            "value' lines below it"
        )
        raise ConfigError(msg)
    for key, value in node.value:
        name = f"{prefix}{key.value}"
        line = key.start_mark.line + 1
        if isinstance(value, yaml.MappingNode):
            if not value.value:
                msg = f"{path}:{line}: key '{name}' holds no value; write one or remove the key"
                raise ConfigError(msg)
            _flatten(loader, value, f"{name}.", out, path)
            continue
        if name in out.values:
            msg = (
                f"{path}:{line}: key '{name}' stands twice, first in line {out.lines[name]}; "
                "remove one"
            )
            raise ConfigError(msg)
        try:
            out.values[name] = _value(loader, value)
        except _OddNumberError as err:
            msg = f"{path}:{line}: key '{name}': {err}"
            raise ConfigError(msg) from None
        out.lines[name] = line


def _value(loader: yaml.SafeLoader, node: yaml.Node) -> object:
    if isinstance(node, yaml.SequenceNode) and node.tag == _LIST:
        return [_value(loader, item) for item in node.value]
    value = loader.construct_object(node)
    if (
        isinstance(value, (int, float))
        and isinstance(node, yaml.ScalarNode)
        and ODD_NUMBER.fullmatch(node.value)
    ):
        msg = f"'{node.value}' is {value} to YAML; write {value}, or '\"{node.value}\"' for a text"
        raise _OddNumberError(msg)
    if isinstance(value, str) and isinstance(node, yaml.ScalarNode) and node.style is None:
        return _ros_number(value)
    return value


def _ros_number(text: str) -> object:
    """Read a plain '1e-3' as the number that ROS sees; YAML 1.1 alone takes it for text."""
    if not re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+", text):
        return text
    return float(text)


def _one_line(err: Exception) -> str:
    mark = getattr(err, "problem_mark", None)
    problem = getattr(err, "problem", None) or str(err)
    where = f"line {mark.line + 1}: " if mark is not None else ""
    return where + " ".join(str(problem).split())
