# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Run all comparisons, one line each, beside what was measured when it was committed.

`run_benchmarks` prints; `run_gate` repeats them and fails where a ratio was lost.
"""

from __future__ import annotations

import statistics
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from valve_twin.bench.data import archive, reading, storing, writing, years
from valve_twin.bench.measure import Ratio, Scale, describe, median
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

_SENSE = "ratio: time of the other over time of ours, in every line; better is: higher"


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
        write(f"{describe(ratio, committed.get(ratio.name))}\n")


def run_gate(*, quick: bool, write: Callable[[str], object], areas: Sequence[str] = ()) -> bool:
    """Run comparisons several times and hold their medians to what was committed.

    A ratio is lost where the median falls below `KEPT` of the committed one and the committed one
    lies above all that was measured: a machine that is noisy by more than the loss proves none.

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
    for number in range(RUNS):
        write(f"run {number + 1} of {RUNS}\n")
        for ratio in _comparisons(scale, areas):
            found = measured.setdefault(ratio.name, [])
            if ratio.unmeasured:
                write(f"{describe(ratio)}\n")
            else:
                found.append(ratio.value)
    lost = [_verdict(name, found, committed.get(name), write) for name, found in measured.items()]
    write(f"{sum(lost)} of {len(lost)} ratios lost\n")
    return not any(lost)


def _verdict(
    name: str, found: Sequence[float], committed: float | None, write: Callable[[str], object]
) -> bool:
    """Print the median of a comparison's runs and tell whether it lost against the committed one.

    Parameters
    ----------
    name : str
        Of the comparison.
    found : sequence of float
        Ratios of the runs in which it was measured [1].
    committed : float or None
        The committed ratio [1]; None = never committed.
    write : callable
        Takes the text.
    """
    if not found:
        write(f"{name}: never measured: LOST\n")
        return True
    middle, low, high = statistics.median(found), min(found), max(found)
    lost = committed is not None and middle < KEPT * committed and high < committed
    beside = "nothing committed" if committed is None else f"committed {committed:.3g} x"
    mark = f"LOST: below {KEPT:.0%} of it" if lost else "kept"
    mark = "" if committed is None else f": {mark}"
    write(f"{name}: {middle:.3g} x ({low:.3g} to {high:.3g}), {beside}{mark}\n")
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
