# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Designs in YAML: double-stroke solenoid and hybrid pole by their numbers, others by regions."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from valve_twin.core.quantity import checked, describe, example, replaced, suggest
from valve_twin.core.quantity.names import ODD_NUMBER
from valve_twin.design.geometry.double_stroke import DoubleStroke
from valve_twin.design.geometry.dxf import read_dxf
from valve_twin.design.geometry.hybrid_pole import HybridPole
from valve_twin.design.geometry.section import Motion, Region, Section
from valve_twin.design.materials import Linear, Magnet, Material, Steel

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.design.geometry.section import Outline

_KINDS: dict[str, type[Material]] = {"linear": Linear, "magnet": Magnet, "steel": Steel}
_NUMBERED: dict[str, type[DoubleStroke | HybridPole]] = {
    "double_stroke": DoubleStroke,
    "hybrid_pole": HybridPole,
}
"""Solenoids that are described by their numbers, by kind."""

_MM = 1e-3
_DEEPEST = 8  # levels of a design's YAML
_LONGEST = 1 << 18  # characters of one; the longest of ours has 3000
_BOX = ("radius", "low", "high")
_TEXTS = (("material", "air"), ("coil", ""))  # of a region, with what is usual


class _Loader(yaml.SafeLoader):
    """Takes each key once and each number as people read it."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return a mapping; a key that stands twice is refused."""
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue  # no key at all, as is said below
            line = key.start_mark.line + 1
            if key.value in lines:
                why = f"'{key.value}' stands twice, in lines {lines[key.value]} and {line}"
                raise yaml.constructor.ConstructorError(problem=why)
            lines[key.value] = line
        return super().construct_mapping(node, deep)

    def number(self, node: yaml.ScalarNode) -> float:
        """Return a number; one that people read otherwise than YAML does is refused."""
        whole = node.tag.endswith(":int")
        line = node.start_mark.line + 1
        try:
            value = self.construct_yaml_int(node) if whole else self.construct_yaml_float(node)
            float(value)
        except OverflowError:
            why = f"line {line}: a number beyond 1e308"
            raise yaml.constructor.ConstructorError(problem=why) from None
        if ODD_NUMBER.fullmatch(node.value):
            why = f"line {line}: '{node.value}' is {value} to YAML; write {value}"
            raise yaml.constructor.ConstructorError(problem=why)
        return value


_Loader.add_implicit_resolver(  # 1e-7 and 2e-3 are texts to YAML 1.1
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"),
    list("-+0123456789"),
)
for _tag in ("int", "float"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_tag}", _Loader.number)


def read_design(
    path: Path | None, changes: Mapping[str, object] | None = None, kind: str = "double_stroke"
) -> DoubleStroke | HybridPole | Section:
    """Read a design.

    Parameters
    ----------
    path : Path or None
        YAML file; None = the solenoid of `kind` with its defaults.
    changes : mapping, optional
        Numbers in place of those of the file, by dotted name [SI].
    kind : str
        double_stroke or hybrid_pole.

    Raises
    ------
    ValueError
        Names the key, its value and what to write.
    """
    if path is None:
        return _numbered(kind, changes or {})
    given = _read_yaml(path)
    try:
        return _design(given, path.parent, changes or {})
    except ValueError as err:
        message = f"{path}: {err}"
        raise ValueError(message) from err


def _design(
    given: dict[str, object], folder: Path, changes: Mapping[str, object]
) -> DoubleStroke | HybridPole | Section:
    kind = given.pop("kind", None)
    if isinstance(kind, str) and kind in _NUMBERED:
        return _numbered(kind, {**_flat(given), **changes})
    if kind != "section":
        message = f"kind = {kind!r}: must be {', '.join(_NUMBERED)} or section"
        raise ValueError(message)
    if changes:
        message = f"'{next(iter(changes))}' cannot be set: edit the regions"
        raise ValueError(message)
    return _section(given, folder)


def write_design(
    design: DoubleStroke | HybridPole,
    path: Path,
    write: Callable[[Path, bytes], object] = Path.write_bytes,
) -> None:
    """Write the numbers of a design with what they are.

    Parameters
    ----------
    design : DoubleStroke or HybridPole
        What is written.
    path : Path
        YAML file.
    write : callable
        Puts bytes into a file.
    """
    lines = [f"kind: {next(k for k, of in _NUMBERED.items() if isinstance(design, of))}"]
    for item in describe(design):
        unit = f" [{item.unit}]" if item.unit else ""
        value = example(item.default) if item.default else ("0.0" if item.default == 0.0 else "[]")
        lines.append(f"{item.name}: {value}  # {item.description}{unit}")
    write(path, ("\n".join(lines) + "\n").encode())


def _read_yaml(path: Path) -> dict[str, object]:
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(_LONGEST + 1)
        _check_plain(text)
        found = yaml.load(text, Loader=_Loader)  # a safe one
    except (OSError, ValueError, yaml.YAMLError) as err:
        message = f"{path}: cannot be read ({' '.join(str(err).split())})"
        raise ValueError(message) from err
    if not isinstance(found, dict):
        message = f"{path}: holds no 'key: value' lines; the first is kind: double_stroke"
        raise ValueError(message)
    return {str(key): value for key, value in found.items()}


