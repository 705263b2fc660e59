# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What Python and numba keep private or global."""

from __future__ import annotations

import os
import re
import sys
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

SWITCH_S = 2e-4
"""Longest time for which threads that compute keep the interpreter from the data path; 5 ms by
default, once or more a cycle [s]."""


def spare_imports() -> None:
    """Keep libraries from importing OpenSSL, which no prediction needs.

    asyncio (of rclpy) and hashlib load it wherever Python has it and do without where not;
    whatever imports ssl later gets it. Upstream no switches are known. Goes when they import it
    where they use it.
    """
    spared = {"ssl", "_hashlib"} - set(sys.modules)
    sys.modules.update(dict.fromkeys(spared))  # type: ignore[arg-type]
    for user in ("asyncio", "hashlib", "hmac"):
        import_module(user)
    for name in spared:
        del sys.modules[name]


@cache
def load_kernels_alone(*, of_arrays: bool = False) -> None:
    """Let numba load a compiled kernel without being made ready to compile one: 0.15 s of CPU.

    Before it looks into a cache it declares all that it knows of Python and numpy, reads the entry
    points of every installed package for extensions, and imports scipy.linalg only to learn that
    BLAS is there, which the code it makes looks up by itself when it is called for the first time.
    A kernel that no cache holds gets all but the last: numba refreshes before it compiles, too. It
    imports coverage where there is. No issue is known. Goes when `load_overload` does not refresh.
    Kernels that estimate take numba's functions of arrays, which look for that BLAS as they are
    imported; with `of_arrays` these, too, do without scipy.linalg. Those that predict take none.
    """
    sys.modules.setdefault("coverage", None)  # type: ignore[arg-type]
    every = import_module("importlib.metadata").distributions()
    if not any("numba_extensions" in (d.read_text("entry_points.txt") or "") for d in every):
        import_module("numba.core.entrypoints")._already_initialized = True  # type: ignore[attr-defined]
    runtime = import_module("numba.core.runtime").rtsys
    caches = import_module("numba.core.caching").Cache
    if sys.modules.get("coverage") is None:
        sys.modules.pop("coverage", None)  # whoever wants it now gets it
    if not all(
        hasattr(caches, name) for name in ("_guard_against_spurious_io_errors", "_load_overload")
    ):
        return  # a numba that loads otherwise makes itself ready as it likes

    def load_overload(cache: Any, signature: Any, context: Any) -> Any:
        runtime.initialize(context)
        with cache._guard_against_spurious_io_errors():
            found = cache._load_overload(signature, context)
        if found is None:
            _spare_blas()
        return found

    caches.load_overload = load_overload
    if of_arrays:
        _spare_blas()


def _spare_blas() -> None:
    vars(import_module("numba.np.linalg"))["ensure_blas"] = lambda: None


def share_interpreter() -> None:
    """Let the data path have the interpreter soon while other threads of the process compute.

    The setting is of the whole process. Goes with an interpreter without a global lock.
    """
    sys.setswitchinterval(SWITCH_S)


def take_exponents(parser: Any) -> None:
    """Let a parser of arguments take -5e-4 for a number, as it does -0.0005, not for an option.

    argparse knows none there (3.13.0 looked at); no issue is known. Goes when it does.
    """
    parser._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")


def end_processes(pool: ProcessPoolExecutor) -> None:
    """End the processes of a pool now, whatever they do.

    Before Python 3.14 an executor only waits for them (python/cpython#128041). Goes with 3.13:
    `terminate_workers` is it.
    """
    for process in list((getattr(pool, "_processes", None) or {}).values()):
        process.terminate()


def leave(code: int) -> NoReturn:
    """End the process here, without the destructors of the interpreter and the middleware.

    They may hang or crash after the context was shut down, and take up to a second; everything
    that matters was closed and written before. Goes when `rclpy.shutdown` leaves no thread behind.
    """
    os._exit(code)
