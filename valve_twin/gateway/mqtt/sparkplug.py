# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Valves as devices of a Sparkplug B edge node; the bytes are pysparkplug's, the state is ours.

Sparkplug 3.0: the edge node is born with every connection (NBIRTH, then a DBIRTH for each device,
the sequence beginning at 0), says what has changed (DDATA), and its will is its death (NDEATH)
with the number of the birth it belongs to (bdSeq). All it hears is the wish to be born again.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, get_type_hints

from pysparkplug import (
    DataType,
    DBirth,
    DData,
    DDeath,
    MessageType,
    Metric,
    NBirth,
    NCmd,
    NData,
    NDeath,
    Topic,
)

from valve_twin import __version__
from valve_twin.gateway.mqtt.broker import Message
from valve_twin.gateway.mqtt.names import device_id
from valve_twin.gateway.plain import plain_valve
from valve_twin.io.errors import StoreError
from valve_twin.io.history.fleet import FleetRow
from valve_twin.report.text import utc

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from pysparkplug import MetricValue

    from valve_twin.core.types import Estimate
    from valve_twin.gateway.mqtt.backlog import Backlog
    from valve_twin.gateway.view import View

REBIRTH = "Node Control/Rebirth"
SEQUENCE = 256
"""Messages are numbered modulo this [1]."""

CYCLE = "cycles/cycle"
"""The metric that a stored cycle is known by."""

MOST_UNDER_WAY = 100
"""Stored cycles on their way at a time [1]."""

UNCONFIRMED_S = 30.0
"""What has not come back by then is sent again [s]."""

MOST_SILENT = 3
"""After so many rounds without a single message back our own data are hidden from us: what is
sent then counts as delivered [1]."""

BIRTHS_S = 1.0
"""Whoever asks for births gets one so often at most [s]."""

_KINDS = {int: DataType.INT64, float: DataType.DOUBLE}
_ROW_KINDS: Mapping[str, DataType] = {
    name: DataType.DATETIME if name.endswith("_ns") else _KINDS.get(kind, DataType.STRING)
    for name, kind in get_type_hints(FleetRow).items()
}
_OF_ESTIMATE = ("value", "standard_error", "lower_95", "upper_95")


