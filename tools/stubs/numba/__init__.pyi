# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The part of numba that valve_twin uses: a compiled kernel keeps its own signature."""

from collections.abc import Callable
from typing import Any, TypeVar, overload

_F = TypeVar("_F", bound=Callable[..., Any])

@overload
def njit(function: _F, /) -> _F: ...
@overload
def njit(
    signature: object = ...,
    /,
    *,
    cache: bool = ...,
    inline: str = ...,
    forceinline: bool = ...,
    error_model: str = ...,
    boundscheck: bool | None = ...,
    nogil: bool = ...,
) -> Callable[[_F], _F]: ...

prange = range
