# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Designs as they may come from outside, given to `design`: numbers and regions in YAML, DXF.

They stand under no check sum, so that a number may be another one where its text was changed. What
is read has to be what another reader, which knows nothing but texts, finds in the file.
"""

from __future__ import annotations

import re
import time
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from test.io.foreign import LONGEST_S, mutations
from test.io.foreign_verbs import said
from valve_twin.core.quantity import describe
from valve_twin.design.geometry import (
    DoubleStroke,
    Region,
    Section,
    read_design,
    write_design,
    write_dxf,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from valve_twin.design.geometry.section import Outline

KINDS = ("numbers", "regions", "drawing")
_NUMBER = re.compile(r"[-+]?((\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|\.inf)")
_SECTION = """kind: section
box: {radius: 0.03, low: -0.03, high: 0.03}
motion: {radius: 0.006, still_radius: 0.008, low: 0.0105, high: 0.012, still_low: 0.01,
  still_high: 0.02, stroke: 0.0002}
materials:
  iron: {kind: steel}
  ring: {kind: magnet, remanence: 1.1, permeability: 1.05, direction: axial}
dxf: drawn.dxf
regions:
  - {name: core, material: iron, layer: core}
  - {name: coil, coil: A, turns: 120, layer: coil_a}
  - {name: armature, material: iron, outline_mm: [[0, 10.5], [6, 10.5], [6, 12], [0, 12]]}
  - {name: ring, material: ring, outline_mm: [[10, 11], [12, 11], [12, 12.5], [10, 12.5]]}
"""
_CORE = ((0.0, 0.0), (5e-3, 0.0), (5e-3, 9e-3), (0.0, 9e-3))
_COIL = ((6e-3, 1e-3), (9e-3, 1e-3), (9e-3, 8e-3), (6e-3, 8e-3))


def of_designs(kind: str, folder: Path, seed: int, count: int) -> list[str]:
    """Give mutated designs to `design geometry`; return a line for each that is not held.

    Parameters
    ----------
    kind : str
        What is mutated, one of `KINDS`.
    folder : path
        Empty; nothing else may stand in it in the end.
    seed, count : int
        Of the mutations.
    """
    rng = np.random.default_rng(seed)
    path, drawing = folder / "design.yaml", folder / "drawn.dxf"
    write_design(DoubleStroke(), path)
    if kind != "numbers":
        path.write_text(_SECTION, encoding="utf-8")
        _draw(drawing)
    changed = drawing if kind == "drawing" else path
    data = changed.read_bytes()
    if kind == "drawing":  # the rest is what every drawing begins with
        data = data[data.index(b"ENTITIES") - 20 :]
        head = drawing.read_bytes()[: -len(data)]
    else:
        head = b""
    before, wrong = sorted(folder.iterdir()), []
    for n, (how, mutated) in enumerate([("sound", data), *mutations(data, rng, count)]):
        changed.write_bytes(head + mutated)
        begin = time.process_time()
        code, text = said("design", "geometry", path)
        fine = code in (0, 1, 2) and "something unexpected" not in text and "Traceback" not in text
        fine &= code == 0 or n > 0
        fine &= not code or str(path) in text or (code == 1 and "must" in text)
        if not code:
            fine &= _same(path, drawing)
        fine &= time.process_time() - begin < LONGEST_S and sorted(folder.iterdir()) == before
        if not fine:
            wrong.append(f"{kind} seed {seed} case {n} ({how}): {code}: {text[-300:]}")
    return wrong


def _draw(path: Path) -> None:
    regions = (Region("core", "air", _CORE), Region("coil_a", "air", _COIL))
    write_dxf(Section("d", regions, {}, None, 0.03, -0.03, 0.03), path)


def _same(path: Path, drawing: Path) -> bool:
    """Return whether our reader finds what the texts say, each key once, each number plain."""
    found = read_design(path)
    try:
        texts = _plain(yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader))
        if not isinstance(found, Section):
            numbers = {d.name: d.default for d in describe(found)}
            return all(_equal(numbers.get(name), text) for name, text in _leaves(texts))
        layers = _layers(drawing)
        box = [_number(texts["box"][name]) for name in ("radius", "low", "high")]
        regions = [r for text in texts["regions"] for r in _regions(text, layers)]
    except (KeyError, ValueError, TypeError):
        return False
    ours = [(r.name, r.material, r.coil, r.turns, _mm(r.outline)) for r in found.regions]
    return box == [found.radius, found.low, found.high] and ours == regions


def _plain(node: Any) -> Any:
    """Return mappings, lists and texts as written; ValueError where a key stands twice."""
    if isinstance(node, yaml.MappingNode):
        keys = [key.value for key, _ in node.value]
        if len(set(keys)) < len(keys):
            raise ValueError
        return {key.value: _plain(value) for key, value in node.value}
    if isinstance(node, yaml.SequenceNode):
        return [_plain(value) for value in node.value]
    return node.value


def _leaves(texts: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, text in texts.items():
        if isinstance(text, dict):
            yield from _leaves(text, f"{prefix}{name}.")
        elif prefix or name != "kind":
            yield f"{prefix}{name}", text


def _equal(value: object, text: Any) -> bool:
    """Return whether a value is what its text says."""
    if isinstance(value, tuple):
        return list(value) == [_number(item) for item in text]
    if isinstance(value, (int, float)):
        return value == _number(text)
    return bool(value == text)


def _number(text: Any) -> float:
    if not isinstance(text, str) or not _NUMBER.fullmatch(text):
        raise ValueError
    return float(text)


def _regions(text: dict[str, Any], layers: dict[str, list[list[Any]]]) -> Iterator[Any]:
    """Yield the pieces of a region by the texts."""
    if "layer" in text:
        outlines = layers[text["layer"]]
    else:
        outlines = [[(_number(r), _number(z)) for r, z in text["outline_mm"]]]
    turns = _number(text.get("turns", "0"))
    for outline in outlines:
        yield (text["name"], text.get("material", "air"), text.get("coil", ""), turns, outline)


def _mm(outline: Outline) -> list[tuple[float, float]]:
    return [(round(1e3 * r, 9) + 0.0, round(1e3 * z, 9) + 0.0) for r, z in outline]


def _layers(path: Path) -> dict[str, list[list[Any]]]:
    """Read a drawing tag by tag: corners by layer, of each polyline as many as it claims [mm]."""
    lines = path.read_text(encoding="utf-8", errors="surrogateescape").split("\n")
    tags = [(c.strip(), v.strip()) for c, v in zip(lines[::2], lines[1::2], strict=False)]
    tags = tags[: tags.index(("0", "ENDSEC"), tags.index(("2", "ENTITIES")))]
    starts = [n for n, tag in enumerate(tags) if tag[0] == "0"]
    found: dict[str, list[list[Any]]] = {}
    for begin, end in pairwise([*starts, len(tags)]):
        held = tags[begin:end]
        if held[0][1] != "LWPOLYLINE":
            continue
        by_code = {code: [v for c, v in held if c == code] for code in ("8", "90", "10", "20")}
        r, z = ([round(float(v), 9) + 0.0 for v in by_code[code]] for code in ("10", "20"))
        if int(by_code["90"][0]) != len(r) or len(z) != len(r):
            raise ValueError
        found.setdefault(by_code["8"][0], []).append(list(zip(r, z, strict=True)))
    return found