class SparkplugSpeaker:
    """Speaks for the edge node GROUP/NODE.

    Parameters
    ----------
    group, node : str
        Its names.
    backlog : Backlog
        Which stored cycles the broker has, and the number of the next birth.
    """

    def __init__(self, group: str, node: str, backlog: Backlog) -> None:
        self._group, self._node = group, node
        self.backlog = backlog
        self._sequence = 0
        self._devices: dict[str, dict[str, Metric]] = {}
        self._valves: dict[str, str] = {}
        self._of_node: dict[str, Metric] = {}
        self._birth_number = 0
        self._born_s = -math.inf
        self._sent: dict[tuple[str, int], bytes] = {}
        self._shown: dict[str, tuple[object, ...]] = {}
        self._moved_s = 0.0
        self._silent = 0

    @property
    def subscriptions(self) -> tuple[str, ...]:
        """Topics to be heard: commands to the node, and our own data as the broker hands it on."""
        commands = self._topic(MessageType.NCMD)
        return commands, self._topic(MessageType.DDATA, "+")

    def look(self, view: View) -> None:
        """Take note of what there is: what comes later is owed, however late the broker is."""
        self.backlog.look(view)

    def will(self) -> Message:
        """Return the death that belongs to the next birth."""
        self._birth_number = self.backlog.next_birth()
        self._silent = 0
        return self._death()

    def born(self, view: View) -> list[Message]:
        """Return the births of the node and of all devices."""
        self._sequence, self._devices, self._shown = 0, {}, {}
        self._sent.clear()
        self.backlog.restart()
        self._born_s = time.monotonic()
        self._of_node = dict(self._node_metrics(view))
        metrics = (
            Metric(None, "bdSeq", DataType.INT64, value=self._birth_number),
            Metric(None, REBIRTH, DataType.BOOLEAN, value=False),
            *self._of_node.values(),
        )
        birth = NBirth(_now_ms(), self._next(), metrics)
        found = [self._message(MessageType.NBIRTH, birth.encode(include_dtypes=True))]
        return found + self._renewed(view)

    def changed(self, view: View) -> list[Message]:
        """Return what is new: metrics; devices that came, changed their shape or went."""
        found = []
        now = dict(self._node_metrics(view))
        if new := _new(self._of_node, now):
            self._of_node = now
            data = NData(_now_ms(), self._next(), new)
            found.append(self._message(MessageType.NDATA, data.encode(include_dtypes=True)))
        return found + self._renewed(view)

    def missed(self, view: View) -> list[Message]:
        """Return messages of stored cycles that the broker has not handed on, oldest first.

        The newest cycle of a valve is of now, the others are marked as history. Messages of
        Sparkplug may get lost in the broker (QoS 0): what does not come back is sent again.
        """
        now_s = time.monotonic()
        if self._sent and now_s - self._moved_s > UNCONFIRMED_S:
            self._sent.clear()
            self.backlog.restart()
            self._silent += 1
        if not self._sent:
            self._moved_s = now_s
        found: list[Message] = []
        if len(self._sent) > MOST_UNDER_WAY // 2:
            return found
        for valve, estimate, newest in self.backlog.take(view):
            message = self._of_estimate(valve, estimate, newest)
            found.append(message)
            if self._silent >= MOST_SILENT:
                self.backlog.confirm(valve, estimate.cycle)
            else:
                self._sent[device_id(valve), estimate.cycle] = message.payload
            if len(found) + len(self._sent) >= MOST_UNDER_WAY:
                break
        self.backlog.save()
        return found

    def _of_estimate(self, valve: str, estimate: Estimate, newest: bool) -> Message:
        name = device_id(valve)
        stamp = max(estimate.end_ns, 0) // 1_000_000
        born = self._devices[name]
        metrics = tuple(
            Metric(stamp, key, kind, value=value, is_historical=not newest)
            for key, kind, value in _of_cycle(estimate)
            if key in born
        )
        data = DData(_now_ms(), self._next(), metrics)
        return self._message(MessageType.DDATA, data.encode(include_dtypes=True), name)

    def heard(self, topic: str, payload: bytes) -> bool:
        """Return whether a birth is asked for; a stored cycle that comes back is delivered.

        What comes back has to be what was sent, byte by byte: what somebody else says on our
        topics delivers nothing.

        Parameters
        ----------
        topic, payload : str, bytes
            What the broker handed on; of foreign origin.
        """
        if topic == self._topic(MessageType.NCMD):
            return self._rebirth(payload)
        name = topic.rpartition("/")[2]
        cycle = next((c for (n, c), p in self._sent.items() if n == name and p == payload), None)
        if cycle is not None:
            del self._sent[name, cycle]
            self._moved_s, self._silent = time.monotonic(), 0
            if name in self._valves:
                self.backlog.confirm(self._valves[name], cycle)
        return False

    def awaits(self, payload: bytes) -> bytes | None:
        """Return the stored cycle that a payload is, as it was sent; None of anything else.

        Parameters
        ----------
        payload : bytes
            What the broker handed on; of foreign origin.
        """
        return next((sent for sent in list(self._sent.values()) if sent == payload), None)

    def _rebirth(self, payload: bytes) -> bool:
        """Return whether a command is one to be born again, and not too often."""
        try:
            asked = NCmd.decode(payload).metrics
            wanted = any(m.name == REBIRTH and m.value is True for m in asked)
        except Exception:  # whatever somebody else sends to our topics
            return False
        return wanted and time.monotonic() - self._born_s >= BIRTHS_S

    def farewell(self) -> list[Message]:
        """Return the death that is said at a clean end, which the broker's will does not say."""
        with suppress(StoreError):  # another one has our place
            self.backlog.save()
        return [self._death()]

    def _renewed(self, view: View) -> list[Message]:
        found = []
        self._valves = {device_id(row.valve): row.valve for row in view.rows}
        live = {n for n, valve in self._valves.items() if not view.is_stale(valve)}
        for name in [name for name in self._devices if name not in live]:
            del self._devices[name], self._shown[name]
            death = DDeath(_now_ms(), self._next())
            found.append(self._message(MessageType.DDEATH, death.encode(), name))
        for row in view.rows:
            name = device_id(row.valve)
            if name not in live:  # dead until the history can be read again
                continue
            shown = view.made_of(row)
            before_it = self._shown.get(name)
            if before_it and all(a is b for a, b in zip(before_it, shown, strict=True)):
                continue  # the history says nothing new of it
            self._shown[name] = shown
            metrics = dict(_metrics(view, row))
            before = self._devices.get(name)
            self._devices[name] = metrics
            if before is None or before.keys() != metrics.keys():
                birth = DBirth(_now_ms(), self._next(), tuple(metrics.values()))
                content = birth.encode(include_dtypes=True)
                found.append(self._message(MessageType.DBIRTH, content, name))
            elif new := _new(before, metrics):
                data = DData(_now_ms(), self._next(), new)
                content = data.encode(include_dtypes=True)
                found.append(self._message(MessageType.DDATA, content, name))
        return found

    def _node_metrics(self, view: View) -> Iterator[tuple[str, Metric]]:
        stamp = _now_ms()
        for name, kind, value in (
            ("Properties/version", DataType.STRING, f"valve_twin {__version__}"),
            ("history/place", DataType.STRING, view.where),
            ("history/readable", DataType.BOOLEAN, not view.failure),
            ("history/failure", DataType.STRING, view.failure),
        ):
            yield name, Metric(stamp, name, kind, value=value)

    def _death(self) -> Message:
        number = Metric(None, "bdSeq", DataType.INT64, value=self._birth_number)
        death = NDeath(_now_ms(), number)
        return self._message(MessageType.NDEATH, death.encode(include_dtypes=True), qos=1)

    def _next(self) -> int:
        sequence, self._sequence = self._sequence, (self._sequence + 1) % SEQUENCE
        return sequence

    def _topic(self, kind: MessageType, device: str | None = None) -> str:
        return str(Topic(self._group, kind, self._node, device))

    def _message(
        self, kind: MessageType, payload: bytes, device: str | None = None, qos: int = 0
    ) -> Message:
        return Message(self._topic(kind, device), payload, qos)


