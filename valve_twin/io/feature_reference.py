# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The file of a stored reference of features: a line that seals it, and JSON to be read by all."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from valve_twin.core.diagnosis.given.judged import unusable
from valve_twin.core.diagnosis.given.reference import FeatureReference, Level, Product
from valve_twin.io.errors import ConfigError
from valve_twin.io.limits import CONSTRUCTORS_MEET
from valve_twin.io.sealed import seal
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    from valve_twin.core.valves.interface import ValveModel

MAGIC = b"valve_twin feature reference 1 "

_LARGEST = 1e100
"""Number beyond which none is one of a valve; its square is still one, assumed [unit of each]."""


def write_reference(reference: FeatureReference, path: str | Path) -> None:
    """Write a reference in the place of the file before, at once or not at all.

    Parameters
    ----------
    reference : FeatureReference
        What is written; it is named by the file.
    path : path
        The file.

    Raises
    ------
    OSError
        If the disk does not take it.
    """
    content = f"{json.dumps(_plain(reference), indent=1, allow_nan=False)}\n".encode()
    write_whole(path, seal(MAGIC, content) + content)


def read_reference(path: str | Path, model: ValveModel, period_s: float) -> FeatureReference:
    """Read a reference for a valve.

    Parameters
    ----------
    path : path
        The file.
    model : ValveModel
        The valve's model.
    period_s : float
        Sampling time of its position [s].

    Raises
    ------
    ConfigError
        One line that names the file and why it is no reference of this valve.
    """
    try:
        whole = Path(path).read_bytes()
    except OSError as err:
        raise _refused(path, f"cannot be read ({err.strerror})") from err
    line, _, content = whole.partition(b"\n")
    if not line.startswith(MAGIC):
        raise _refused(path, "is no stored reference of this version of valve_twin")
    if line + b"\n" != seal(MAGIC, content):
        raise _refused(path, "is damaged")
    found = _parsed(content, Path(path).name)
    if found is None:
        raise _refused(path, "holds values that no reference holds, or lacks some")
    if why := unusable(found, model, period_s):
        raise _refused(path, f"does not fit: {why}")
    return found


def _parsed(content: bytes, name: str) -> FeatureReference | None:
    """Return what was written, None where it is no reference."""
    try:
        found = _reference(json.loads(content), name)
        return found if _is_whole(found) else None
    except CONSTRUCTORS_MEET:
        return None


def _is_whole(found: FeatureReference) -> bool:
    """Return whether there are levels, as many values as features, and no number too large."""
    count = len(found.features)
    levels = [x for p in found.products for x in p.levels]
    spans = [(0.0, p.shortest_s, p.longest_s, _LARGEST) for p in found.products]
    rows = [*found.within, found.strays, *(row for x in levels for row in (x.values, x.moved))]
    models = [row for _, row in found.models]
    numbers = [v for row in (*rows, *models) for v in row if not math.isnan(v)]
    return (
        all(len(row) == count for row in rows)
        and len(found.within) == count > 0
        and all(math.isfinite(v) for row in (*found.within, found.strays) for v in row)
        and all(abs(v) < _LARGEST for v in numbers)
        and 0.0 < found.period_s < _LARGEST
        and (math.isnan(found.span) or 0.0 < found.span < _LARGEST)
        and all(list(span) == sorted(span) for span in spans)
        and bool(found.products)
        and all(p.levels and all(x.cycles > 0 for x in p.levels) for p in found.products)
    )


def _refused(path: str | Path, why: str) -> ConfigError:
    what = "write it by `valve-twin reference`, or leave aging.feature_reference empty"
    return ConfigError(f"{path}: {why}; {what}")


def _plain(reference: FeatureReference) -> dict[str, Any]:
    """Return a reference as values of JSON; what is not known is null."""
    names = reference.features
    between = reference.between()
    return {
        "model": reference.model,
        "version": reference.version,
        "period_s": reference.period_s,
        "span": _number(reference.span),
        "valves": list(reference.valves),
        "cycles": reference.cycles,
        "features": [
            {
                "name": name,
                "within": math.sqrt(max(reference.within[j][j], 0.0)),
                "between": _number(between[j]),
                "strays": reference.strays[j],
            }
            for j, name in enumerate(names)
        ],
        "covariance": [list(row) for row in reference.within],
        "products": [
            {
                "shortest_s": p.shortest_s,
                "longest_s": p.longest_s,
                "centre": dict(zip(names, map(_number, p.centre), strict=True)),
                "valves": [
                    {
                        "valve": x.valve,
                        "first": x.first,
                        "last": x.last,
                        "cycles": x.cycles,
                        "level": list(map(_number, x.values)),
                        "moved": list(map(_number, x.moved)),
                    }
                    for x in p.levels
                ],
            }
            for p in reference.products
        ],
        "models": {name: list(map(_number, values)) for name, values in reference.models},
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _known(values: list[float | None]) -> tuple[float, ...]:
    return tuple(math.nan if v is None else float(v) for v in values)


def _reference(plain: dict[str, Any], name: str) -> FeatureReference:
    """Return the reference that was written."""
    products = tuple(
        Product(
            p["shortest_s"],
            p["longest_s"],
            tuple(
                Level(
                    x["valve"],
                    x["first"],
                    x["last"],
                    x["cycles"],
                    _known(x["level"]),
                    _known(x["moved"]),
                )
                for x in p["valves"]
            ),
        )
        for p in plain["products"]
    )
    return FeatureReference(
        name=name,
        model=plain["model"],
        version=plain["version"],
        features=tuple(f["name"] for f in plain["features"]),
        period_s=plain["period_s"],
        within=tuple(tuple(row) for row in plain["covariance"]),
        strays=tuple(f["strays"] for f in plain["features"]),
        products=products,
        models=tuple((n, _known(values)) for n, values in plain["models"].items()),
        span=_known([plain.get("span")])[0],  # None in files of older versions
    )
