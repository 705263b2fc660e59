# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Look at the parameter files of a node's command line before ROS does: one line, no traceback.

ROS tells neither which file lacks what, nor that a file is for another node: that one then runs
on defaults.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.config.parameter_file import read_parameter_file
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Sequence

_FILE = "--params-file"
_REMAPS = {"-r", "--remap"}
_NAMESPACES, _NAMES = {"__ns"}, {"__node", "__name"}


def check_arguments(name: str, arguments: Sequence[str]) -> str:
    """Read the parameter files of a command line; return a warning, empty where all is well.

    Parameters
    ----------
    name : str
        Name of the node where the command line gives it no other.
    arguments : sequence of str
        The command line, without the program.

    Raises
    ------
    ConfigError
        If a file cannot be read, or all files are for other nodes and this one, a twin, would run
        on defaults: one line.
    """
    node = _full_name(name, arguments)
    warnings = []
    files = [value for option, value in pairwise(arguments) if option == _FILE]
    for path in files:
        sections = read_parameter_file(Path(path))
        if any(section.matches(node) for section in sections):
            continue
        patterns = ", ".join(s.pattern for s in sections)
        msg = (
            f"{path}: holds nothing for {node}, only for {patterns}: start the node under that "
            "name (-r __ns:=NAMESPACE), or begin the file with '/**:'"
        )
        warnings.append(msg)
    if name == "twin" and files and len(warnings) == len(files):
        raise ConfigError("; ".join(warnings))
    return "; ".join(warnings)


def _full_name(name: str, arguments: Sequence[str]) -> str:
    """Return the node's name with its namespace."""
    namespace = "/"
    for option, value in pairwise(arguments):
        key, given, new = value.partition(":=")
        if option not in _REMAPS or not given:
            continue
        key = key.rpartition(":")[2]  # NODE:__ns:=... is for one node
        if key in _NAMESPACES:
            namespace = new
        elif key in _NAMES:
            name = new
    return f"{namespace.rstrip('/')}/{name}"