def _metrics(view: View, row: FleetRow) -> Iterator[tuple[str, Metric]]:
    """Yield the metrics of a valve: the JSON's keys, its cycles' parameters at the end."""
    plain: dict[str, Any] = plain_valve(view, row)
    stamp = max(row.end_ns, 0) // 1_000_000 or None
    parameters = plain.pop("parameters")
    for key, value in plain.items():
        if (kind := _ROW_KINDS.get(key)) is not None:
            name = _name(key)
            yield name, _metric(stamp, name, kind, value)
    for parameter in parameters:
        for key, value in parameter.items():
            kind = DataType.STRING if isinstance(value, str) else DataType.DOUBLE
            name = f"parameters/{parameter['parameter']}/{key}"
            yield name, _metric(stamp, name, kind, value)
    for name, kind in _cycle_kinds([p["parameter"] for p in parameters]):
        yield name, _metric(stamp, name, kind, None)


def _name(key: str) -> str:
    """Return the metric of a key: a time in ns is a time of its own type here."""
    plain = key.removesuffix("_ns")
    return f"{plain}_time" if plain != key and plain in _ROW_KINDS else plain


def _metric(stamp: int | None, name: str, kind: DataType, value: MetricValue | None) -> Metric:
    if isinstance(value, int) and kind is DataType.DATETIME:  # 0 = not known
        value = utc(value) if value else None
    return Metric(stamp, name, kind, value=value, is_null=value is None)


def _cycle_kinds(parameters: Sequence[str]) -> Iterator[tuple[str, DataType]]:
    """Yield names and types of what a stored cycle says of the followed parameters."""
    yield CYCLE, DataType.INT64
    for key in ("estimator", "status", "reason"):
        yield f"cycles/{key}", DataType.STRING
    for name in parameters:
        for key in _OF_ESTIMATE:
            yield f"cycles/{name}/{key}", DataType.DOUBLE


def _of_cycle(estimate: Estimate) -> Iterator[tuple[str, DataType, Any]]:
    names = [p.name for p in estimate.parameters]
    known = [getattr(p, key) for p in estimate.parameters for key in _OF_ESTIMATE]
    values = [
        estimate.cycle,
        estimate.estimator,
        estimate.status.name.lower(),
        estimate.reason,
        *(value if math.isfinite(value) else None for value in known),
    ]
    for (name, kind), value in zip(_cycle_kinds(names), values, strict=True):
        yield name, kind, value


def _new(before: Mapping[str, Metric], now: Mapping[str, Metric]) -> tuple[Metric, ...]:
    return tuple(m for name, m in now.items() if before[name].value != m.value)


def _now_ms() -> int:
    return time.time_ns() // 1_000_000
