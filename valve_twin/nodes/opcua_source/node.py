# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The opcua_source node: publishes tags of a PLC with the stamps of their source."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from std_msgs.msg import Header
from valve_twin_msgs.msg import Float64Series, Float64Stamped

from valve_twin.io.config.node_parameters import OpcuaSourceParameters
from valve_twin.io.errors import ConfigError
from valve_twin.nodes.opcua_source.series import Grid
from valve_twin.nodes.opcua_source.subscription import Figures, Server, TagSubscription
from valve_twin.nodes.opcua_source.tags import Sample, Tag, read_tags
from valve_twin.nodes.player.outbox import sending_profile
from valve_twin.nodes.runtime.diagnostics import WARN, Diagnostics, Report
from valve_twin.nodes.runtime.node import ValveNode
from valve_twin.nodes.runtime.safety import Guard, PublishedTopic
from valve_twin.nodes.runtime.stamps import to_time

if TYPE_CHECKING:
    from collections.abc import Iterable

CLOCK_S = 60.0
"""Stamps further than this from this machine's clock are told, assumed [s]."""

MOST_NAMED = 10
"""Of more missing tags one line tells the number and the first [1]."""

PASSWORD = "VALVE_TWIN_OPCUA_PASSWORD"
"""Environment variable with the password: parameters can be read by everybody in the domain."""


