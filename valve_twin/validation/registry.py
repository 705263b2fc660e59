# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The papers that can be recomputed, one module each; a module exports `PAPER`."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.validation.check import Check

_MODULES = {
    "000": "valve_twin.validation.paper_000",
    "001": "valve_twin.validation.paper_001",
    "002": "valve_twin.validation.paper_002",
    "003": "valve_twin.validation.paper_003",
    "004": "valve_twin.validation.paper_004",
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
