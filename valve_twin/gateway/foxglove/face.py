# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Serves the valves of a history to Foxglove, in a thread of its own; it takes nothing."""

from __future__ import annotations

import logging
import queue
import threading
import time
from typing import TYPE_CHECKING

from foxglove import Channel, Context, Schema
from foxglove.websocket import ServerListener

from valve_twin.core.aging.verdict import TrendStatus
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.valves.registry import get_model
from valve_twin.gateway.foxglove.listener import Listener
from valve_twin.gateway.foxglove.messages import (
    DIAGNOSTICS,
    ESTIMATE,
    TREND,
    VERDICT,
    Condition,
    aging_bytes,
    diagnostics_bytes,
    estimate_bytes,
)
from valve_twin.io.bags.definitions import definition
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from foxglove.websocket import ChannelView, Client

    from valve_twin.core.aging.verdict import Trend, Verdict
    from valve_twin.core.types import Estimate
    from valve_twin.gateway.view import View
    from valve_twin.io.history.fleet import FleetRow

PERIOD_S = 1.0
"""What is shown is renewed so often [s]."""

PAUSE_S = 0.2
"""Who begins to look is told all so much later [s]."""

REST = 4.0
"""Between two steps lies so many times the computing of the last one [1]: clients that subscribe
again and again take a fifth of a core at most."""

PAST = 500
"""Newest stored cycles that who begins to look is told [1]."""

_OK, _WARN, _ERROR, _STALE = range(4)
_ESTIMATES = "/twin/estimate"
_LOGGER = logging.getLogger("valve_twin")


