# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""SIGTERM and SIGINT end a node in good order, exit code 0, from the first moment on.

Standard library only: the handlers stand before the slow imports begin.
"""

from __future__ import annotations

import signal
import sys
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

from valve_twin.compat.interpreter import leave

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType

SIGNALS = (signal.SIGTERM, signal.SIGINT)

_WHOLE = ("llvmlite.", "numba.core.caching.", "numba.core.codegen.", "numba.core.cpu.")
"""Packages and modules that hand objects to a compiler in C++, which calls them back: broken off
there, a compiled kernel lacks its code and the process crashes where it is bound."""

_MAIN = threading.main_thread().ident or 0

_AGAIN_S = 0.01
"""Pause until a signal that came there is looked at again [s]."""


class _Stop:
    """Whether the end was asked for, a loop looks at it, and what runs may be broken off."""

    requested = False
    looping = False
    breakable = False


def install() -> None:
    """Take the signals; again after anything that takes them, as the events executor does.

    Signals that were put off by whoever started the process are delivered now.
    """
    for number in SIGNALS:
        signal.signal(number, _on_signal)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


@contextmanager
def put_off() -> Iterator[None]:
    """Keep signals waiting; threads that begin here never take one, they are left to this one."""
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


@contextmanager
def breaking_off() -> Iterator[None]:
    """Let a signal break off what runs here by KeyboardInterrupt, where it may take long.

    One that is raised where nothing can be raised, in a destructor, is lost without a word: what
    runs then comes to its own end.
    """
    sys.unraisablehook = _say_unraisable
    _Stop.breakable = True
    try:
        if _Stop.requested:
            raise KeyboardInterrupt
        yield
    finally:
        _Stop.breakable = False


def was_broken_off(err: BaseException | None) -> bool:
    """Return whether an error goes back to the KeyboardInterrupt of `breaking_off`.

    Python 3.11 and before makes a RuntimeError of one that is raised in `__set_name__`, which runs
    while a class is made: an import of hundreds of dataclasses is there much of its time.
    """
    while err is not None and not isinstance(err, KeyboardInterrupt):
        err = err.__cause__ or err.__context__
    return err is not None


def ignore() -> None:
    """Shut down undisturbed: a second Ctrl-C does no harm."""
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def looping() -> None:
    """Say that a loop now looks at `stop_requested`."""
    _Stop.looping = True


def stop_requested() -> bool:
    """Return whether a signal asked for the end."""
    return _Stop.requested


def _say_unraisable(unraisable: sys.UnraisableHookArgs) -> None:
    if unraisable.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(unraisable)


def _is_whole(frame: FrameType | None) -> bool:
    """Return whether what runs must come to its end, see `_WHOLE`."""
    while frame is not None:
        if f"{frame.f_globals.get('__name__')}.".startswith(_WHOLE):
            return True
        frame = frame.f_back
    return False


def _on_signal(number: int, frame: FrameType | None) -> None:
    _Stop.requested = True
    if not _Stop.looping:
        leave(0)  # nothing is open yet
    if _Stop.breakable:
        if _is_whole(frame):
            again = threading.Timer(_AGAIN_S, signal.pthread_kill, (_MAIN, number))
            again.daemon = True
            again.start()
            return
        _Stop.breakable = False
        raise KeyboardInterrupt
