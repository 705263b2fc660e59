# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The moving plot told to any number of viewers: drawn once, sent to each who keeps up.

Who feeds a valve never waits for who looks: it leaves its samples under a lock and goes. A viewer
that does not read holds up nobody and gets the whole window when it reads again.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from valve_twin.gateway.live.plot import LivePlot
from valve_twin.report.text import NONE, fixed

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Callable, Mapping

    from valve_twin.core.types import FloatArray, IntArray

TICK_S = 0.2
"""What is new is told so often [s]."""

TURNS = 4
"""Turns within a tick [1]: the valves of one are drawn behind each other, at less than half of
what each costs at a time of its own; not all are at once, so that nobody waits for a burst."""

STALE_S = 2.0
"""A valve without values for longer is stale [s]; a page says so within a tick more."""

MOST_VIEWERS = 200
"""Viewers of all valves at a time [1]."""


@dataclass(slots=True)
class Frame:
    """What is told at one tick.

    Attributes
    ----------
    number : int
        Of the tick [1].
    anew : bool
        Whether what a viewer has does not count any more.
    more : bytes
        For who had the frame before.
    whole : bytes
        For everybody else; empty until somebody needs it.
    """

    number: int
    anew: bool
    more: bytes
    whole: bytes = b""


class LiveValve:
    """What one valve says now; fed by one thread, looked at by another.

    Parameters
    ----------
    watched : callable
        Told True when somebody begins to look, and False when nobody does any more.
    clock : callable
        Returns a time that only goes on [s].
    news : callable
        Returns what grows whenever the page beside the plot says something new [1].
    """

    def __init__(
        self,
        watched: Callable[[bool], None] = lambda _: None,
        clock: Callable[[], float] = time.monotonic,
        news: Callable[[], int] = lambda: 0,
    ) -> None:
        self._watched, self._clock, self._news = watched, clock, news
        self._lock = threading.Lock()
        self._plot = LivePlot()
        self._heard_s: float | None = None
        self._since_s = clock()
        self._stamp_ns = self._number = self._viewers = 0
        self._values: dict[str, float] = {}
        self._cycle = 0

    def take(
        self,
        stamp_ns: IntArray,
        curves: Mapping[str, FloatArray],
        sigma: float = math.nan,
        cycle: int = 0,
    ) -> None:
        """Take samples of one topic; see `LivePlot.add`.

        Parameters
        ----------
        stamp_ns : (N,) int64 array
            Stamps, not decreasing [ns].
        curves : mapping of (N,) arrays
            Values by curve; of predictions `measured` is among them.
        sigma : float
            Expected standard deviation of the residual [1].
        cycle : int
            Number of the running cycle [1].
        """
        if not len(stamp_ns):
            return
        with self._lock:
            self._plot.add(stamp_ns, curves, sigma)
            self._values.update({name: float(v[-1]) for name, v in curves.items()})
            if "measured" in curves:
                self._heard_s, self._cycle = self._clock(), cycle
                self._stamp_ns = int(stamp_ns[-1])

    def join(self) -> None:
        """Count one more who looks."""
        self._viewers += 1
        if self._viewers == 1:
            with self._lock:
                self._since_s, self._heard_s = self._clock(), None
                self._plot.interrupt()  # nobody knows what was while nobody looked
            self._watched(True)

    def leave(self) -> None:
        """Count one less who looks."""
        self._viewers -= 1
        if self._viewers == 0:
            self._watched(False)

    def frame(self) -> Frame:
        """Draw what is new and say how the valve stands."""
        with self._lock:
            drawn = self._plot.draw()
            self._number += 1
            state = self._state()
            if drawn.anew:
                return Frame(self._number, anew=True, more=b"", whole=self._whole(state))
            state |= {"slices": drawn.slices, "right": round(self._plot.right, 2)}
        return Frame(self._number, anew=False, more=_event(state))

    def whole(self, frame: Frame) -> bytes:
        """Return the whole window for who lacks what came before."""
        if not frame.whole:
            with self._lock:
                frame.whole = self._whole(self._state())
        return frame.whole

    def _whole(self, state: dict[str, object]) -> bytes:
        plot = self._plot
        axes = {"axes": plot.axes(), "slices": plot.all(), "right": round(plot.right, 2)}
        return _event({**state, **axes})

    def _state(self) -> dict[str, object]:
        now_s = self._clock()
        quiet_s = now_s - (self._since_s if self._heard_s is None else self._heard_s)
        state = "waiting" if self._heard_s is None else "live"
        if quiet_s > STALE_S:
            state = "stale"
        values = {name: shown(v) for name, v in self._values.items()}
        return {
            "state": state,
            "quiet": round(quiet_s),
            "stamp": self._stamp_ns // 1_000_000,
            "news": self._news(),
            "values": values | {"cycle": str(self._cycle)},
        }


def shown(value: float) -> str:
    """Return a value as it stands beside the plot."""
    return fixed(value, 5) if math.isfinite(value) else NONE


_ENCODER = json.JSONEncoder(separators=(",", ":"))


def _event(content: Mapping[str, object]) -> bytes:
    return f"data: {_ENCODER.encode(content)}\n\n".encode()


def _until(turn_s: float, now_s: float) -> float:
    """Return how long to wait for the next turn [s]: half a tick at least, as timers are early."""
    wait_s = TICK_S - (now_s - turn_s) % TICK_S
    return wait_s if wait_s >= 0.5 * TICK_S else wait_s + TICK_S


class Channels:
    """The viewers of all valves, on one event loop.

    Parameters
    ----------
    valves : mapping
        What is fed, by name of the valve.
    """

    def __init__(self, valves: Mapping[str, LiveValve]) -> None:
        self._valves = dict(valves)
        self._viewers: dict[str, int] = {}
        self._fresh: dict[str, asyncio.Future[Frame]] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._turns = itertools.count()
        self._closed = False

    def close(self) -> None:
        """Let all viewers go at the next tick; from any thread."""
        self._closed = True

    def __contains__(self, valve: str) -> bool:
        """Return whether a valve is fed."""
        return valve in self._valves

    @property
    def full(self) -> bool:
        """Whether nobody more may look."""
        return sum(self._viewers.values()) >= MOST_VIEWERS

    async def events(self, valve: str) -> AsyncGenerator[bytes, None]:
        """Yield server-sent events of a valve until the viewer goes."""
        source = self._valves[valve]
        self._viewers[valve] = self._viewers.get(valve, 0) + 1
        source.join()
        if valve not in self._tasks:
            self._fresh[valve] = asyncio.get_running_loop().create_future()
            self._tasks[valve] = asyncio.create_task(self._tick(valve))
        had = -1
        try:
            yield b"retry: 1000\n\n"
            while True:
                frame = await asyncio.shield(self._fresh[valve])
                follows = frame.number == had + 1 and not frame.anew
                had = frame.number
                if self._closed:
                    return
                yield frame.more if follows else source.whole(frame)
        finally:
            source.leave()
            self._viewers[valve] -= 1
            if not self._viewers[valve]:
                self._tasks.pop(valve).cancel()
                self._fresh.pop(valve).cancel()

    async def _tick(self, valve: str) -> None:
        """Draw once a tick for all viewers of a valve."""
        loop = asyncio.get_running_loop()
        turn_s = TICK_S * (next(self._turns) % TURNS) / TURNS
        while True:
            await asyncio.sleep(_until(turn_s, loop.time()))
            told = self._fresh[valve]
            self._fresh[valve] = loop.create_future()
            if not told.done():
                told.set_result(self._valves[valve].frame())
