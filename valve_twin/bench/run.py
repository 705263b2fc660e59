# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Run all comparisons, one line each, beside what was measured when it was committed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from valve_twin.bench.data import archive, reading, storing, writing
from valve_twin.bench.measure import Ratio, Scale, describe, median
from valve_twin.bench.models import estimation, recursion, simulation, solenoid

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence


def _nodes(scale: Scale) -> Iterator[Ratio]:
    """Compare nodes; the rest needs no ROS."""
    from valve_twin.bench.nodes import live

    return live.compare(scale)


AREAS = {
    "simulation": simulation.compare,
    "estimation": estimation.compare,
    "recursion": recursion.compare,
    "solenoid": solenoid.compare,
    "archive": archive.compare,
    "reading": reading.compare,
    "writing": writing.compare,
    "storing": storing.compare,
    "nodes": _nodes,
}
"""What is compared, by the name that `valve-twin bench NAME` takes."""

COMMITTED = Path(__file__).parent / "committed.yaml"


def run_benchmarks(
    *, quick: bool, write: Callable[[str], object], areas: Sequence[str] = ()
) -> bool:
    """Run comparisons and print one line each.

    Parameters
    ----------
    quick : bool
        Smaller inputs and fewer repetitions: seconds instead of minutes.
    write : callable
        Takes the text.
    areas : sequence of str
        Names of `AREAS`; empty = all.

    Returns
    -------
    bool
        Whether every ratio reaches half its goal.
    """
    scale = Scale(quick, 5 if quick else 15)
    loop = median(lambda: sum(range(1_000_000)), scale.repeats)
    write(f"reference loop (Python sum over 1e6 numbers): {loop * 1e3:.1f} ms\n")
    committed = committed_ratios("quick" if quick else "full")
    passed = True
    for ratio in _comparisons(scale, areas):
        write(f"{describe(ratio, committed.get(ratio.name))}\n")
        passed = passed and ratio.passed
    return passed


def _comparisons(scale: Scale, areas: Sequence[str]) -> Iterator[Ratio]:
    for name in areas or AREAS:
        yield from AREAS[name](scale)


def committed_ratios(form: str) -> dict[str, float]:
    """Return what was measured when it was committed.

    Parameters
    ----------
    form : str
        'quick' or 'full'.

    Returns
    -------
    dict
        Ratio by name of the comparison [1].
    """
    content = yaml.safe_load(COMMITTED.read_text(encoding="utf-8"))
    return {str(k): float(v) for k, v in (content.get(form) or {}).items()}
