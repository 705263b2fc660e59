# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Descriptors of a process that serves: as many as may be, and a listener that leaves some."""

from __future__ import annotations

import errno
import logging
import os
import select
import socket
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

if TYPE_CHECKING:
    from collections.abc import Iterable

MOST_DESCRIPTORS = 8192
"""As many are asked for, where the system allows them: each is a connection with its memory,
assumed [1]."""

FEWEST = 1024
"""Where the limit is not known it is taken for this, as most systems set it [1]."""

_OUT_OF = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


def raise_descriptors() -> int:
    """Raise the limit of open descriptors as far as we may; return it."""
    if sys.platform == "win32":
        return FEWEST
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, MOST_DESCRIPTORS)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return soft if soft != resource.RLIM_INFINITY else MOST_DESCRIPTORS
    with suppress(OSError, ValueError):  # macOS grants fewer than it says
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return resource.getrlimit(resource.RLIMIT_NOFILE)[0]


class AnyDescriptor:
    """Takes the place of the module `select` in a library: that ends at descriptor 1023."""

    @staticmethod
    def select(
        readers: Iterable[Any], writers: Iterable[Any], _: Iterable[Any], timeout_s: float
    ) -> tuple[list[Any], list[Any], list[Any]]:
        """Return who can be read, who can be written, and nobody, as `select.select` does.

        Parameters
        ----------
        readers, writers : iterable
            Sockets, or whatever has a descriptor.
        _ : iterable
            Nobody is looked at for what is exceptional.
        timeout_s : float
            Longest wait [s].
        """
        readers, writers = list(readers), list(writers)
        asked: dict[int, int] = {}
        for of, event in ((readers, select.POLLIN), (writers, select.POLLOUT)):
            for one in of:
                asked[one.fileno()] = asked.get(one.fileno(), 0) | event
        poll = select.poll()
        for number, events in asked.items():
            poll.register(number, events)  # ValueError where it is closed, as `select.select`
        found = dict(poll.poll(1e3 * timeout_s))
        ended = select.POLLERR | select.POLLHUP | select.POLLNVAL
        ready = [
            [one for one in of if found.get(one.fileno(), 0) & (event | ended)]
            for of, event in ((readers, select.POLLIN), (writers, select.POLLOUT))
        ]
        return ready[0], ready[1], []


def out_of_descriptors(err: OSError) -> bool:
    """Return whether an error says that no descriptor is left."""
    return err.errno in _OUT_OF


class BoundedListener(socket.socket):
    """Listens, and lets go at once who comes while too many are connected or nothing is left.

    An accept that fails for want of a descriptor would be tried again and again, with a trace.

    Parameters
    ----------
    family : int
        Of the addresses.
    """

    __slots__ = ("_accepted", "_spare", "most")

    def __init__(self, family: int) -> None:
        super().__init__(family, socket.SOCK_STREAM)
        self.most = MOST_DESCRIPTORS
        self._accepted: WeakSet[socket.socket] = WeakSet()
        self._spare = os.open(os.devnull, os.O_RDONLY)

    def accept(self) -> tuple[socket.socket, object]:
        """Accept one, as a socket does.

        Raises
        ------
        BlockingIOError
            If nobody waits, or who did was let go.
        """
        try:
            accepted, where = super().accept()
        except OSError as err:
            if not out_of_descriptors(err) or not self._let_go():
                raise
            raise BlockingIOError from err
        self._accepted.add(accepted)
        if len(self._accepted) > self.most:
            self._accepted = WeakSet(one for one in self._accepted if one.fileno() >= 0)
            if len(self._accepted) > self.most:
                accepted.close()
                raise BlockingIOError
        return accepted, where

    def close(self) -> None:
        """Listen no more."""
        if self._spare >= 0:
            os.close(self._spare)
            self._spare = -1
        super().close()

    def _let_go(self) -> bool:
        """Accept one with the descriptor that is kept for that, and close it."""
        if self._spare >= 0:
            os.close(self._spare)
            with suppress(OSError):
                super().accept()[0].close()
        try:
            self._spare = os.open(os.devnull, os.O_RDONLY)
        except OSError:  # another thread was faster
            self._spare = -1
        return self._spare >= 0


class _Unsaid(logging.Filter):
    """Drops what asyncio says of each connection that it has no descriptor for."""

    def filter(self, record: logging.LogRecord) -> bool:
        return "out of system resource" not in record.getMessage()


_UNSAID = _Unsaid()


def leave_unsaid() -> None:
    """Print no trace for each connection that comes while no descriptor is left."""
    logging.getLogger("asyncio").addFilter(_UNSAID)
