# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Marks and acknowledgements from the page into a history, where no twin of the valve runs."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol

from valve_twin.core.types import Maintenance
from valve_twin.io.errors import ConfigError, StoreError, may_pass
from valve_twin.io.history.database import must_be_there
from valve_twin.io.history.log.events import Acknowledgement
from valve_twin.io.history.remarks import wrong_note
from valve_twin.io.history.store import History


@dataclass(frozen=True, slots=True)
class Work:
    """What somebody did to a valve.

    Attributes
    ----------
    valve, note, who : str
        Of which valve, what was done, and who says so.
    new_reference : bool
        Whether the valve is a new one from now on.
    """

    valve: str
    note: str
    who: str
    new_reference: bool = False

    @property
    def signed(self) -> str:
        """The note with who wrote it."""
        return f"{self.note.strip()} ({self.who}, on the page)"


@dataclass(frozen=True, slots=True)
class Seen:
    """That somebody has seen an entry of the event log; number 0 = all that are open."""

    valve: str
    number: int
    note: str
    who: str


class Marker(Protocol):
    """Who takes down what comes from the page; StoreError or ConfigError say why not."""

    def mark(self, work: Work) -> str:
        """Take down that work was done; return what is said."""

    def acknowledge(self, seen: Seen) -> str:
        """Take down that somebody has seen an entry; return what is said."""


def check_note(work: Work) -> None:
    """Refuse a note that cannot be taken down.

    Raises
    ------
    ConfigError
        If it is empty or too long.
    """
    wrong = wrong_note(work.note) or wrong_note(work.signed)
    if wrong:
        raise ConfigError(wrong)


class HistoryMarker:
    """Writes into the history itself.

    Parameters
    ----------
    url : str
        The history.
    """

    def __init__(self, url: str) -> None:
        self._url = url

    def mark(self, work: Work) -> str:
        """Take down work from the next cycle on.

        Raises
        ------
        ConfigError, StoreError
            If the note cannot be taken, the valve is not known, its twin runs or nothing can be
            written.
        """
        check_note(work)
        must_be_there(self._url)
        with History(self._url) as history:
            _check(history, work.valve)
            try:
                history.claim(work.valve)
            except StoreError as err:
                if may_pass(err):
                    raise
                msg = f"{err}; its twin runs: mark it there, or on the page of the node gateway"
                raise StoreError(msg) from err
            last = history.last_record(work.valve)
            cycle = history.last_cycle(work.valve) + 1
            stamp_ns = last.end_ns if last is not None else time.time_ns()
            event = Maintenance(stamp_ns, cycle, work.signed, work.new_reference)
            history.add_maintenance(work.valve, event)
        return f"{work.valve}: maintenance noted from cycle {cycle} on"

    def acknowledge(self, seen: Seen) -> str:
        """Take down who has seen an entry.

        Raises
        ------
        ConfigError, StoreError
            If the valve or the entry is not there or nothing can be written.
        """
        by = Acknowledgement(seen.who, seen.note, time.time_ns())
        must_be_there(self._url)
        with History(self._url) as history:
            _check(history, seen.valve)
            count = history.log.acknowledge(seen.valve, seen.number, by)
        return f"{seen.valve}: {count} entries are acknowledged now"


def _check(history: History, valve: str) -> None:
    if valve not in history.valves():
        msg = f"{history.where}: knows no valve {valve!r}"
        raise ConfigError(msg)
