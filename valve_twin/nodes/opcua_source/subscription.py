# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A subscription of a PLC's tags that outlives its server; in a thread of its own, without ROS."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from valve_twin.compat.opcua import bound_arrays, bound_messages, publishing_of, subscribing_of
from valve_twin.nodes.opcua_source.complaints import Complaints, one_line
from valve_twin.nodes.opcua_source.namespaces import Namespaces
from valve_twin.nodes.opcua_source.tags import Sample, to_sample
from valve_twin.nodes.opcua_source.terms import LEAST_MS, Granted, Terms

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Sequence

RETRY_S = 0.5
"""Pause before the next attempt to connect [s]."""

TIMEOUT_S = 3.0
"""A server that for so long neither answers nor sends samples is taken for gone [s]."""

STEP_S = 0.1
"""Its silence is counted in steps of this length, in each of which it could have answered [s]."""

AGAIN_S = 5.0
"""A tag that the server does not know is asked for again so often [s]."""

PART = 200
"""So many tags are asked for at a time: a server refuses too many in one call, assumed [1]."""

MOST_WAITING = 250_000
"""Samples kept for the node, 40 MB; beyond it the oldest are lost and counted [1]."""

MOST_MESSAGE_B = 4 * 2**20
"""A server that sends more at once is let go: 100 000 samples, ten full queues [B]."""

LEAST_CHANNEL_MS = 1000
"""A channel that has to be made anew more often is none, assumed [ms]."""


@dataclass(frozen=True, slots=True)
class Server:
    """The server of the PLC and how it is asked.

    Attributes
    ----------
    address : str
        opc.tcp://HOST:PORT.
    user, password : str
        Empty = anonymous.
    folder : str
        Holds certificate.der and key.pem of ours; empty = neither signed nor encrypted.
    publishing_ms : float
        The server collects changes for so long [ms].
    sampling_ms : float
        It looks at a tag so often; 0 = as fast as it can [ms].
    queue : int
        So many values of a tag it keeps meanwhile [1].
    period_s : float
        Sampling time of the tags [s]; 0 = not known.
    """

    address: str
    user: str = ""
    password: str = ""
    folder: str = ""
    publishing_ms: float = 50.0
    sampling_ms: float = 0.0
    queue: int = 10_000
    period_s: float = 0.0


@dataclass(slots=True)
class Figures:
    """What happened so far.

    Attributes
    ----------
    connected : bool
        Whether the tags are subscribed now.
    trouble : str
        Why not.
    connections : int
        How often that succeeded [1].
    unknown : dict
        Why a tag is not subscribed, by its number.
    publishing_ms : float
        The server sends so often [ms].
    doubt : str
        Why samples may be lost by what it grants, in one line.
    overflows : int
        How often the server said that its queue lost values: one at least each time [1].
    dropped : int
        Samples that the node did not take in time [1].
    unread : int
        Messages of the server that nobody could read [1].
    unread_why : str
        Why not the last of them.
    moved : str
        What became of namespaces whose index is another one now, in one line.
    ahead_s : float
        Stamp of the last good sample less our clock when it came; the first of a tag after a
        connection says nothing, it may be as old as its value [s].
    """

    connected: bool = False
    trouble: str = "not connected yet"
    connections: int = 0
    unknown: dict[int, str] = field(default_factory=dict)
    publishing_ms: float = 0.0
    doubt: str = ""
    overflows: int = 0
    dropped: int = 0
    unread: int = 0
    unread_why: str = ""
    moved: str = ""
    ahead_s: float = 0.0


