# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The papers that can be recomputed and the benchmarks that can be run, one module each.

A module exports `PAPER` or `BENCHMARK`; benchmarks take minutes and run only where they are named.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.validation.check import Check

_MODULES = {
    "000": "valve_twin.validation.paper_000",
    "001": "valve_twin.validation.paper_001",
    "002": "valve_twin.validation.paper_002",
    "003": "valve_twin.validation.paper_003",
    "004": "valve_twin.validation.paper_004",
}

_BENCHMARKS = {
    "damadics": "valve_twin.validation.damadics.benchmark",
    "landing": "valve_twin.validation.landing",
    "pole": "valve_twin.validation.pole",
    "solenoid": "valve_twin.validation.solenoid",
}


@dataclass(frozen=True, slots=True)
class Paper:
    """A source paper and how its numbers are recomputed.

    Attributes
    ----------
    number : str
        Its number, e.g. "002".
    title : str
        What it is about.
    steps : int
        How often `recompute` reports an advance.
    recompute : callable
        (advance) -> every comparison, in the order of the paper; `advance` is called once a step.
    """

    number: str
    title: str
    steps: int
    recompute: Callable[[Callable[[], None]], tuple[Check, ...]]


def paper_numbers() -> tuple[str, ...]:
    """Return the numbers of all papers that can be recomputed."""
    return tuple(_MODULES)


def get_paper(number: str) -> Paper:
    """Return a paper by its number.

    Raises
    ------
    ValueError
        If it cannot be recomputed; the message lists those that can.
    """
    if number not in _MODULES:
        message = f"there is no paper '{number}'; known are {', '.join(_MODULES)}"
        raise ValueError(message)
    paper: Paper = import_module(_MODULES[number]).PAPER
    return paper


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a benchmark found.

    Attributes
    ----------
    tables : mapping
        Rows by title; a row is what it shows by column.
    checks : tuple of Check
        Its figures beside published ones and goals.
    """

    tables: Mapping[str, tuple[Mapping[str, float | str], ...]]
    checks: tuple[Check, ...]


@dataclass(frozen=True, slots=True)
class Benchmark:
    """A public benchmark and how it is run.

    Attributes
    ----------
    name : str
        Its name, e.g. that of its valve.
    title : str
        What it is about.
    steps : int
        How often `run` reports an advance.
    run : callable
        (advance) -> `Outcome`; `advance` is called once a step.
    """

    name: str
    title: str
    steps: int
    run: Callable[[Callable[[], None]], Outcome]


def benchmark_names() -> tuple[str, ...]:
    """Return the names of all benchmarks."""
    return tuple(_BENCHMARKS)


def get_benchmark(name: str) -> Benchmark:
    """Return a benchmark by its name.

    Raises
    ------
    ValueError
        If there is none; the message lists those that are.
    """
    if name not in _BENCHMARKS:
        message = f"there is no benchmark '{name}'; known are {', '.join(_BENCHMARKS)}"
        raise ValueError(message)
    benchmark: Benchmark = import_module(_BENCHMARKS[name]).BENCHMARK
    return benchmark
