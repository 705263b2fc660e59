# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The gateway node: the pages of a history, with the moving plots of the twins that run."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from threading import Thread
from typing import TYPE_CHECKING, Any

from valve_twin.core.valves.registry import get_model
from valve_twin.gateway.faces import faces
from valve_twin.gateway.live.channel import Channels, LiveValve
from valve_twin.gateway.live.plot import MOST_COMMANDS
from valve_twin.gateway.live.told import Told
from valve_twin.gateway.page.accounts import Accounts
from valve_twin.gateway.page.samples import Samples
from valve_twin.gateway.plant import Plant
from valve_twin.gateway.serving import Background, Place, check_place
from valve_twin.gateway.web import Site, application
from valve_twin.io.config.gateway_parameters import GatewayParameters
from valve_twin.io.errors import ConfigError
from valve_twin.nodes.gateway.live_feed import LiveFeed
from valve_twin.nodes.gateway.readers import make_reader, own_context
from valve_twin.nodes.gateway.service_marker import ServiceMarker
from valve_twin.nodes.gateway.state_feed import StateFeed
from valve_twin.nodes.runtime.diagnostics import WARN, Diagnostics, Report
from valve_twin.nodes.runtime.node import STEADY, ValveNode
from valve_twin.nodes.twin.valve_parameters import read_valves

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rclpy.context import Context
    from rclpy.node import Node

    from valve_twin.gateway.faces import Faces
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.gateway.foxglove_relay import FoxgloveRelay

LOOK_S = 0.1
"""What came on the topics is looked for so often [s]."""

LIVE_EVERY = 2
"""Of these looks one takes what came of a valve that somebody looks at [1]: not all of them at the
same one, so that nobody waits for a burst."""

STATE_EVERY = 4
"""Of these looks one takes verdicts, last cycles and faults, whoever looks [1]."""


