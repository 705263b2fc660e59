# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled copies of a loop, each with functions of its own compiled into it."""

from __future__ import annotations

from types import FunctionType
from typing import TYPE_CHECKING, Any

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Callable

    Loop = Callable[..., None]


def per_sample(function: Callable[..., object]) -> Callable[..., Any]:
    """Compile what runs once a sample into its caller.

    The error model of NumPy, in which a division by 0 is no exception, lets the compiler leave out
    the counting of references to arrays, half of the time of a cheap law.
    """
    compiled: Callable[..., Any] = njit(cache=True, forceinline=True, error_model="numpy")(
        function
    )
    return compiled


def bind(
    loop: Callable[..., object],
    owner: Callable[..., object],
    *,
    forceinline: bool = False,
    error_model: str = "python",
    **names: object,
) -> Loop:
    """Return a compiled copy of a loop in which some of its global names are others.

    What is bound is compiled into the loop, so nothing is called through a pointer; the copy is
    cached beside the owner's file and compiled anew when that file changes.

    Parameters
    ----------
    loop : callable
        Python function.
    owner : callable
        Compiled function beside whose file the copy is cached.
    forceinline : bool
        Whether it is compiled into its caller.
    error_model : str
        What a division by 0 is: "python", an exception, or "numpy", infinite.
    names : object
        What the loop finds under its global names: compiled functions and numbers.
    """
    written: FunctionType = owner.py_func  # type: ignore[attr-defined]
    bound = (getattr(value, "__name__", value) for value in names.values())
    name = "_".join(map(str, (loop.__name__, *bound)))  # the cache goes by the name
    code = loop.__code__.replace(co_filename=written.__code__.co_filename, co_name=name)
    copy = FunctionType(code, {**loop.__globals__, **names}, name)
    copy.__module__, copy.__qualname__ = written.__module__, name
    compiled: Loop = njit(cache=True, forceinline=forceinline, error_model=error_model)(copy)
    return compiled
