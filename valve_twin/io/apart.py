# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Let another's code read a file in a process of its own, which may die of it.

Readers in C meet what a broken file claims without a check: of 400 mutations of a small MAT file
one ended scipy's by a segmentation fault, of an HDF5 file one kept h5py busy for good.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import warnings
from contextlib import suppress
from multiprocessing import Pipe
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from valve_twin.io.errors import BagError, ValveTwinError

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection
    from pathlib import Path

LEAST_S = 8.0
"""Processor time that the smallest file may take [s]."""

EACH_MEGABYTE_S = 10.0
"""What it may take more for each megabyte [s]: a workbook takes a tenth of that."""

_MEGABYTE = 1 << 20

T = TypeVar("T")


def run_apart(path: Path, read: Callable[[], T]) -> T:
    """Return what a function reads from a file, in a process of its own on Linux.

    Elsewhere it runs here. Packages that it needs are best imported before.

    Parameters
    ----------
    path : path
        The file, or a folder of files; its size bounds the processor time.
    read : callable
        Reads it; what it returns is pickled. What it prints is lost.

    Raises
    ------
    ValveTwinError
        As raised by it.
    BagError
        If it raises anything else, ends its process, or works without an end.
    """
    if sys.platform != "linux":
        return read()
    most_s = LEAST_S + EACH_MEGABYTE_S * _size(path) / _MEGABYTE
    ours, theirs = Pipe(duplex=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads stay behind: none is needed
        child = os.fork()
    if not child:
        ours.close()
        _serve(theirs, path, read, most_s)
    theirs.close()
    answer = None
    try:
        with ours, suppress(EOFError, OSError):
            answer = _receive(ours)
    finally:
        if answer is None:  # it is dead, or nobody waits for it any more
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    if answer is None:
        msg = f"{path}: {_why(status, most_s)}; save it anew"
        raise BagError(msg)
    raised, value = answer
    if raised is not None:
        raise raised(value)
    return value  # type: ignore[no-any-return]


def _size(path: Path) -> int:
    """Return the bytes of a file, or of all files of a folder [B]."""
    files = path.iterdir() if path.is_dir() else (path,)
    return sum(file.stat().st_size for file in files)


def _why(status: int, most_s: float) -> str:
    """Return what became of a reader that gave no answer."""
    number = os.waitstatus_to_exitcode(status)
    if -number == signal.SIGXCPU:
        return f"is broken: its reader comes to no end within {most_s:.0f} s"
    name = signal.Signals(-number).name if number < 0 else f"exit code {number}"
    return f"is broken: its reader died of it ({name})"


def _serve(pipe: Connection, path: Path, read: Callable[[], Any], most_s: float) -> NoReturn:
    """Read and answer; the process ends here."""
    try:
        _confine(most_s)
        try:
            _send(pipe, (None, read()))
        except ValveTwinError as err:
            _send(pipe, (type(err), str(err)))
        except Exception as err:  # whatever a broken file makes a reader raise
            text = f"{path}: cannot be read ({type(err).__name__}: {err}); save it anew"
            _send(pipe, (BagError, text))
    finally:
        os._exit(0)


def _confine(most_s: float) -> None:
    """Take from this process the terminal, core dumps and time without an end."""
    import faulthandler
    import resource

    faulthandler.disable()
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(nothing, number)
    sys.stdout = sys.stderr = os.fdopen(nothing, "w")
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    limit = int(most_s) + 1  # a child begins with none used
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 1))
    signal.signal(signal.SIGXCPU, signal.SIG_DFL)


def _send(pipe: Connection, answer: object) -> None:
    """Send an object; its arrays go as they lie, without a copy."""
    parts: list[pickle.PickleBuffer] = []
    head = pickle.dumps(answer, protocol=5, buffer_callback=parts.append)
    raws = [part.raw() for part in parts]
    pipe.send([raw.nbytes for raw in raws])
    pipe.send_bytes(head)
    for raw in raws:
        if raw.nbytes:
            pipe.send_bytes(raw)


def _receive(pipe: Connection) -> Any:  # noqa: ANN401
    """Return an object that was sent by `_send`."""
    sizes: list[int] = pipe.recv()
    head, parts = pipe.recv_bytes(), []
    for size in sizes:
        part = bytearray(size)
        if size:
            pipe.recv_bytes_into(part)
        parts.append(part)
    return pickle.loads(head, buffers=parts)
