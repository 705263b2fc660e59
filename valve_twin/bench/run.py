# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Run all comparisons, one line each, beside what was measured when it was committed.

`run_benchmarks` prints; `run_gate` repeats them and fails where a ratio was lost.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from valve_twin.bench.data import archive, reading, storing, writing, years
from valve_twin.bench.measure import Better, Ratio, Scale, describe, median
from valve_twin.bench.models import estimation, recursion, simulation, solenoid

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence


def _nodes(scale: Scale) -> Iterator[Ratio]:
    """Compare nodes; the rest needs no ROS."""
    from valve_twin.bench.nodes import live

    return live.compare(scale)


def _faces(scale: Scale) -> Iterator[Ratio]:
    from valve_twin.bench.nodes import faces

    return faces.compare(scale)


AREAS = {
    "simulation": simulation.compare,
    "estimation": estimation.compare,
    "recursion": recursion.compare,
    "solenoid": solenoid.compare,
    "archive": archive.compare,
    "reading": reading.compare,
    "writing": writing.compare,
    "storing": storing.compare,
    "years": years.compare,
    "nodes": _nodes,
    "faces": _faces,
}
"""What is compared, by the name that `valve-twin bench NAME` takes."""

COMMITTED = Path(__file__).parent / "committed.yaml"


RUNS = 5
"""Repetitions by which `run_gate` judges [1]."""

KEPT = 0.8
"""Share of a committed ratio that a run must keep [1]."""

_SENSE = (
    "better is higher: time of the other over time of ours; "
    "better is lower: time of ours over time of an other that does less"
)


@dataclass(frozen=True, slots=True)
class Committed:
    """A ratio as it was committed [1], and in which sense it is to be read."""

    ratio: float
    better: Better


def run_benchmarks(
    *, quick: bool, write: Callable[[str], object], areas: Sequence[str] = ()
) -> None:
    """Run comparisons and print one line each; a busy machine fails nothing here.

    Parameters
    ----------
    quick : bool
        Smaller inputs and fewer repetitions: seconds instead of minutes.
    write : callable
        Takes the text.
    areas : sequence of str
        Names of `AREAS`; empty = all.
    """
    scale = _begin(quick, write)
    committed = committed_ratios("quick" if quick else "full")
    for ratio in _comparisons(scale, areas):
        known = committed.get(ratio.name)
        before = known.ratio if known is not None and known.better is ratio.better else None
        write(f"{describe(ratio, before)}\n")


def run_gate(*, quick: bool, write: Callable[[str], object], areas: Sequence[str] = ()) -> bool:
    """Run comparisons several times and hold their medians to what was committed.

    A ratio is lost where the median is worse than the committed one by more than `KEPT` allows,
    and the committed one is better than all that was measured: a machine that is noisy by more
    than the loss proves none. It is lost, too, where it was committed in the other sense.

    Parameters
    ----------
    quick, write, areas
        As of `run_benchmarks`.

    Returns
    -------
    bool
        Whether no ratio is lost.
    """
    scale = _begin(quick, write)
    committed = committed_ratios("quick" if quick else "full")
    measured: dict[str, list[float]] = {}
    senses: dict[str, Better] = {}
    for number in range(RUNS):
        write(f"run {number + 1} of {RUNS}\n")
        for ratio in _comparisons(scale, areas):
            found = measured.setdefault(ratio.name, [])
            senses[ratio.name] = ratio.better
            if ratio.unmeasured:
                write(f"{describe(ratio)}\n")
            else:
                found.append(ratio.value)
    lost = [
        _verdict(name, senses[name], found, committed.get(name), write)
        for name, found in measured.items()
    ]
    write(f"{sum(lost)} of {len(lost)} ratios lost\n")
    return not any(lost)


def _verdict(
    name: str,
    better: Better,
    found: Sequence[float],
    committed: Committed | None,
    write: Callable[[str], object],
) -> bool:
    """Print the median of a comparison's runs and tell whether it lost against the committed one.

    Parameters
    ----------
    name : str
        Of the comparison.
    better : Better
        In which sense it is to be read.
    found : sequence of float
        Ratios of the runs in which it was measured [1].
    committed : Committed or None
        The committed ratio; None = never committed.
    write : callable
        Takes the text.
    """
    if not found:
        write(f"{name}: never measured: LOST\n")
        return True
    middle, low, high = statistics.median(found), min(found), max(found)
    said = f"{name}: {middle:.3g} x ({low:.3g} to {high:.3g}), better is {better.value}"
    if committed is None:
        write(f"{said}, nothing committed\n")
        return False
    if committed.better is not better:
        write(f"{said}, committed in the other sense: LOST\n")
        return True
    ratio = committed.ratio
    if better is Better.HIGHER:
        lost, bound = middle < KEPT * ratio and high < ratio, f"below {KEPT:.0%} of it"
    else:
        lost, bound = middle * KEPT > ratio and low > ratio, f"above {1.0 / KEPT:.0%} of it"
    write(f"{said}, committed {ratio:.3g} x: {f'LOST: {bound}' if lost else 'kept'}\n")
    return lost


def _begin(quick: bool, write: Callable[[str], object]) -> Scale:
    """Print what the machine is like and in which sense the lines are to be read."""
    scale = Scale(quick, 5 if quick else 15)
    loop = median(lambda: sum(range(1_000_000)), scale.repeats)
    write(f"reference loop (Python sum over 1e6 numbers): {loop * 1e3:.1f} ms\n{_SENSE}\n")
    return scale


def _comparisons(scale: Scale, areas: Sequence[str]) -> Iterator[Ratio]:
    for name in areas or AREAS:
        yield from AREAS[name](scale)


def committed_ratios(form: str) -> dict[str, Committed]:
    """Return what was measured when it was committed.

    Parameters
    ----------
    form : str
        'quick' or 'full'.

    Returns
    -------
    dict
        By name of the comparison.
    """
    content = yaml.safe_load(COMMITTED.read_text(encoding="utf-8"))
    return {
        str(name): Committed(float(row["ratio"]), Better(row["better"]))
        for name, row in (content.get(form) or {}).items()
    }
