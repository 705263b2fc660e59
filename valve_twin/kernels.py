# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`njit` for every kernel of this package: what was compiled from other sources is not run.

numba keeps a compiled kernel until the file of that kernel changes. Another kernel that it calls
and a constant that it takes from another module are compiled into it, and a change there went
unseen: after an upgrade a part of the old release ran on. Here a kernel's stamp covers its file
and all that the file imports of its own package and of this one, however far.

It reaches into `numba.core.caching` (0.60 to 0.68), since numba looks for a way to cache when a
kernel is defined and has no other place to say so. To be removed when numba's own stamp covers
what a function was compiled from, see docs/developers/upstream.md.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import pickle
import re
import sys
from functools import cache
from typing import TYPE_CHECKING, Any

from numba import njit
from numba.core.caching import CacheImpl, IndexDataCacheFile
from numba.core.caching import _SourceFileBackedLocatorMixin as _SourceFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

__all__ = ["njit"]

_IMPORT = re.compile(
    rb"^(?:from ([\w.]+) import (\([^)]*\)|[^\n]*)|import ([\w., ]+))", re.MULTILINE
)
_NAME = re.compile(rb"\w+")


@cache
def _read(path: str, _mtime_ns: int, _size: int) -> tuple[bytes, tuple[str, ...]]:
    """Return the digest of a source and what it imports at once, submodules perhaps among it."""
    with open(path, "rb") as file:
        source = file.read()
    named = []
    for base, names, plain in _IMPORT.findall(source):
        named += [b.split()[0] for b in plain.split(b",") if b.strip()] if plain else [base]
        inside = base if base.endswith(b".") else base + b"."
        named += [inside + name for name in _NAME.findall(names)] if base else []
    return hashlib.sha256(source).digest(), tuple(n.decode() for n in named)


def _source(path: str) -> tuple[bytes, tuple[str, ...]]:
    status = os.stat(path)
    return _read(path, status.st_mtime_ns, status.st_size)


def _behind(path: str, module: str) -> Iterator[bytes]:
    """Yield the digests of a source and of all of its own package and of ours behind it."""
    ours = {__name__.partition(".")[0], module.partition(".")[0]}
    seen, waiting = {module}, [(path, module)]
    while waiting:
        importing, importer = waiting.pop()
        digest, imports = _source(importing)
        yield digest
        package = getattr(sys.modules.get(importer), "__package__", None)
        for given in imports:
            try:
                name = importlib.util.resolve_name(given, package)
            except ImportError:  # a line of a text that looks like an import
                continue
            if name in seen or name.partition(".")[0] not in ours:
                continue
            seen.add(name)
            file = getattr(sys.modules.get(name), "__file__", None)
            if file and file.endswith(".py"):
                waiting.append((file, name))


class _Stamped:
    """A locator of numba whose stamp covers all that a kernel is made of."""

    _py_file: str

    def __init__(self, function: Callable[..., object], path: str) -> None:
        super().__init__(function, path)  # type: ignore[call-arg]
        self._module = function.__module__

    def get_source_stamp(self) -> bytes:
        """Return the stamp; numba compiles anew where it is not that of the cache."""
        behind = sorted(_behind(self._py_file, self._module))
        return hashlib.sha256(_source(self._py_file)[0] + b"".join(behind)).digest()

    @classmethod
    def from_function(cls, function: Callable[..., object], path: str) -> object:
        """Return the locator of a kernel that has to do with this package; None = another's."""
        if not path.endswith(".py") or not os.path.exists(path):
            return None
        ours = __name__.partition(".")[0]
        parts = (name.partition(".")[0] for name in _source(path)[1])
        if function.__module__.partition(".")[0] != ours and ours not in parts:
            return None
        return super().from_function(function, path)  # type: ignore[misc]


def _read_index(
    cached: IndexDataCacheFile,
    read: Callable[[Any], dict[Any, str]] = IndexDataCacheFile._load_index,
) -> dict[Any, str]:
    """Return the index of a kernel's cache; one that cannot be read is empty: compiled anew.

    Numba looks at the stamp behind the types of the arguments, and these may be of a module that
    is not there any more.
    """
    try:
        return read(cached)
    except (ImportError, AttributeError, EOFError, pickle.UnpicklingError):
        return {}


def _register() -> None:
    """Put a stamped locator of each kind before numba's own; let no index end a program."""
    IndexDataCacheFile._load_index = _read_index  # type: ignore[method-assign]
    kinds: Any = CacheImpl._locator_classes
    ours: list[Any] = [
        type(k.__name__, (_Stamped, k), {}) for k in kinds if issubclass(k, _SourceFile)
    ]
    CacheImpl._locator_classes = [*ours, *kinds]


_register()
