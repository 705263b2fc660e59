# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where a bag is being played: the message that comes next and the state that stands before it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.io.playback.player import BagMessage, BagTopic, latched_before, read_messages

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence
    from pathlib import Path

    from valve_twin.io.playback.choice import Stretch


class Reel:
    """Position in a bag.

    Parameters
    ----------
    path : path
        The bag.
    topics : sequence of BagTopic
        What is played.
    part : Stretch
        From where to where.
    """

    def __init__(self, path: str | Path, topics: Sequence[BagTopic], part: Stretch) -> None:
        self._path = path
        self._names = [t.name for t in topics]
        self._latched = {t.name: t.qos.depth for t in topics if t.qos.is_latched}
        self._messages: Generator[BagMessage, None, None] | None = None
        self._taken: BagMessage | None = None
        self._behind: BagMessage | None = None
        self.next: BagMessage | None = None
        self.go(part)

    def go(self, part: Stretch) -> None:
        """Play another part from its beginning."""
        self.close()
        self.part = part
        self._messages = read_messages(
            self._path, self._names, from_ns=part.begin_ns, until_ns=part.end_ns
        )
        self.next = next(self._messages, None)

    def take(self) -> BagMessage | None:
        """Return the next message and go on to the one behind it; None at the end."""
        self._taken = self.next
        if self._behind is not None:
            self.next, self._behind = self._behind, None
        elif self.next is not None and self._messages is not None:
            self.next = next(self._messages, None)
        return self._taken

    def put_back(self) -> None:
        """Let the message taken last, which could not be sent, be the next again."""
        if self._taken is not None:
            self._behind, self.next, self._taken = self.next, self._taken, None

    def state_before(self, at_ns: int) -> list[BagMessage]:
        """Return the latched messages that were in force just before a log time [ns]."""
        return latched_before(self._path, self._latched, at_ns) if self._latched else []

    def close(self) -> None:
        """Close the files."""
        if self._messages is not None:
            self._messages.close()
        self._messages = self._taken = self._behind = self.next = None
