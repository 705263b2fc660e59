# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What asyncua says of a server: why a connection ended, and which messages nobody will see."""

from __future__ import annotations

import asyncio
import logging
from threading import get_ident
from typing import Any

_LOGGER = logging.getLogger("asyncua")
_LOSING = {
    "publish",
    "_publish_loop",
    "publish_callback",
    "_explode_notifications",
    "_explode_datachange",
    "_explode_events",
    "_dispatch_to_handler",
}
"""Functions of asyncua that warn of nothing but a message, or a part of one, that is lost."""

_SAID_ANYWAY = "Got error status"
"""The connection ends with that status."""

_MOST = 200
"""Characters of a line [1]."""


class Complaints(logging.Handler):
    """Takes what asyncua logs in the thread that makes it, and lets nobody else print it.

    Attributes
    ----------
    why : str
        The first one of the connection, in a line.
    lost : int
        Messages of the server, or parts of them, that it sent and nobody could read [1].
    lost_why : str
        Why the last of them was.
    """

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._thread = get_ident()
        self.why = self.lost_why = ""
        self.lost = 0
        _LOGGER.setLevel(logging.WARNING)
        _LOGGER.propagate = False
        _LOGGER.addHandler(self)

    def close(self) -> None:
        """Hear no more."""
        _LOGGER.removeHandler(self)
        super().close()

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one; called by logging, whose handlers have this name.

        Parameters
        ----------
        record : LogRecord
            What was logged.
        """
        if record.thread != self._thread:
            return
        err = record.exc_info[1] if record.exc_info else None
        text = one_line(err) if err is not None else plain(record.getMessage())
        gone = isinstance(err, OSError) or type(err).__name__.startswith("Bad")
        if record.funcName in _LOSING and not gone:
            self.lost, self.lost_why = self.lost + 1, text
        elif record.levelno >= logging.ERROR and not gone and not text.startswith(_SAID_ANYWAY):
            self.why = self.why or text

    def of_loop(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Keep what a task of asyncua ended with; the handler of a loop.

        Parameters
        ----------
        loop : AbstractEventLoop
            Of the thread.
        context : dict
            Message and exception.
        """
        del loop
        err = context.get("exception")
        text = one_line(err) if err is not None else plain(str(context.get("message")))
        self.why = self.why or text


def one_line(err: BaseException) -> str:
    """Return an error in a line.

    Parameters
    ----------
    err : BaseException
        Any; what no library of networks raises is the fault of what the server sent.
    """
    if isinstance(err, asyncio.TimeoutError):
        return "the server did not answer in time"
    text = plain(str(err))
    if text.startswith("No matching endpoints"):
        return f"{text}: the server takes none of this policy: set pki, or leave it out"
    name = type(err).__name__
    told = f"{name}: {text}" if text else name
    sound = isinstance(err, OSError) or name.startswith("Bad")
    return told if sound else f"what the server sends cannot be read ({told})"


def plain(text: str) -> str:
    """Return the first line of a text of a server, bounded, with nothing a terminal obeys.

    Parameters
    ----------
    text : str
        Any.
    """
    first = (text.strip().splitlines() or [""])[0]
    return "".join(c if c.isprintable() else "?" for c in first[:_MOST])
