# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A server of OPC UA that shows the valves of a plant as devices; nothing in it can be written."""

from __future__ import annotations

import asyncio
import logging
import threading
from contextlib import suppress
from datetime import datetime, timezone
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from asyncua import Server, ua

from valve_twin import __version__
from valve_twin.compat.opcua import bound_arrays
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.gateway.opcua import devices
from valve_twin.gateway.opcua.access import APPLICATION
from valve_twin.gateway.opcua.alarms import send, tell_health
from valve_twin.gateway.opcua.nodes import Builder, Ids
from valve_twin.gateway.opcua.standard import StandardServer
from valve_twin.gateway.opcua.valve_nodes import ValveNodes, stamp
from valve_twin.gateway.plain import plain_valve
from valve_twin.io.errors import ConfigError, ValveTwinError
from valve_twin.io.uncollected import uncollected

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.gateway.opcua.access import Access
    from valve_twin.gateway.view import View

URI = "urn:valve_twin:valves"
"""Namespace of the valves."""

PERIOD_S = 1.0
"""What is shown is renewed so often [s]."""

EAGER_S = 0.1
"""The same until the history was read for the first time [s]."""

MOST_UNREAD = 8_000_000
"""A client that has so much waiting for it and does not read is let go [bytes]."""

_V = ua.VariantType
_LOGGER = logging.getLogger("valve_twin")
_START_S = 120.0
_STALE = ua.StatusCode(ua.StatusCodes.UncertainLastUsableValue)
_UNKNOWN = ua.StatusCode(ua.StatusCodes.BadNoData)
_GOOD = ua.StatusCode(ua.StatusCodes.Good)
_EVENT = "VerdictChangedEventType"
_EVENT_FIELDS = {
    "Verdict": "verdict",
    "Evidence": "evidence",
    "Action": "action",
    "State": "ne107",
}


