# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A PLC for tests: a server of asyncua in its own process that writes what it is told to.

    python plc.py PORT TAGS QUEUE FIRST_NS PUBLISHING_MS NAMESPACES

It keeps at most QUEUE samples of a tag, without a word where it loses one, and sends every
PUBLISHING_MS at most; 0 = as asyncua does. What a tag holds at first is stamped FIRST_NS; 0 = now.
NAMESPACES are names with commas between them: each gets an index and a tag0 that holds it.

A line of JSON from stdin is a write of many samples: columns by tag, start and period [ns], pace
[samples/s] (0 = as fast as it can), status. It answers with a line when it is done. With a pace
`by_publishing` time passes as the server sends: so many samples stand between two publishings,
however late those are.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from contextlib import suppress
from datetime import datetime, timedelta, timezone
from typing import Any

EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


def say(word: str) -> None:
    sys.stdout.write(f"{word}\n")
    sys.stdout.flush()


async def serve(
    port: int, tags: int, queue: int, first_ns: int, publishing_ms: float, spaces: str
) -> None:
    from asyncua import Server, ua

    server = Server()
    await server.init()
    sent = Sent()
    if queue:
        server.iserver.max_monitored_item_queue_size = queue
    if publishing_ms:
        revise(server.iserver.subscription_service, publishing_ms, sent)
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    for tag in range(tags):
        name = ua.QualifiedName(f"tag{tag}", 1)
        await server.nodes.objects.add_variable(ua.NodeId(f"tag{tag}", 1), name, 0.0)
    for space in filter(None, spaces.split(",")):
        index = await server.register_namespace(space)
        name = ua.QualifiedName("tag0", index)
        await server.nodes.objects.add_variable(ua.NodeId("tag0", index), name, float(index))
    if first_ns:
        first = {str(tag): [0.0] for tag in range(tags)}
        await write(server, {"columns": first, "start_ns": first_ns, "period_ns": 0}, sent)
    async with server:
        say("ready")
        while line := await asyncio.to_thread(sys.stdin.readline):
            await write(server, json.loads(line), sent)
            say("done")


class Sent:
    """Time as it passes for a subscription: an interval with each publishing that left [s]."""

    passed_s = 0.0
    data: Any = None

    @property
    def interval_s(self) -> float:
        return float(self.data.RevisedPublishingInterval) / 1e3

    def follow(self, subscription) -> None:
        """Count what leaves from now on."""
        self.data, pop = subscription.data, subscription._pop_publish_result

        def popped():
            self.passed_s += self.interval_s
            return pop()

        subscription._pop_publish_result = popped


def revise(service, least_ms: float, sent: Sent) -> None:
    """Let publishing be no faster than this, and be changed: asyncua ignores such a request."""
    create, modify = service.create_subscription, service.modify_subscription

    async def created(params, *given, **named):
        params.RequestedPublishingInterval = max(params.RequestedPublishingInterval, least_ms)
        result = await create(params, *given, **named)
        sent.follow(service.subscriptions[result.SubscriptionId])
        return result

    def modified(params):
        found = service.subscriptions[params.SubscriptionId]
        found.data.RevisedPublishingInterval = max(params.RequestedPublishingInterval, least_ms)
        found._task.cancel()
        found._task = asyncio.get_running_loop().create_task(found._subscription_loop())
        return modify(params)

    service.create_subscription, service.modify_subscription = created, modified


async def write(server, order, sent: Sent) -> None:
    from asyncua import ua

    status = ua.StatusCode(order.get("status", 0))
    columns, pace = order["columns"], order.get("pace", 0.0)
    by_publishing = order.get("by_publishing", False)
    begun, before_s = time.perf_counter(), sent.passed_s
    for i in range(len(next(iter(columns.values())))):
        stamp = EPOCH + timedelta(
            microseconds=(order["start_ns"] + i * order["period_ns"]) // 1000
        )
        for tag, values in columns.items():
            value = ua.DataValue(ua.Variant(values[i], ua.VariantType.Double), status, stamp)
            await server.write_attribute_value(ua.NodeId(f"tag{tag}", 1), value)
        while by_publishing and i / pace >= sent.passed_s - before_s + sent.interval_s:
            await asyncio.sleep(0.005)
        ahead_s = i / pace - (time.perf_counter() - begun) if pace else 0.0
        await asyncio.sleep(max(ahead_s, 0.0) if pace or i % 20 == 0 else 0.0)


class Plc:
    """The process, as a test has it."""

    def __init__(
        self,
        port: int,
        tags: int = 1,
        *,
        queue: int = 0,
        first_ns: int = 0,
        publishing_ms: float = 0.0,
        namespaces: str = "",
    ) -> None:
        given = port, tags, queue, first_ns, publishing_ms, namespaces
        self.address = f"opc.tcp://127.0.0.1:{port}"
        self.process = subprocess.Popen(
            [sys.executable, __file__, *map(str, given)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.process.stdin
        assert self.process.stdout
        self._in, self._out = self.process.stdin, self.process.stdout
        assert self._out.readline() == "ready\n"

    def begin(self, columns, start_ns: int, period_ns: int, **more) -> None:
        order = {"columns": columns, "start_ns": start_ns, "period_ns": period_ns, **more}
        self._in.write(json.dumps(order) + "\n")
        self._in.flush()

    def wait(self) -> None:
        assert self._out.readline() == "done\n"

    def write(self, columns, start_ns: int, period_ns: int, **more) -> None:
        self.begin(columns, start_ns, period_ns, **more)
        self.wait()

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()
        with suppress(OSError):  # an order that it did not take
            self._in.close()
        self._out.close()


if __name__ == "__main__":
    port, tags, queue, first_ns, publishing_ms, spaces = sys.argv[1:]
    numbers = int(port), int(tags), int(queue), int(first_ns), float(publishing_ms)
    asyncio.run(serve(*numbers, spaces))