def _check_plain(text: str) -> None:
    """Refuse what no design holds, before a parser calls itself as deep as the text says."""
    if len(text) > _LONGEST:
        message = f"longer than {_LONGEST >> 10} kB, which no design is; give outlines as dxf"
        raise ValueError(message)
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        line = event.start_mark.line + 1 if event.start_mark else 1
        if depth > _DEEPEST:
            message = f"line {line}: nested deeper than {_DEEPEST} levels"
            raise ValueError(message)
        if isinstance(event, yaml.AliasEvent):
            message = f"line {line}: *{event.anchor} repeats a value; write it out"
            raise ValueError(message)
        if isinstance(event, yaml.NodeEvent) and getattr(event, "tag", None):
            message = f"line {line}: a tag, as !!int, which no design needs; write the value alone"
            raise ValueError(message)


def _flat(given: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in given.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = value
    return found


def _numbered(kind: str, given: Mapping[str, object]) -> DoubleStroke | HybridPole:
    node = _NUMBERED[kind]()
    return replaced(node, _checked(node, given))


def _checked(
    node: DoubleStroke | HybridPole | Material, given: Mapping[str, object]
) -> dict[str, object]:
    """Return the values of known names in their types; ranges are told by who uses them."""
    return checked(node, given, unknown="no such number")


def _section(given: dict[str, object], folder: Path) -> Section:
    """Return a section from its mapping."""
    allowed = ("name", "box", "motion", "materials", "regions", "dxf")
    for key in given:
        if key not in allowed:
            message = f"'{key}' is no such key; {suggest(key, allowed)}"
            raise ValueError(message)
    box = _numbers(given.get("box"), "box", _BOX)
    motion = given.get("motion")
    moves = None
    if motion is not None:
        names = tuple(f.name for f in fields(Motion))
        moves = Motion(**_numbers(motion, "motion", names))
    drawing = read_dxf(folder / str(given["dxf"])) if "dxf" in given else {}
    regions = given.get("regions")
    if not isinstance(regions, list) or not regions:
        message = "regions: must be a list of regions, each with name, material and outline_mm"
        raise ValueError(message)
    pieces = [piece for item in regions for piece in _regions(item, drawing)]
    materials = _materials(given.get("materials", {}))
    name = _text(given.get("name", "section"), "name")
    radius, low, high = (box[n] for n in _BOX)
    return Section(name, tuple(pieces), materials, moves, radius, low, high)


def _materials(given: object) -> dict[str, Material]:
    found: dict[str, Material] = {}
    if not isinstance(given, dict):
        message = "materials: must be a mapping of names"
        raise ValueError(message)
    for name, values in given.items():
        numbers = dict(values) if isinstance(values, dict) else {}
        kind = str(numbers.pop("kind", ""))
        if kind not in _KINDS:
            message = f"materials.{name}.kind = '{kind}': must be one of {', '.join(_KINDS)}"
            raise ValueError(message)
        try:
            found[str(name)] = _KINDS[kind](**_checked(_KINDS[kind](), numbers))  # type: ignore[arg-type]
        except ValueError as err:
            message = f"materials.{name}: {err}"
            raise ValueError(message) from err
    return found


def _regions(item: object, drawing: Mapping[str, list[Outline]]) -> list[Region]:
    """Return the pieces of one entry; a layer of a drawing may hold several."""
    if not isinstance(item, dict) or "name" not in item:
        message = f"regions: {item!r} is no region; each has name, material, outline_mm or layer"
        raise ValueError(message)
    name = _text(item["name"], "regions: name")
    known = {"name", "material", "outline_mm", "layer", "coil", "turns"}
    for key in item:
        if key not in known:
            message = f"regions: '{name}.{key}' is no such key; {suggest(key, known)}"
            raise ValueError(message)
    if "layer" in item:
        outlines = drawing.get(str(item["layer"]), [])
        if not outlines:
            layers = ", ".join(sorted(drawing)) or "none: give dxf: FILE"
            message = f"{name}: there is no layer '{item['layer']}'; there are {layers}"
            raise ValueError(message)
    else:
        outlines = [_outline(name, item.get("outline_mm"))]
    try:
        turns = _number(item.get("turns", 0.0))
    except (TypeError, ValueError):
        message = f"{name}: turns = {item['turns']!r}: must be a number"
        raise ValueError(message) from None
    material, coil = (_text(item.get(key, usual), f"{name}.{key}") for key, usual in _TEXTS)
    return [Region(name, material, outline, coil, turns) for outline in outlines]


def _outline(name: str, given: object) -> Outline:
    try:
        corners = tuple((_number(r) * _MM, _number(z) * _MM) for r, z in given)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        message = f"{name}: outline_mm = {given!r}: must be a list of [r, z]"
        raise ValueError(message) from None
    return corners


def _number(given: object) -> float:
    """Return a number; 2e-3, which YAML takes for a text, is one."""
    if isinstance(given, bool) or not isinstance(given, (int, float, str)):
        raise TypeError
    if isinstance(given, str) and "_" in given:  # to Python 1_0 is 10
        raise ValueError
    return float(given)


def _text(given: object, owner: str) -> str:
    """Return a name; a number may be one."""
    if isinstance(given, bool) or not isinstance(given, (int, float, str)):
        message = f"{owner} = {given!r}: must be a text"
        raise ValueError(message)
    return str(given)


def _numbers(given: object, owner: str, names: tuple[str, ...]) -> dict[str, float]:
    """Return the numbers of a mapping that needs all of them."""
    values = given if isinstance(given, dict) else {}
    for name in names:
        value = values.get(name)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            message = f"{owner}.{name} = {value!r}: must be a number [m]"
            raise ValueError(message)
    for key in values:
        if key not in names:
            message = f"'{owner}.{key}' is no such key; {suggest(str(key), names)}"
            raise ValueError(message)
    return {name: float(values[name]) for name in names}