class OpcuaSourceNode(ValveNode):
    """Lifecycle node that subscribes tags and never writes one."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("opcua_source", **kwargs)
        self._tags: tuple[Tag, ...] = ()
        self._subscription: TagSubscription | None = None
        self._publishers: list[Any] = []
        self._grids: list[Grid] = []
        self._diagnostics: Diagnostics | None = None
        self._told: dict[str, int] = {}
        self._told_doubts: set[str] = set()

    def configure(self) -> None:
        """Read the parameters."""
        given = self._given = self.parameters.read(OpcuaSourceParameters)
        where = self.get_fully_qualified_name()
        try:
            from asyncua import ua
        except ModuleNotFoundError as err:
            msg = f"{where}: {err.name} is missing: pip install valve_twin[gateway]"
            raise ConfigError(msg) from err
        self._tags = read_tags(given.tags, self.get_namespace(), given.publish_prefix, where=where)
        for tag in self._tags:
            try:
                ua.NodeId.from_string(tag.node)
            except (ua.UaError, ValueError) as err:
                msg = f"{where}: tags: '{tag.node}' is no node id: write ns=3;s=NAME or ns=3;i=7"
                raise ConfigError(msg) from err
        if not given.address.startswith("opc.tcp://"):
            msg = f"{where}: address: '{given.address}' is none: write opc.tcp://HOST:4840"
            raise ConfigError(msg)
        if given.pki:
            from valve_twin.gateway.opcua.access import check_pair

            check_pair(Path(given.pki).expanduser())
        self._guard = Guard(self, prefix=given.publish_prefix, allow_live=given.allow_live)
        self._diagnostics = Diagnostics(self, self._reports)

    def activate(self) -> None:
        """Check that no real valve is in reach, then subscribe."""
        given = self._given
        real = not given.publish_prefix.strip("/")  # a twin takes what has a prefix, a valve not
        self._guard.check([PublishedTopic(tag.topic, command=real) for tag in self._tags])
        kind = Float64Series if given.period_s else Float64Stamped
        self._publishers = [
            self.create_publisher(kind, tag.topic, sending_profile()) for tag in self._tags
        ]
        self._grids = [Grid(given.period_s) for _ in self._tags]
        self._told.clear()  # a subscription counts anew
        server = Server(
            given.address,
            given.user,
            os.environ.get(PASSWORD, ""),
            given.pki,
            given.publishing_ms,
            given.sampling_ms,
            given.queue,
            given.period_s,
        )
        nodes = [tag.node for tag in self._tags]
        self._subscription = TagSubscription(server, nodes, lambda: self.post(self._publish))

    def deactivate(self) -> None:
        """Unsubscribe."""
        if self._subscription is not None:
            self._subscription.close()
            self._publish()
            self._subscription = None
        for publisher in self._publishers:
            self.destroy_publisher(publisher)
        self._publishers = []

    def cleanup(self) -> None:
        """Let go of everything."""
        if self._diagnostics is not None:
            self._diagnostics.destroy()
            self._diagnostics = None
        self._tags = ()

    def _publish(self) -> None:
        if self._subscription is None:
            return
        samples = self._subscription.take()
        now_ns = time.time_ns()
        by_tag: dict[int, list[Sample]] = {}
        for sample in samples:
            by_tag.setdefault(sample.tag, []).append(sample)
        for tag, found in by_tag.items():
            grid, publisher = self._grids[tag], self._publishers[tag]
            for start_ns, values in grid.sorted(found, now_ns):
                header = Header(stamp=to_time(start_ns))
                if self._given.period_s:
                    period_s = self._given.period_s
                    publisher.publish(Float64Series(header=header, period=period_s, values=values))
                else:
                    publisher.publish(Float64Stamped(header=header, value=values[0]))

    def _reports(self) -> Iterable[Report]:
        given, subscription = self._given, self._subscription
        report = Report(f"tags of {given.address}", self.get_namespace())
        if subscription is None:
            return [report]
        figures = subscription.figures
        report.values = {
            "connected": figures.connected,
            "connections": figures.connections,
            "samples": sum(grid.samples for grid in self._grids),
            "masked (status not good)": sum(grid.masked for grid in self._grids),
            "lost (stamps missing)": sum(grid.missing for grid in self._grids),
            "not heard (no connection)": sum(grid.unheard for grid in self._grids),
            "lost (queue of the server), at least": figures.overflows,
            "lost (this node too slow)": figures.dropped,
            "messages that cannot be read": figures.unread,
            "stamped before the one before": sum(grid.late for grid in self._grids),
            "repeated after a connection": sum(grid.repeated for grid in self._grids),
            "sent every [ms]": f"{figures.publishing_ms:g}",
            "clock of the PLC ahead [s]": f"{figures.ahead_s:.3f}",
        }
        gone = "" if figures.connected else f"{given.address}: {figures.trouble}"
        self.faults.look("input.silent", gone, valve=report.hardware_id, subject=given.address)
        self._look_for_missing(dict(figures.unknown), report.hardware_id)
        self._tell_lost(figures, report.hardware_id)
        doubts = {f"{given.address}: {d}" for d in (figures.doubt, figures.moved) if d}
        for doubt in sorted(doubts):
            report.raise_to(WARN, doubt)
            if doubt not in self._told_doubts:
                self.get_logger().warning(doubt)
        self._told_doubts = doubts or self._told_doubts
        if abs(figures.ahead_s) > CLOCK_S:
            text = f"the PLC's clock is {figures.ahead_s:+.0f} s from this machine's"
            report.raise_to(WARN, text)
        return [report]

    def _new(self, what: str, count: int) -> int:
        """Return how many of a kind came since the last time."""
        before = self._told.get(what, 0)
        self._told[what] = max(before, count)
        return max(count - before, 0)

    def _tell_lost(self, figures: Figures, valve: str) -> None:
        """Tell what was lost since the last time, and stamps that no twin can use."""
        losses = (self._unread(figures), self._dropped(figures), self._missing(figures))
        for events, text in losses:
            if events:
                evidence = f"{self._given.address}: {text}"
                self.faults.report("input.loss", evidence, valve=valve, events=events)
        late = self._new("late", sum(grid.late for grid in self._grids))
        if late:
            worst = max(range(len(self._tags)), key=lambda tag: self._grids[tag].late)
            evidence = (
                f"{self._given.address}: {late} samples are stamped before the one before, of "
                f"{self._tags[worst].node} the most, {self._grids[worst].late} in all"
            )
            self.faults.report("stamps.late", evidence, valve=valve, events=late)

    def _unread(self, figures: Figures) -> tuple[int, str]:
        new = self._new("unread", figures.unread)
        text = f"{new} messages of the server cannot be read, whatever samples they held"
        return new, f"{text}: {figures.unread_why}"

    def _dropped(self, figures: Figures) -> tuple[int, str]:
        """Return what nobody took in time; where stamps tell what is missing, it is among that."""
        if self._given.period_s:
            return 0, ""
        new = self._new("dropped", figures.dropped)
        return new, _slow(new)

    def _missing(self, figures: Figures) -> tuple[int, str]:
        """Return what was lost on the way: by stamps, else what the server says."""
        given = self._given
        if not given.period_s:
            new = self._new("lost", figures.overflows)
            text = f"a queue of the server overflowed {new} times: one sample or more is lost each"
            more = "; set period_s to have samples counted"
            return new, f"{text}: {figures.doubt or _sends(figures) + more}"
        new = self._new("lost", sum(grid.missing for grid in self._grids))
        worst = max(range(len(self._tags)), key=lambda tag: self._grids[tag].missing)
        where = f"{self._tags[worst].node} the most, {self._grids[worst].missing} in all"
        dropped = self._new("dropped", figures.dropped) if new else 0
        why = _slow(dropped) if dropped else figures.doubt or _sends(figures)
        return new, f"{new} samples are missing by their stamps, of {where}: {why}"

    def _look_for_missing(self, unknown: dict[int, str], valve: str) -> None:
        """Tell the tags that the server does not know, each or, where they are many, in a line."""
        many = len(unknown) > MOST_NAMED
        for number, tag in enumerate(self._tags):
            why = "" if many else unknown.get(number)
            evidence = f"{tag.topic}: the server has no tag {tag.node} ({why})" if why else ""
            self.faults.look("input.missing", evidence, valve=valve, subject=tag.topic)
        evidence = ""
        if many:
            first = min(unknown)
            evidence = (
                f"the server has none of {len(unknown)} of {len(self._tags)} tags, the first is "
                f"{self._tags[first].node} ({unknown[first]})"
            )
        self.faults.look("input.missing", evidence, valve=valve, subject=self._given.address)


def _slow(dropped: int) -> str:
    text = f"{dropped} samples came faster than this node publishes: let the server sample slower"
    return f"{text} (sampling_ms), or give the process more computing time"


def _sends(figures: Figures) -> str:
    every = f"the server sends every {figures.publishing_ms:g} ms"
    return f"{every}: look at the load of PLC and network"