class TagSubscription:
    """Subscribes tags, again and again where the server or a tag goes away.

    Parameters
    ----------
    server : Server
        Whom to ask.
    nodes : sequence of str
        Node ids of the tags.
    arrived : callable
        Called from the thread when samples wait that nobody has been told of.
    """

    def __init__(self, server: Server, nodes: Sequence[str], arrived: Callable[[], None]) -> None:
        self._server, self._nodes, self._arrived = server, tuple(nodes), arrived
        self.figures = Figures()
        self._waiting: deque[Sample] = deque()
        self._told = False
        self._numbers: dict[Any, int] = {}
        self._heard: set[int] = set()
        self._spaces = Namespaces()
        self._count = 0
        self._end = self._ended = False
        self._thread = threading.Thread(target=self._run, name="opcua_source", daemon=True)
        self._thread.start()

    def take(self) -> list[Sample]:
        """Return the samples that have come since the last time, in their order."""
        self._told = False
        found: list[Sample] = []
        with suppress(IndexError):
            while True:
                found.append(self._waiting.popleft())
        return found

    def close(self) -> None:
        """Unsubscribe."""
        self._end = True
        self._thread.join(3.0 * TIMEOUT_S)

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        """Take a value; called by asyncua, whose handlers have this name.

        Parameters
        ----------
        node : Node
            The tag's.
        value : object
            Its value, whatever its status.
        data : DataChangeNotif
            Value, status and stamps.
        """
        del value
        item = data.monitored_item.Value
        self._count += 1
        tag = self._numbers[node.nodeid]
        sample = to_sample(tag, item, first=tag not in self._heard)
        self.figures.overflows += sample.lost_before
        if sample.first:
            self._heard.add(tag)
        elif sample.stamp_ns and not math.isnan(sample.value):
            self.figures.ahead_s = (sample.stamp_ns - time.time_ns()) * 1e-9
        if len(self._waiting) >= MOST_WAITING:
            self._waiting.popleft()
            self.figures.dropped += 1
        self._waiting.append(sample)
        if not self._told:
            self._told = True
            self._arrived()

    def status_change_notification(self, status: Any) -> None:
        """Note that the subscription ended; called by asyncua, whose handlers have this name."""
        del status
        self._ended = True

    def _run(self) -> None:
        self._said = Complaints()
        try:
            asyncio.run(self._follow())
        finally:
            self._said.close()

    async def _follow(self) -> None:
        asyncio.get_running_loop().set_exception_handler(self._said.of_loop)
        while not self._end:
            self._said.why = ""
            try:
                await self._subscribed()
            except Exception as err:  # whatever a server does: said, and tried again
                why = self._said.why
                more = f": {why}" if why and why not in one_line(err) else ""
                self.figures.trouble = one_line(err) + more
            self._count_unread()
            self.figures.connected = False
            await self._pause(RETRY_S)

    def _count_unread(self) -> None:
        self.figures.unread, self.figures.unread_why = self._said.lost, self._said.lost_why

    def _note(self, why: str) -> None:
        self._said.why = self._said.why or why

    def _client(self) -> Any:
        from asyncua import Client

        patience_s = 4.0 * TIMEOUT_S  # whether it is gone is judged here
        client = Client(self._server.address, patience_s, watchdog_intervall=patience_s)
        client.name = "valve_twin opcua_source"
        bound_messages(client, MOST_MESSAGE_B, self._note)
        return client

    async def _subscribed(self) -> None:
        bound_arrays()
        client = self._client()
        if self._server.folder:
            await _secure(client, Path(self._server.folder).expanduser())
        if self._server.user:
            client.set_user(self._server.user)
            client.set_password(self._server.password)
        try:
            await asyncio.wait_for(client.connect(), 2.0 * TIMEOUT_S)
            _check_granted(client)
            self._numbers = {}
            self._heard.clear()
            self._granted = Granted(client.uaclient.session)
            self._terms = Terms(self._server.period_s, self._server.queue)
            subscription = await client.create_subscription(self._server.publishing_ms, self)
            await self._add(client, subscription, range(len(self._nodes)))
            self.figures.connected, self.figures.trouble = True, ""
            self.figures.connections += 1
            self._ended = False
            await self._watch(client, subscription)
        finally:
            channel = client.uaclient.protocol
            with suppress(Exception):
                await asyncio.wait_for(client.disconnect(), TIMEOUT_S)
            if channel is not None and channel.transport is not None:
                channel.transport.abort()  # where nobody answers any more it is still open
                await asyncio.sleep(0.01)

    async def _watch(self, client: Any, subscription: Any) -> None:
        """Stay while the server answers; ask for missing tags now and then."""
        from asyncua import ua

        state = client.get_node(ua.ObjectIds.Server_ServerStatus_State)
        loop = asyncio.get_running_loop()
        again_s = loop.time() + AGAIN_S
        while not self._end:
            task = publishing_of(client)
            if self._ended or task is None or task.done():
                msg = "the server ended the subscription"
                raise ConnectionError(msg)
            self._count_unread()
            before = self._count
            try:
                await _patiently(state.read_value(), TIMEOUT_S)
            except asyncio.TimeoutError:
                if self._count == before:
                    raise
            if self.figures.unknown and loop.time() >= again_s:
                await self._add(client, subscription, tuple(self.figures.unknown))
                again_s = loop.time() + AGAIN_S
            await self._pause(RETRY_S)

    async def _found(self, client: Any, tags: Sequence[int]) -> dict[int, Any]:
        """Return the ids of tags in the namespaces that they had first; of gone ones none."""
        from asyncua import ua

        with suppress(ua.UaStatusCodeError):  # a server that does not tell has what it had
            array = client.get_node(ua.ObjectIds.Server_NamespaceArray)
            uris = await array.read_value()
            self._spaces.see(uris if isinstance(uris, list) else [])
        found = {}
        for tag in tags:
            node = ua.NodeId.from_string(self._nodes[tag])
            index = self._spaces.index(node.NamespaceIndex)
            if index is None:
                self.figures.unknown[tag] = self._spaces.moved(node.NamespaceIndex)
            else:
                found[tag] = ua.NodeId(node.Identifier, index, node.NodeIdType)
                self._numbers[found[tag]] = tag
        used = {ua.NodeId.from_string(node).NamespaceIndex for node in self._nodes}
        self.figures.moved = "; ".join(filter(None, map(self._spaces.moved, sorted(used))))
        return found

    async def _add(self, client: Any, subscription: Any, tags: Sequence[int]) -> None:
        """Subscribe tags with every stamp, also where the value stays the same."""
        from asyncua import ua

        every = ua.DataChangeFilter(Trigger=ua.DataChangeTrigger.StatusValueTimestamp)
        self._granted.items.clear()
        found = await self._found(client, tags)
        ids = list(found.values())
        for first in range(0, len(ids), PART):
            await subscribing_of(subscription)(
                [client.get_node(node) for node in ids[first : first + PART]],
                ua.AttributeIds.Value,
                mfilter=every,
                queuesize=self._server.queue,
                sampling_interval=self._server.sampling_ms,
            )
        for tag, result in zip(found, self._granted.items, strict=True):
            if result.StatusCode.is_good():
                self.figures.unknown.pop(tag, None)
                self._terms.queues[tag] = max(result.RevisedQueueSize, 1)
                sampling_ms = result.RevisedSamplingInterval
                self._terms.samplings_ms[tag] = sampling_ms if math.isfinite(sampling_ms) else 0.0
            else:
                self.figures.unknown[tag] = result.StatusCode.name
        await self._hurry(client, subscription)

    async def _hurry(self, client: Any, subscription: Any) -> None:
        """Ask for more frequent publishing where a queue fills up between two."""
        from asyncua import ua

        terms = self._terms
        wanted_ms = max(terms.wanted_ms(), LEAST_MS)
        if self._granted.publishing_ms > wanted_ms:
            asked = subscription.parameters
            params = ua.ModifySubscriptionParameters(
                SubscriptionId=subscription.subscription_id,
                RequestedPublishingInterval=wanted_ms,
                RequestedLifetimeCount=asked.RequestedLifetimeCount,
                RequestedMaxKeepAliveCount=client.get_keepalive_count(wanted_ms),
                MaxNotificationsPerPublish=asked.MaxNotificationsPerPublish,
            )
            with suppress(ua.UaStatusCodeError):  # it changes none: the doubt stays
                await subscription.update(params)
        terms.publishing_ms = self.figures.publishing_ms = self._granted.publishing_ms
        self.figures.doubt = terms.doubt(self._nodes)

    async def _pause(self, seconds: float) -> None:
        end_s = asyncio.get_running_loop().time() + seconds
        while not self._end and asyncio.get_running_loop().time() < end_s:
            await asyncio.sleep(0.05)


async def _patiently(question: Coroutine[Any, Any, Any], most_s: float) -> None:
    """Wait for an answer; a time in which this process stood still is one step of it at most."""
    asked = asyncio.ensure_future(question)
    try:
        for _ in range(math.ceil(most_s / STEP_S)):
            done, _ = await asyncio.wait({asked}, timeout=STEP_S)
            if done:
                asked.result()
                return
        raise asyncio.TimeoutError
    finally:
        asked.cancel()


async def _secure(client: Any, folder: Path) -> None:
    from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

    certificate, key = folder / "certificate.der", folder / "key.pem"
    await client.set_security(SecurityPolicyBasic256Sha256, str(certificate), str(key))


def _check_granted(client: Any) -> None:
    """Refuse a channel that no sound server grants."""
    if client.secure_channel_timeout < LEAST_CHANNEL_MS:
        msg = f"the server grants a channel of {client.secure_channel_timeout} ms"
        raise ConnectionError(msg)
