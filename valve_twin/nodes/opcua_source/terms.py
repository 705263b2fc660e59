# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a server grants of what it is asked for, and whether a queue so short can lose samples."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

HEADROOM = 2.0
"""A queue holds so many times what comes between two publishings, or it is short: a publishing
may come late by the time of one, assumed [1]."""

LEAST_MS = 1.0
"""No server is asked to send more often [ms]."""

SHORTEST_MS, LONGEST_MS = 1e-3, 3_600_000.0
"""A server that says it sends more or less often is none, assumed [ms]; 0 = as often as it can."""

_MS = 1e3


@dataclass(slots=True)
class Terms:
    """What a server grants to one subscription.

    Attributes
    ----------
    period_s : float
        Sampling time of the tags as configured [s]; 0 = not known.
    asked : int
        So many values of a tag the server was asked to keep [1].
    publishing_ms : float
        It sends so often [ms].
    queues : dict
        So many values it keeps, by tag [1].
    samplings_ms : dict
        So often it looks, by tag; 0 = whenever the tag is written [ms].
    """

    period_s: float
    asked: int
    publishing_ms: float = 0.0
    queues: dict[int, int] = field(default_factory=dict)
    samplings_ms: dict[int, float] = field(default_factory=dict)

    def wanted_ms(self) -> float:
        """Return how often the server would have to send for all queues to suffice [ms].

        Infinite where the rate of no tag is known.
        """
        return min((self._lasts_ms(tag) for tag in self.queues), default=math.inf) / HEADROOM

    def doubt(self, nodes: Sequence[str]) -> str:
        """Return one line where samples may be lost by what was granted; else nothing.

        Parameters
        ----------
        nodes : sequence of str
            Node ids of the tags.
        """
        wanted_ms = self.wanted_ms()
        if self.publishing_ms <= wanted_ms:
            return ""
        short = [t for t in self.queues if self._lasts_ms(t) < HEADROOM * self.publishing_ms]
        tag = min(short, key=self._lasts_ms)
        queue, period_ms = self.queues[tag], self._period_ms(tag)
        need = math.ceil(HEADROOM * self.publishing_ms / period_ms)
        more = f" and of {len(short) - 1} tags more" if len(short) > 1 else ""
        remedy = f"raise queue to {need}"
        if queue < self.asked:
            remedy = (
                f"let the server's settings allow a queue of {need} (asked for {self.asked}) or "
                f"a publishing interval of {wanted_ms:g} ms, queue and publishing_ms of this node "
                "cannot help"
            )
        return (
            f"the server keeps {queue} samples of {nodes[tag]}{more}, {queue * period_ms:g} ms at "
            f"{_MS / period_ms:g} Hz, and sends every {self.publishing_ms:g} ms: samples get "
            f"lost where it is late: {remedy}"
        )

    def _period_ms(self, tag: int) -> float:
        return self.period_s * _MS or max(self.samplings_ms[tag], 0.0)

    def _lasts_ms(self, tag: int) -> float:
        """Return when a queue is full [ms]; infinite where the rate of its tag is not known."""
        return self.queues[tag] * self._period_ms(tag) or math.inf


class Granted:
    """Keeps what a session of asyncua's client is granted: asyncua itself lets go of it.

    Parameters
    ----------
    session : object
        The session of a client that is connected; its calls go through this from now on.
    """

    def __init__(self, session: Any) -> None:
        self._create = session.create_subscription
        self._add, self._update = session.create_monitored_items, session.update_subscription
        self.publishing_ms = 0.0
        self.items: list[Any] = []
        session.create_subscription, session.create_monitored_items = self._created, self._added
        session.update_subscription = self._updated

    async def _created(self, *given: Any, **named: Any) -> Any:
        return self._published(await self._create(*given, **named))

    async def _updated(self, *given: Any) -> Any:
        return self._published(await self._update(*given))

    async def _added(self, given: Any) -> Any:
        results = await self._add(given)
        if len(results) != len(given.ItemsToCreate):
            msg = f"the server answers for {len(results)} tags of {len(given.ItemsToCreate)}"
            raise ConnectionError(msg)
        self.items += results
        return results

    def _published(self, result: Any) -> Any:
        self.publishing_ms = result.RevisedPublishingInterval
        if self.publishing_ms != 0.0 and not SHORTEST_MS <= self.publishing_ms <= LONGEST_MS:
            msg = f"the server grants a publishing every {self.publishing_ms:g} ms"
            raise ConnectionError(msg)
        return result
