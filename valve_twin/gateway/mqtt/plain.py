# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Valves as JSON: one retained topic a valve, the same content as the pages' `/api/valves`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, NamedTuple

from valve_twin.gateway.mqtt.broker import Message
from valve_twin.gateway.mqtt.names import topic_path
from valve_twin.gateway.plain import plain_faults, plain_valve, plain_words

if TYPE_CHECKING:
    from valve_twin.gateway.view import View
    from valve_twin.io.history.fleet import FleetRow


class _Made(NamedTuple):
    """The text of a valve, and what it was made of."""

    of: tuple[object, ...]
    words: dict[str, object]
    text: bytes


class JsonSpeaker:
    """Says a valve anew where something of it has changed.

    Topics are PREFIX/online (`true`, `false` by the will), PREFIX/history, PREFIX/faults (of all
    nodes), PREFIX/valves/NAME.

    Parameters
    ----------
    prefix : str
        What all topics begin with.
    """

    subscriptions: tuple[str, ...] = ()

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._said: dict[str, bytes] = {}
        self._made: dict[str, _Made] = {}

    def look(self, view: View) -> None:
        """Take no note: all that is stored is said at each connection."""

    def will(self) -> Message:
        """Return what the broker says when we are gone."""
        return self._message("online", False)

    def born(self, view: View) -> list[Message]:
        """Return all there is to say to a broker that knows nothing."""
        self._said.clear()
        return [self._message("online", True), *self.changed(view)]

    def changed(self, view: View) -> list[Message]:
        """Return what is new; a valve that is gone is cleared."""
        now = {
            self._topic(f"valves/{topic_path(row.valve)}"): self._said_of(view, row)
            for row in view.rows
        }
        self._made = {row.valve: self._made[row.valve] for row in view.rows}
        place = {"history": view.where, "failure": view.failure}
        now[self._topic("history")] = _text(place)
        now[self._topic("faults")] = _text(plain_faults(view.faults))
        gone = [Message(t, b"", 1, retain=True) for t in self._said if t not in now]
        new = [
            Message(t, text, 1, retain=True)
            for t, text in now.items()
            if self._said.get(t) != text
        ]
        self._said = now
        return gone + new

    def missed(self, view: View) -> list[Message]:
        """Return nothing: whoever wants the past reads it from the history."""
        return []

    def heard(self, topic: str, payload: bytes) -> bool:
        """Return whether all is to be said anew: nobody can ask for it."""
        return False

    def awaits(self, payload: bytes) -> bytes | None:
        """Return None: it hears nothing."""

    def farewell(self) -> list[Message]:
        """Return what is said at a clean end."""
        return [self.will()]

    def _said_of(self, view: View, row: FleetRow) -> bytes:
        """Return the text of a valve, made anew where what it is made of is another object."""
        of, words = view.made_of(row), plain_words(view, row)
        kept = self._made.get(row.valve)
        if (
            kept is None
            or kept.words != words
            or any(a is not b for a, b in zip(kept.of, of, strict=True))
        ):
            kept = self._made[row.valve] = _Made(of, words, _text(plain_valve(view, row) | words))
        return kept.text

    def _topic(self, name: str) -> str:
        return f"{self._prefix}/{name}"

    def _message(self, name: str, what: object) -> Message:
        return Message(self._topic(name), _text(what), 1, retain=True)


def _text(what: object) -> bytes:
    return json.dumps(what, ensure_ascii=False, allow_nan=False).encode("utf-8", "replace")