class GatewayNode(ValveNode):
    """Lifecycle node that shows valves in a browser; it publishes nothing that moves one."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("gateway", **kwargs)
        self._configs: dict[str, ValveConfig] = {}
        self._plant: Plant | None = None
        self._server: Background | None = None
        self._reader: Node | None = None
        self._live_reader: Node | None = None
        self._live: Context | None = None
        self._feeds: dict[str, LiveFeed] = {}
        self._watched: list[str] = []
        self._channels: Channels | None = None
        self._marker: ServiceMarker | None = None
        self._diagnostics: Diagnostics | None = None
        self._timer: Any = None
        self._faces = ExitStack()
        self._opened: Faces | None = None
        self._relay: FoxgloveRelay | None = None
        self._state: StateFeed | None = None
        self._looks = 0

    @property
    def address(self) -> str:
        """Where the pages are; empty while they are not served."""
        return self._server.address if self._server is not None else ""

    def configure(self) -> None:
        """Read the parameters."""
        where = self.get_fully_qualified_name()
        try:
            import prometheus_client  # noqa: F401
            import starlette  # noqa: F401
            import uvicorn  # noqa: F401
        except ModuleNotFoundError as err:
            msg = f"{where}: {err.name} is missing: pip install valve_twin[gateway]"
            raise ConfigError(msg) from err
        self._configs = {config.name: config for config in read_valves(self)}
        urls = {config.history_url for config in self._configs.values()}
        if len(urls) > 1:
            msg = f"{where}: history_url: {', '.join(sorted(urls))}: one gateway shows one history"
            raise ConfigError(msg)
        aging = {name: config.aging for name, config in self._configs.items()}
        plates = {name: config.nameplate.given for name, config in self._configs.items()}
        self._told = Told({name: config.model for name, config in self._configs.items()})
        self._plant = Plant(next(iter(urls)), aging, plates, self._told, waits=True)
        given = self._given = self.parameters.read(GatewayParameters)
        place = Place(given.host, given.port, given.certificate, given.key)
        told = check_place(place, accounts=bool(given.users))
        if told:
            self.get_logger().warning(told)
        self._place = place
        self._accounts = Accounts(given.users, self._tell) if given.users else None
        self._samples = Samples([bag for bag in given.bags if bag])
        self._diagnostics = Diagnostics(self, self._reports)

    def activate(self) -> None:
        """Serve the pages."""
        assert self._plant is not None
        self._reader = make_reader(self, f"{self.get_name()}_reader", self.context)
        self._live = own_context(self.context)
        self._live_reader = make_reader(self, f"{self.get_name()}_live_reader", self._live)
        self._state = StateFeed(self._reader, self._configs, self._told)
        live = {
            name: LiveValve(partial(self._on_watched, name), news=partial(self._told.number, name))
            for name in self._configs
        }
        self._feeds = {
            name: LiveFeed(self._live_reader, self._configs[name], valve)
            for name, valve in live.items()
        }
        self._marker = ServiceMarker(self, self._configs) if self._accounts else None
        self._channels = Channels(live)
        site = Site(
            live=self._channels,
            commands={name: _commands(config) for name, config in self._configs.items()},
            samples=self._samples,
            accounts=self._accounts,
            marker=self._marker,
            secure=self._place.secure,
        )
        self._opened = self._faces.enter_context(faces(self._plant, self._given, self._tell))
        foxglove = self._opened.foxglove
        if foxglove is not None:
            from valve_twin.nodes.gateway.foxglove_relay import FoxgloveRelay

            self._relay = FoxgloveRelay(self._live_reader, foxglove, self._configs)
        self._server = Background(application(self._plant, site), self._place, self._tell)
        Thread(target=self._plant.glance, daemon=True).start()  # read before somebody looks
        self._timer = self.create_timer(LOOK_S, self._look, clock=STEADY)
        self.get_logger().info(f"{len(self._configs)} valves at {self._server.address}")

    def deactivate(self) -> None:
        """Serve the pages no longer."""
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None
        if self._channels is not None:
            self._channels.close()
            self._channels = None
        if self._server is not None:
            self._server.stop()
            self._server = None
        if self._relay is not None:
            self._relay.end()
            self._relay = None
        self._faces.close()
        self._opened = None
        for feed in self._feeds.values():
            feed.end()
        self._feeds, self._watched = {}, []
        if self._state is not None:
            self._state.end()
            self._state = None
        if self._marker is not None:
            self._marker.destroy()
            self._marker = None
        if self._reader is not None:
            self._reader.destroy_node()
            self._reader = None
        if self._live_reader is not None:
            self._live_reader.destroy_node()
            self._live_reader = None
        if self._live is not None:
            self._live.try_shutdown()
            self._live = None

    def cleanup(self) -> None:
        """Let go of everything."""
        if self._diagnostics is not None:
            self._diagnostics.destroy()
            self._diagnostics = None
        self._configs, self._plant = {}, None

    def _on_watched(self, valve: str, watched: bool) -> None:
        """Take note on the server's thread that somebody begins to look, or nobody does."""
        self.post(partial(self._watch, valve, begin=watched))

    def _watch(self, valve: str, *, begin: bool) -> None:
        feed = self._feeds.get(valve)
        if feed is None:
            return
        if begin:
            feed.begin()
            self._watched = [*self._watched, valve]
        else:
            feed.end()
            self._watched = [other for other in self._watched if other != valve]

    def _look(self) -> None:
        for valve in self._watched[self._looks % LIVE_EVERY :: LIVE_EVERY]:
            self._feeds[valve].look()
        if self._state is not None and self._looks % STATE_EVERY == 0:
            self._state.look()
        self._looks += 1
        if self._relay is not None:
            self._relay.look()

    def _tell(self, text: str) -> None:
        self.post(partial(self.get_logger().info, text))

    def _reports(self) -> Iterable[Report]:
        report = Report("pages", self.get_namespace())
        report.values = {
            "address": self.address or "not served",
            "valves": len(self._configs),
            "moving plots": len(self._watched),
        }
        closed = self._opened.closed if self._opened is not None else ()
        failure = self._plant.failure if self._plant is not None else ""
        for problem in (failure, *closed):
            if problem:
                report.raise_to(WARN, problem)
        return [report]


def _commands(config: ValveConfig) -> tuple[str, ...]:
    """Return the names of the commands that are drawn, in their order."""
    names = [name for name in get_model(config.model).inputs if name in config.signals]
    return tuple(names[:MOST_COMMANDS])
