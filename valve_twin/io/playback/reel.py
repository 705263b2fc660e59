# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where a bag is being played: the message that comes next and the state that stands before it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.io.bags.folder import find_files
from valve_twin.io.errors import BagError, IndexLiesError
from valve_twin.io.mcap.mapped import changed, unreadable
from valve_twin.io.playback.player import BagMessage, BagTopic, latched_before, read_messages

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence
    from pathlib import Path

    from valve_twin.io.playback.choice import Stretch


class Reel:
    """Position in a bag.

    A bag that is found to state wrong times on the way is read by its data section from there on:
    what has been given out is not given again, and what should have come before it is left out.

    Parameters
    ----------
    path : path
        The bag.
    topics : sequence of BagTopic
        What is played.
    part, whole : Stretch
        From where to where, and the bag as it states itself.
    tell : callable
        Gets a line on what is left out.

    Raises
    ------
    IndexLiesError
        If it states wrong times at its beginning: `part` and `whole` are to be found again.
    """

    def __init__(
        self,
        path: str | Path,
        topics: Sequence[BagTopic],
        part: Stretch,
        whole: Stretch,
        tell: Callable[[str], object] = lambda _: None,
    ) -> None:
        self._path, self._whole, self._tell = path, whole, tell
        self._names = [t.name for t in topics]
        self._latched = {t.name: t.qos.depth for t in topics if t.qos.is_latched}
        self._messages: Generator[BagMessage, None, None] | None = None
        self._taken: BagMessage | None = None
        self._behind: BagMessage | None = None
        self._read, self._newest_ns = 0, -1
        self.part = part
        self._files = self._found()
        self._messages = self._open()
        self.next = self._note(next(self._messages, None))

    def go(self, part: Stretch) -> None:
        """Play another part from its beginning; where it cannot be read, all stays as it was."""
        before = self.part, self._messages, self._read, self._newest_ns
        self.part, self._read, self._newest_ns = part, 0, -1
        try:
            self._messages = self._open()
            self.next = self._following()
        except BagError:
            self.part, self._messages, self._read, self._newest_ns = before
            raise
        self._taken = self._behind = None
        if before[1] is not None:
            before[1].close()

    def _open(self) -> Generator[BagMessage, None, None]:
        """Read the part; a bag that states wrong times may begin earlier and end later."""
        self._check_same()
        part, whole = self.part, self._whole
        return read_messages(
            self._path,
            self._names,
            from_ns=part.begin_ns if part.begin_ns > whole.begin_ns else 0,
            until_ns=part.end_ns if part.end_ns < whole.end_ns else None,
        )

    def _found(self) -> dict[Path, tuple[int, int]]:
        """Return by what the files of the bag are known to the system."""
        try:
            found = {file: file.stat() for file in find_files(self._path).files}
        except OSError as err:
            raise unreadable(self._path, err) from err
        return {file: (status.st_dev, status.st_ino) for file, status in found.items()}

    def _check_same(self) -> None:
        """Refuse a bag that took the place of ours; files may have come and gone, as recorded."""
        now, before = self._found(), self._files
        if before.keys().isdisjoint(now) or any(
            now.get(f, own) != own for f, own in before.items()
        ):
            raise changed(self._path)

    def _note(self, message: BagMessage | None) -> BagMessage | None:
        if message is not None:
            self._read, self._newest_ns = self._read + 1, message.log_ns
        return message

    def _following(self) -> BagMessage | None:
        """Return the message behind the one read last."""
        if self._messages is None:
            return None
        try:
            return self._note(next(self._messages, None))
        except IndexLiesError:
            return self._read_on()

    def _read_on(self) -> BagMessage | None:
        """Return the first message later than all that were read, by the data section."""
        earlier, self._messages = 0, self._open()
        found = None
        try:
            for message in self._messages:
                if message.log_ns > self._newest_ns:
                    found = message
                    break
                earlier += 1
        except IndexLiesError:  # another file of the bag
            return self._read_on()
        if earlier > self._read:
            self._tell(
                f"{self._path}: {earlier - self._read} messages are not played: it states wrong "
                "times, and later ones had been played when that was met; `valve-twin recover` it"
            )
            self._read = earlier
        return self._note(found)

    def take(self) -> BagMessage | None:
        """Return the next message and go on to the one behind it; None at the end."""
        self._taken = self.next
        if self._behind is not None:
            self.next, self._behind = self._behind, None
        elif self.next is not None:
            self.next = self._following()
        return self._taken

    def put_back(self) -> None:
        """Let the message taken last, which could not be sent, be the next again."""
        if self._taken is not None:
            self._behind, self.next, self._taken = self.next, self._taken, None

    def state_before(self, at_ns: int) -> list[BagMessage]:
        """Return the latched messages that were in force just before a log time [ns]."""
        if not self._latched:
            return []
        self._check_same()
        try:
            return latched_before(self._path, self._latched, at_ns)
        except IndexLiesError:
            return self.state_before(at_ns)

    def close(self) -> None:
        """Close the files."""
        if self._messages is not None:
            self._messages.close()
        self._messages = self._taken = self._behind = self.next = None
