# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Make very many values without Python looking for garbage among them again and again."""

from __future__ import annotations

import gc
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_YOUNG = 50_000
"""New objects after which garbage is looked for where it is rarely [1]; 700 or 2000 else."""


@contextmanager
def uncollected() -> Iterator[None]:
    """Leave garbage in circles alone while the block runs; what is not in circles goes at once.

    For blocks that make many values that stay and no circles: 30 000 estimates with their
    parameters are walked through a dozen times while they are read, 1 s of 2.5.
    """
    on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if on:
            gc.enable()


@contextmanager
def rarely_collected() -> Iterator[None]:
    """Look for garbage in circles seldom while the block runs, as `collect_rarely`."""
    before = gc.get_threshold()
    collect_rarely()
    try:
        yield
    finally:
        gc.set_threshold(*before)


def collect_rarely() -> None:
    """Look for garbage in circles seldom from now on: a tenth of a short verb.

    For work that imports most of what it takes: half a million objects that stay.
    """
    gc.set_threshold(_YOUNG, *gc.get_threshold()[1:])