class OpcUaFace:
    """Shows a plant to clients of OPC UA, in a thread of its own.

    Parameters
    ----------
    view : callable
        Returns what is to be shown; may wait.
    address : str
        opc.tcp://HOST:PORT to listen at.
    access : Access
        Who may look.

    Raises
    ------
    ConfigError
        If the address is none.
    """

    def __init__(self, view: Callable[[], View], address: str, access: Access) -> None:
        self._view, self._access = view, access
        self._host, self._port = host_and_port(address)
        self._thread = threading.Thread(target=self._run, name="opcua", daemon=True)
        self._ready = threading.Event()
        self._failure: Exception | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end = asyncio.Event()
        self._valves: dict[str, tuple[ValveNodes, tuple[str, ...]]] = {}
        self._shown: dict[ua.NodeId, ua.DataValue] = {}
        self._said: dict[str, tuple[str, str]] = {}

    def start(self) -> str:
        """Listen; return the address.

        Raises
        ------
        ValveTwinError
            If that is not possible.
        """
        self._thread.start()
        self._ready.wait(_START_S)
        if self._failure is not None:
            if isinstance(self._failure, ValveTwinError):
                raise self._failure
            msg = f"OPC UA: cannot start: {type(self._failure).__name__}: {self._failure}"
            raise ValveTwinError(msg) from self._failure
        return f"opc.tcp://{self._host}:{self._port}"

    def stop(self) -> None:
        """Say goodbye to all clients."""
        if self._loop is not None and self._thread.is_alive():
            with suppress(RuntimeError):  # it ends just now
                self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(10.0)

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as err:  # told by start
            self._failure = err
        finally:
            self._ready.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        server = await self._made()
        try:
            try:
                await server.start()
            except OSError as err:
                where = f"{self._host}:{self._port}"
                msg = (
                    f"OPC UA: cannot listen at {where}: {err.strerror or err}: choose another port"
                )
                raise ValveTwinError(msg) from err
            self._port = server.bserver.port
            self._ready.set()
            while not self._end.is_set():
                begins = False
                try:
                    begins = await self._renew(server)
                except Exception:  # whatever is stored: what is shown stays, and is tried again
                    _LOGGER.exception("OPC UA: cannot show what is new")
                self._let_go(server)
                with suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(self._end.wait(), EAGER_S if begins else PERIOD_S)
        finally:
            with suppress(Exception):  # of a server that has not started
                await server.stop()

    async def _made(self) -> Server:
        trusted = await self._access.prepare()  # first: a disk that holds it up is tried again
        bound_arrays()
        server = Server(StandardServer())
        with uncollected():
            await server.init()
        host = f"[{self._host}]" if ":" in self._host else self._host
        server.set_endpoint(f"opc.tcp://{host}:{self._port}")
        server.socket_address = (self._host, self._port)
        server.set_server_name("valve_twin")
        await server.set_application_uri(APPLICATION)
        today = datetime.now(timezone.utc)
        await server.set_build_info(
            APPLICATION, "valve_twin", "valve_twin", __version__, "", today
        )
        inner = server.iserver
        inner.allow_remote_admin = False
        inner.max_connections, inner.max_subscriptions = 100, 200
        inner.max_unacked_messages_per_subscription = 100
        inner.max_monitored_item_queue_size = 100
        await self._access.apply(server, trusted)
        self._model = devices.DeviceModel(await server.register_namespace(devices.URI))
        self._index = await server.register_namespace(URI)
        build = Builder(server)
        self._model.add_types(build)
        self._add_history(build)
        await build.build()
        fields = [(name, _V.String) for name in _EVENT_FIELDS]
        self._event = await server.create_custom_event_type(
            self._index, _EVENT, Ids.BaseEventType, [*fields, ("Cycle", _V.Int64)]
        )
        await self._renew(server)
        return server

    def _add_history(self, build: Builder) -> None:
        node = self._history()
        build.add_object(
            ua.NodeId(Ids.ObjectsFolder), node, ua.QualifiedName("History", self._index)
        )
        for name, value in (
            ("Place", ua.Variant("")),
            ("Failure", ua.Variant("")),
            ("Readable", ua.Variant(False)),
            ("ReadTime", ua.Variant(datetime.min.replace(tzinfo=timezone.utc))),
        ):
            build.add_variable(
                node, self._history(name), ua.QualifiedName(name, self._index), value
            )

    def _history(self, *path: str) -> ua.NodeId:
        return ua.NodeId("#".join(("History", *path)), self._index)

    async def _renew(self, server: Server) -> bool:
        """Show what has changed: a valve that is new gets a device, one that is gone loses it.

        Return whether the history is still being read for the first time.
        """
        view = await asyncio.to_thread(self._view)
        for name, value in (
            ("Place", ua.Variant(view.where, _V.String)),
            ("Failure", ua.Variant(view.failure, _V.String)),
            ("Readable", ua.Variant(not view.failure)),
            ("ReadTime", _time(view.read_ns)),
        ):
            await self._show(server, self._history(name), value, _GOOD, None)
        rows = {row.valve: plain_valve(view, row) for row in view.rows}
        for valve in [v for v in self._said if v not in rows]:
            await self._end_alarm(server, valve)
        for valve in [
            v
            for v, (_, layout) in self._valves.items()
            if v not in rows or _layout(rows[v]) != layout
        ]:
            await self._remove(server, valve)
        new = [valve for valve in rows if valve not in self._valves]
        for valve in new:
            build = Builder(server)
            nodes = ValveNodes(valve, self._index, self._model)
            nodes.add(build, rows[valve])
            await build.build()
            self._valves[valve] = nodes, _layout(rows[valve])
        for valve, plain in rows.items():
            time = stamp(plain["end_ns"])  # type: ignore[arg-type]
            status = _STALE if view.is_stale(valve) else _GOOD
            for node, value in self._valves[valve][0].values(plain):
                await self._show(server, node, value, status, time)
            await self._tell(server, valve, plain)
        return not view.whole and not view.failure

    async def _show(
        self,
        server: Server,
        node: ua.NodeId,
        value: ua.Variant,
        status: ua.StatusCode,
        time: datetime | None,
    ) -> None:
        found = _UNKNOWN if value.Value is None else status
        kept = self._shown.get(node)
        if kept is not None and (kept.Value, kept.StatusCode, kept.SourceTimestamp) == (
            value,
            found,
            time,
        ):
            return
        shown = ua.DataValue(value, StatusCode=found, SourceTimestamp=time)
        await server.write_attribute_value(node, shown)
        self._shown[node] = shown

    async def _remove(self, server: Server, valve: str) -> None:
        nodes, _ = self._valves.pop(valve)
        await server.delete_nodes([server.get_node(nodes.device)], recursive=True)
        start = f"{valve}#"
        self._shown = {
            n: v for n, v in self._shown.items() if not str(n.Identifier).startswith(start)
        }

    async def _tell(self, server: Server, valve: str, plain: Mapping[str, Any]) -> None:
        """Send an event where the verdict or the state of a valve is another one than before."""
        now = plain["verdict"], plain["ne107"]
        before = self._said.get(valve)
        self._said[valve] = now
        if before == now:
            return
        text = f"{valve}: {plain['verdict']} ({plain['ne107']}): {plain['evidence']}"
        states = Ne107(before[1]) if before else Ne107.GOOD, Ne107(plain["ne107"])
        await tell_health(server, self._valves[valve][0], *states, text)
        if before is None:
            return
        device = self._valves[valve][0].device
        generator = await server.get_event_generator(self._event, emitting_node=device)
        event = generator.event
        event.Severity = Ne107(plain["ne107"]).severity
        for name, key in _EVENT_FIELDS.items():
            setattr(event, name, plain[key])
        event.Cycle = plain["cycle"]
        await send(server, generator, text)

    async def _end_alarm(self, server: Server, valve: str) -> None:
        """End the alarm of a valve that is gone, while there is a node to end it of."""
        _, state = self._said.pop(valve)
        await tell_health(server, self._valves[valve][0], Ne107(state), Ne107.GOOD, "")

    def _let_go(self, server: Server) -> None:
        for client in list(server.bserver.clients):
            transport = client.transport
            if transport is not None and transport.get_write_buffer_size() > MOST_UNREAD:
                _LOGGER.warning("OPC UA: %s does not read: let go", client.peer_name)
                transport.abort()


def _time(stamp_ns: int) -> ua.Variant:
    found = stamp(stamp_ns)
    return ua.Variant() if found is None else ua.Variant(found, _V.DateTime)


def _layout(plain: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what the nodes of a valve depend on."""
    return (plain["model"], *(f"{p['parameter']} {p['unit']}" for p in plain["parameters"]))


def host_and_port(address: str) -> tuple[str, int]:
    """Return host and port of opc.tcp://HOST:PORT.

    Raises
    ------
    ConfigError
        If it is none.
    """
    with suppress(ValueError):
        parts = urlsplit(address)
        if parts.scheme == "opc.tcp" and parts.hostname and parts.port is not None:
            return parts.hostname, parts.port
    msg = f"OPC UA: '{address}' is no address: write opc.tcp://127.0.0.1:4840"
    raise ConfigError(msg)
