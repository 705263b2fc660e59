# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""SIGTERM and SIGINT end a node in good order, exit code 0, from the first moment on.

Standard library only: the handlers stand before the slow imports begin.
"""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import FrameType

SIGNALS = (signal.SIGTERM, signal.SIGINT)


class _Stop:
    """Whether the end was asked for, and whether there is a loop that looks at it."""

    requested = False
    looping = False


def install() -> None:
    """Take the signals; again after anything that takes them, as the events executor does."""
    for number in SIGNALS:
        signal.signal(number, _on_signal)


def ignore() -> None:
    """Shut down undisturbed: a second Ctrl-C does no harm."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def looping() -> None:
    """Say that a loop now looks at `stop_requested`."""
    _Stop.looping = True


def stop_requested() -> bool:
    """Return whether a signal asked for the end."""
    return _Stop.requested


def _on_signal(number: int, frame: FrameType | None) -> None:
    del number, frame
    _Stop.requested = True
    if not _Stop.looping:
        os._exit(0)  # nothing is open yet