class _Subscriptions(ServerListener):
    """Notes the topics that somebody begins to look at; called by threads of the library."""

    def __init__(self) -> None:
        self._new: queue.SimpleQueue[str] = queue.SimpleQueue()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Note a topic."""
        del client
        self._new.put(channel.topic)

    def take(self) -> set[str]:
        """Return the topics since the last call."""
        found: set[str] = set()
        while True:
            try:
                found.add(self._new.get_nowait())
            except queue.Empty:
                return found


class FoxgloveFace:
    """Publishes on the topics of the nodes, in their messages, so that one layout serves both.

    Parameters
    ----------
    view : callable
        Returns what the history holds; may wait.
    estimates : callable
        Returns the estimates that feed a valve's trend: valve, first cycle, at most so many.
    host : str
        Address to listen at.
    port : int
        TCP port; 0 = any.
    """

    def __init__(
        self,
        view: Callable[[], View],
        estimates: Callable[[str, int, int], list[Estimate]],
        host: str,
        port: int,
    ) -> None:
        self._view, self._estimates = view, estimates
        self._subscriptions = _Subscriptions()
        self._context = Context()
        self._listener = Listener(self._context, self._subscriptions, host, port)
        self._channels: dict[str, Channel] = {}
        self._valves: dict[str, tuple[object, ...]] = {}
        self._cycles: dict[str, int] = {}
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="foxglove", daemon=True)

    def start(self) -> str:
        """Begin; return the address.

        Raises
        ------
        ConfigError
            If it cannot listen there.
        """
        self._step(self._view(), set(), periodic=False)  # who asks at once finds what there is
        address = self._listener.start()
        self._thread.start()
        return address

    def offer(self, topic: str, type_name: str) -> Channel | None:
        """Return a channel for what is live; None of a topic that the history speaks on.

        Parameters
        ----------
        topic, type_name : str
            As they are in ROS; what is logged is the serialized message.
        """
        if topic in self._channels:
            return None
        return _channel(topic, type_name, self._context)

    def stop(self) -> None:
        """End."""
        self._end.set()
        self._thread.join(10.0)
        self._listener.stop()

    def _run(self) -> None:
        due_s, told, pause_s = 0.0, "", PAUSE_S
        asked: set[str] = set()
        owed: set[str] = set()
        while not self._end.wait(pause_s):
            begun_s = time.thread_time()
            self._listener.look()
            asked |= self._subscriptions.take()
            now_s = time.monotonic()
            if not asked and now_s < due_s:
                pause_s = PAUSE_S
                continue
            if now_s >= due_s:
                asked, owed = asked | owed, set()
            failure = ""
            try:
                view = self._view()
                failure = view.failure
                self._step(view, asked, periodic=now_s >= due_s)
                told, asked = "", set()
            except ValveTwinError as err:
                if str(err) != told and not failure:  # else the history is told already
                    _LOGGER.warning("Foxglove: %s", err)
                told = str(err)
                owed |= {topic for topic in asked if topic.endswith(_ESTIMATES)}
                asked = set()
            except Exception:
                _LOGGER.exception("Foxglove: an error of ours")
            if now_s >= due_s:
                due_s = now_s + PERIOD_S
            pause_s = max(PAUSE_S, REST * (time.thread_time() - begun_s))

    def _step(self, view: View, asked: set[str], *, periodic: bool) -> None:
        """Say what is new, and all of what somebody begins to look at."""
        failed: ValveTwinError | None = None
        for row in view.rows:
            of = view.made_of(row)
            kept = self._valves.get(row.valve)
            new = kept is None or any(a is not b for a, b in zip(kept, of, strict=True))
            self._say_aging(view, row, asked, new=new)
            try:
                self._say_estimates(row, asked, new=new)
                self._valves[row.valve] = of
            except ValveTwinError as err:  # the history cannot be read: all else is said
                failed = err
        gone = set(self._valves) - {row.valve for row in view.rows}
        for valve in gone:
            self._forget(valve)
        channel = self._channel("/diagnostics", DIAGNOSTICS)
        if periodic and channel.has_sinks():
            channel.log(diagnostics_bytes(time.time_ns(), _conditions(view)))
        if failed is not None:
            raise failed

    def _say_aging(self, view: View, row: FleetRow, asked: set[str], *, new: bool) -> None:
        records: list[tuple[str, str, Trend | Verdict]] = [
            (f"{row.valve}/aging_monitor/trend/{t.parameter}", TREND, t)
            for t in view.trends.get(row.valve, ())
        ]
        verdict = view.verdicts.get(row.valve)
        if verdict is not None:
            records.append((f"{row.valve}/aging_monitor/verdict", VERDICT, verdict))
        for topic, kind, record in records:
            channel = self._channel(topic, kind)
            if (new or topic in asked) and channel.has_sinks():
                channel.log(aging_bytes(record))

    def _say_estimates(self, row: FleetRow, asked: set[str], *, new: bool) -> None:
        topic = f"{row.valve}{_ESTIMATES}"
        if not row.model or (not new and topic not in asked):
            return
        channel = self._channel(topic, ESTIMATE)
        said = self._cycles.get(row.valve, row.cycle)
        if channel.has_sinks():
            since = min(said, row.cycle) + 1  # a lower number is another history
            first = max(1, row.cycle - PAST + 1, 0 if topic in asked else since)
            units = _units(row.model)
            for estimate in self._estimates(row.valve, first, PAST):
                if estimate.cycle <= row.cycle:  # newer than the view: with the next one
                    channel.log(estimate_bytes(row.valve, estimate, units))
        self._cycles[row.valve] = row.cycle

    def _channel(self, topic: str, type_name: str) -> Channel:
        if topic not in self._channels:
            self._channels[topic] = _channel(topic, type_name, self._context)
        return self._channels[topic]

    def _forget(self, valve: str) -> None:
        del self._valves[valve]
        self._cycles.pop(valve, None)
        for topic in [t for t in self._channels if t.startswith(f"{valve}/")]:
            self._channels.pop(topic).close()


def _channel(topic: str, type_name: str, context: Context) -> Channel:
    schema = Schema(name=type_name, encoding="ros2msg", data=definition(type_name).encode())
    return Channel(topic, schema=schema, message_encoding="cdr", context=context)


def _units(model: str) -> dict[str, str]:
    """Return the unit of every parameter of a model; nothing of one that is not installed."""
    try:
        return {p.name: p.unit for p in get_model(model).parameters}
    except ValueError:
        return {}


def _conditions(view: View) -> Iterator[Condition]:
    """Yield the condition of the history and of every valve; names as those of the nodes."""
    level = _STALE if view.failure else _OK
    yield Condition("/serve: history", "", level, view.failure or "ok", {"where": view.where})
    for row in view.rows:
        trends = view.trends.get(row.valve, ())
        beyond = [t for t in trends if t.status is TrendStatus.BEYOND_THRESHOLD]
        failed = row.verdict.asks_for_help and row.ne107 == Ne107.FAILURE.value
        level = _ERROR if beyond or failed else _WARN if row.needs_attention else _OK
        level = _STALE if view.is_stale(row.valve) else level
        drifts = {f"{t.parameter} drift [%]": f"{t.drift_reference:.2f}" for t in trends}
        values = {
            "verdict": row.verdict.text,
            "NE 107": row.ne107,
            "failure mode (ISO 14224)": row.failure_mode,
            "action": row.action,
            "last cycle": str(row.cycle),
            **drifts,
        }
        name = f"/serve: aging of {row.valve}"
        yield Condition(name, row.valve, level, row.evidence or "ok", values)
