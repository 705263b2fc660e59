# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep what was found in the first cycles of a valve: every later verdict asks for it again."""

from __future__ import annotations

from functools import lru_cache, wraps
from typing import TYPE_CHECKING, ParamSpec, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

P = ParamSpec("P")
T = TypeVar("T")

MOST = 4096
"""Results that are kept of each function [1]: those of the first cycles of about 100 valves."""


def kept(find: Callable[P, T]) -> Callable[P, T]:
    """Return a function of few and small arrays that keeps its newest results.

    Parameters
    ----------
    find : callable
        A pure function of arrays of float64 and of values with a hash, by position. Its result is
        not to be changed. Arrays are compared bit by bit.
    """

    @lru_cache(maxsize=MOST)
    def found(arguments: tuple[Hashable, ...], shapes: tuple[tuple[int, ...] | None, ...]) -> T:
        whole = (
            x if shape is None else np.frombuffer(x).reshape(shape)  # type: ignore[call-overload]
            for x, shape in zip(arguments, shapes, strict=True)
        )
        return find(*whole)  # type: ignore[call-arg, arg-type]

    @wraps(find)
    def look(*args: P.args, **named: P.kwargs) -> T:
        if named:
            return find(*args, **named)  # never without what was given
        shapes = tuple(x.shape if isinstance(x, np.ndarray) else None for x in args)
        plain = (np.float64(x).tobytes() if isinstance(x, np.ndarray) else x for x in args)
        return found(tuple(plain), shapes)

    return look
