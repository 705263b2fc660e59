# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The design that every step takes: a file and numbers that replace its own."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import say
from valve_twin.io.errors import ConfigError
from valve_twin.io.limits import load_yaml

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Mapping

    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.design.geometry import DoubleStroke, HybridPole, Section
    from valve_twin.design.map import MapGrid
    from valve_twin.design.search.archive import Archive


def add_design(
    parser: argparse.ArgumentParser, default: str = "a double-stroke solenoid of size 6"
) -> None:
    """Add the design as arguments; `default` says what is taken where none is named."""
    text = f"YAML of the design, default {default}"
    parser.add_argument("design", nargs="?", metavar="DESIGN", help=text)
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="a number of the design"
    )


def add_form(parser: argparse.ArgumentParser, default: str = "eddies") -> None:
    """Add what stands beside the static curves; `default` is one of `FORMS`."""
    parser.add_argument(
        "--dynamics", metavar="FORM", default=default,
        help=f"beside static curves, default {default}: eddies (two branches of eddy currents a "
        "coil), growing (such whose gains grow with the current, fitted to steps in the moving "
        "field: nearer to it, 10 s more) or second_order (G_A and G_F)",
    )  # fmt: skip


def read_given(
    arguments: argparse.Namespace, kind: str = "double_stroke"
) -> DoubleStroke | HybridPole | Section:
    """Return the design of the arguments.

    Parameters
    ----------
    arguments : argparse.Namespace
        Of `add_design`.
    kind : str
        Of the design where no file is named.

    Raises
    ------
    ConfigError
        Names the file, the number, its value and what is allowed.
    """
    require("ezdxf", "skfem")
    from valve_twin.design.geometry import read_design

    changes: dict[str, object] = {}
    for text in arguments.set:
        name, equals, value = text.partition("=")
        if not equals:
            msg = f"--set {text}: write NAME=VALUE"
            raise ConfigError(msg)
        if name in changes:
            msg = f"--set {text}: {name} is set twice"
            raise ConfigError(msg)
        changes[name] = _value(value)
    with refusals():
        path = Path(arguments.design) if arguments.design else None
        return read_design(path, changes, kind)


def _value(text: str) -> object:
    """Return a value of --set; 2e-3, which YAML takes for a text, is a number."""
    found: object = load_yaml(text)
    if isinstance(found, str):
        with suppress(ValueError):
            return float(found)
    return found


def read_double_stroke(arguments: argparse.Namespace) -> DoubleStroke:
    """Return the design of the arguments, which has to be a double-stroke solenoid.

    Raises
    ------
    ConfigError
        As `read_given`; or if it is another section.
    """
    from valve_twin.design.geometry import DoubleStroke

    design = read_given(arguments)
    if not isinstance(design, DoubleStroke):
        msg = f"{arguments.design}: kind must be double_stroke: a valve takes no other solenoid"
        raise ConfigError(msg)
    return design


def section_of(design: DoubleStroke | HybridPole | Section) -> Section:
    """Return what the field is computed of.

    Raises
    ------
    ValueError
        If a restriction is broken.
    """
    from valve_twin.design.geometry import Section

    return design if isinstance(design, Section) else design.section()


@contextmanager
def refusals(of: str | None = None) -> Iterator[None]:
    """Turn what the design refuses into a line of the command.

    Parameters
    ----------
    of : str, optional
        File that it stands in, which the line begins with.

    Raises
    ------
    ConfigError
        Says what the design said.
    """
    try:
        yield
    except ValueError as err:
        msg = f"{of}: {err}" if of else str(err)
        raise ConfigError(msg) from err


def grid_of(design: DoubleStroke | HybridPole | Section, given: Mapping[str, float]) -> MapGrid:
    """Return where the fields of a design's map are computed.

    Parameters
    ----------
    design : DoubleStroke, HybridPole or Section
        The design; a double-stroke solenoid says by its power how far the currents go.
    given : mapping
        Numbers of the grid [their units].

    Raises
    ------
    ValueError
        If a number is outside its range.
    """
    from valve_twin.design.chain import reaching
    from valve_twin.design.geometry import DoubleStroke
    from valve_twin.design.map import MapGrid

    grid = MapGrid(**given)  # type: ignore[arg-type]
    if isinstance(design, DoubleStroke) and "largest_current" not in given:
        return reaching(grid, design)
    return grid


def read_map_of(path: str, design: DoubleStroke | HybridPole | Section) -> CoenergyMap:
    """Read a map, and say what in it is not as `design map` would compute it now.

    Parameters
    ----------
    path : str
        The file.
    design : DoubleStroke, HybridPole or Section
        Of which it has to be.

    Raises
    ------
    ValueError
        If it is none of this design.
    """
    from valve_twin.design.map import read_map, unlike

    found = read_map(Path(path))
    other = unlike(found, section_of(design), grid_of(design, {}))
    if other:
        say(f"{path}: made with {', '.join(other)}")
    return found


@contextmanager
def archive_at(path: Path, design: DoubleStroke, valve: str) -> Iterator[Archive]:
    """Open an archive of evaluated designs that no other run uses meanwhile.

    Parameters
    ----------
    path : Path
        The file; made where it is missing.
    design : DoubleStroke
        What its designs are changes of.
    valve : str
        Model of the valve, empty = the first that takes a design.

    Raises
    ------
    ConfigError
        If it is none of this design, or another run uses it.
    """
    from valve_twin.design.search.archive import Archive, header_of
    from valve_twin.io.bags.file import held

    with ExitStack() as stack:
        try:
            stack.enter_context(held(path))
        except BlockingIOError as err:
            msg = f"{path}: another run works on this archive: wait for it or name another file"
            raise ConfigError(msg) from err
        with refusals():
            archive = Archive(path, header_of(design, valve))
        yield archive


def require(*modules: str) -> None:
    """Say what to install where a package of the extra is missing.

    Raises
    ------
    ConfigError
        Names the package.
    """
    from importlib.util import find_spec

    for module in modules:
        if find_spec(module) is None:
            msg = (
                f"design: the package '{module}' is not installed; "
                "python -m pip install 'valve_twin[design]'"
            )
            raise ConfigError(msg)
