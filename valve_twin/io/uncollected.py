# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read very many values without Python looking for garbage among them again and again."""

from __future__ import annotations

import gc
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


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
