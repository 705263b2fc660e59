# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tags of a PLC in another process: nothing lost, bad ones told, its death outlived."""

from __future__ import annotations

import asyncio
import math
import os
import signal
import time
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("asyncua", reason="needs the extra gateway")

from test.gateway.opcua.test_access import write_pair
from test.nodes.conftest import CoreWait
from test.nodes.opcua_source.plc import Plc
from test.ports import free_port
from valve_twin.nodes.opcua_source import subscription as module
from valve_twin.nodes.opcua_source.subscription import Server, TagSubscription

if TYPE_CHECKING:
    from valve_twin.nodes.opcua_source.tags import Sample

START_NS, MS = 1_700_000_000_000_000_000, 1_000_000
LATER_NS = START_NS + 10**15
"""Before this all that a test writes is stamped; what a server starts with is stamped today."""

UNCERTAIN, BAD_SENSOR = 0x40930000, 0x80320000  # LastUsableValue; BadWaitingForInitialData


class Client:
    """A subscription and what it took."""

    def __init__(self, address: str, tags=1, names=None, **asked) -> None:
        names = names or [f"ns=1;s=tag{tag}" for tag in range(tags)]
        self.samples: list[Sample] = []
        self.subscription = TagSubscription(Server(address, **asked), names, lambda: None)

    @property
    def figures(self):
        return self.subscription.figures

    def take(self):
        self.samples += self.subscription.take()
        return self.samples

    def until(self, condition, most_s=60.0, beside: int = 0) -> float:
        """Wait for a condition; return how long it took with a core free for us and for a PLC."""
        begun, waited = time.monotonic(), CoreWait(os.getpid(), *filter(None, [beside]))
        while not condition():
            assert time.monotonic() < begun + most_s, self.figures
            time.sleep(0.02)
        return time.monotonic() - begun - waited.so_far_s()

    def stamps(self, tag=0):
        return [s.stamp_ns for s in self.take() if s.tag == tag and s.stamp_ns < LATER_NS]


@pytest.fixture
def plc():
    made = Plc(free_port(), 3)
    yield made
    made.kill()


@pytest.fixture
def client(plc):
    made = Client(plc.address, 3)
    made.until(lambda: made.figures.connected and len(made.take()) >= 3)
    made.samples.clear()
    yield made
    made.subscription.close()


@pytest.mark.usefixtures("patience")
def test_every_sample_comes_in_order_with_the_stamp_of_its_source(plc, client):
    values = [0.5] * 500 + [math.sin(i) for i in range(500)]  # also those that do not change
    plc.write({0: values, 2: values}, START_NS, MS, pace=1000.0)
    client.until(lambda: len(client.take()) >= 2000)
    for tag in (0, 2):
        mine = [s for s in client.samples if s.tag == tag]
        assert [s.value for s in mine] == values
        assert [s.stamp_ns for s in mine] == [START_NS + i * MS for i in range(1000)]
    assert not client.figures.overflows
    assert not client.figures.dropped


@pytest.mark.usefixtures("patience")
@pytest.mark.parametrize("least_ms", [20.0, 1500.0])
def test_a_server_that_keeps_fewer_is_asked_to_send_more_often_or_the_loss_is_foretold(least_ms):
    """40 samples at 50 Hz are 0.8 s: too few for what is sent every 2 s, enough for 0.4 s."""
    plc, period_ms = Plc(free_port(), 2, queue=40, publishing_ms=least_ms), 20
    client = Client(plc.address, 2, publishing_ms=2000.0, period_s=period_ms / 1e3)
    try:
        client.until(lambda: client.figures.connected and len(client.take()) >= 2)
        values = list(map(float, range(150)))
        plc.write({0: values}, START_NS, period_ms * MS, pace=50.0, by_publishing=True)
        last_ns = START_NS + 149 * period_ms * MS
        client.until(lambda: client.stamps()[-1:] == [last_ns])
        figures = client.figures
        if least_ms < 400.0:
            assert (figures.publishing_ms, figures.doubt) == (400.0, "")
            assert len(client.stamps()) == 150
        else:
            assert len(client.stamps()) < 150
            assert figures.doubt == (
                "the server keeps 40 samples of ns=1;s=tag0 and of 1 tags more, 800 ms at 50 Hz, "
                "and sends every 1500 ms: samples get lost where it is late: let the server's "
                "settings allow a queue of 150 (asked for 10000) or a publishing interval of "
                "400 ms, queue and publishing_ms of this node cannot help"
            )
    finally:
        client.subscription.close()
        plc.kill()


@pytest.mark.parametrize("status", [UNCERTAIN, BAD_SENSOR])
def test_a_status_that_is_not_good_masks_the_sample(plc, client, status):
    plc.write({0: [1.0, 2.0]}, START_NS, MS, status=status)
    plc.write({0: [3.0]}, START_NS + 2 * MS, MS)
    client.until(lambda: len(client.take()) >= 3)
    assert [math.isnan(s.value) for s in client.samples] == [True, True, False]


@pytest.mark.usefixtures("patience")
def test_a_thousand_tags_are_asked_for_in_parts(monkeypatch):
    from asyncua.common.subscription import Subscription

    asked, plc = [], Plc(free_port(), 1000)
    create = Subscription.create_monitored_items

    async def counted(self, items):
        asked.append(len(items))
        return await create(self, items)

    monkeypatch.setattr(Subscription, "create_monitored_items", counted)
    client = Client(plc.address, 1000)
    try:
        client.until(lambda: client.figures.connected and len(client.take()) >= 1000)
        assert asked == [module.PART] * 5
        assert {s.tag for s in client.samples} == set(range(1000))
        plc.write({999: [1.0]}, START_NS, MS)
        client.until(lambda: client.stamps(999))
    finally:
        client.subscription.close()
        plc.kill()


def test_tags_are_taken_where_their_namespace_is_after_a_restart_or_told_as_gone():
    """After an update of the PLC the same id was another tag, taken in silence."""
    names = ["ns=1;s=tag0", "ns=2;s=tag0", "ns=3;s=tag0"]
    port = free_port()
    plc = Plc(port, namespaces="urn:a,urn:b")
    client = Client(plc.address, names=names)

    def values() -> dict[int, float]:
        return {s.tag: s.value for s in client.take()}

    try:
        client.until(lambda: values() == {0: 0.0, 1: 2.0, 2: 3.0})
        for spaces, unknown, moved, found in (
            ("urn:b,urn:a", {}, "urn:a has moved from ns=2 to ns=3", {0: 0.0, 1: 3.0, 2: 2.0}),
            ("urn:c,urn:b", {1: "urn:a is gone, ns=2 is urn:c now"}, "gone", {0: 0.0, 2: 3.0}),
        ):
            plc.kill()
            client.until(lambda: not client.figures.connected)
            client.take().clear()
            plc = Plc(port, namespaces=spaces)
            client.until(lambda at=found: values() == at)
            client.until(lambda: client.figures.connected)
            assert moved in client.figures.moved
            assert set(client.figures.unknown) == set(unknown)
            assert all(text in client.figures.unknown[tag] for tag, text in unknown.items())
    finally:
        client.subscription.close()
        plc.kill()


def test_a_server_that_is_killed_is_live_again_soon(monkeypatch):
    outlive(3)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_server_that_is_killed_a_hundred_times_is_live_again_soon():
    outlive(100)


def outlive(kills: int) -> None:
    """Kill the server in the middle of its writing; what it has sent stays as it was sent."""
    port = free_port()
    plc, later = Plc(port), 0.0
    client = Client(plc.address)
    try:
        for kill in range(kills):
            client.until(lambda: client.figures.connected)
            start_ns = START_NS + kill * 1000 * MS
            plc.begin({0: [float(kill)] * 1000}, start_ns, MS, pace=1000.0)
            client.until(lambda at=start_ns: any(s >= at for s in client.stamps()))
            plc.kill()
            client.until(lambda: not client.figures.connected)
            assert client.figures.trouble
            plc = Plc(port)
            again_s = client.until(lambda: client.figures.connected, beside=plc.process.pid)
            later = max(later, again_s)
        stamps = client.stamps()
        assert len(set(stamps)) == len(stamps)
        assert stamps == sorted(stamps)
        assert client.figures.connections == kills + 1
        assert later < 5.0
    finally:
        client.subscription.close()
        plc.kill()


def test_a_server_that_hangs_is_noticed_and_a_renamed_tag_is_told(plc, monkeypatch):
    monkeypatch.setattr(module, "AGAIN_S", 0.2)
    client = Client(plc.address, names=["ns=1;s=tag0", "ns=1;s=renamed"])
    try:
        client.until(lambda: client.figures.connected)
        assert client.figures.unknown == {1: "BadNodeIdUnknown"}
        plc.write({0: [1.0]}, START_NS, MS)
        client.until(client.stamps)
        plc.process.send_signal(signal.SIGSTOP)
        assert client.until(lambda: not client.figures.connected) < 10.0
        plc.process.send_signal(signal.SIGCONT)
        client.until(lambda: client.figures.connected)
    finally:
        client.subscription.close()


def test_a_stall_of_our_own_process_is_no_silence_of_the_server(plc, monkeypatch):
    """The answer was there when it went on, and so was the end of its patience."""
    from asyncua import Node

    read, asked = Node.read_value, []

    async def stalled(node):
        answer = asyncio.ensure_future(read(node))
        await asyncio.sleep(0.0)  # the question leaves
        asked.append(node)
        if len(asked) == 4:
            time.sleep(module.TIMEOUT_S + 0.5)
        return await answer

    monkeypatch.setattr(Node, "read_value", stalled)
    client = Client(plc.address)
    try:
        client.until(lambda: len(asked) >= 6)
        assert client.figures.connections == 1, client.figures
    finally:
        client.subscription.close()


def test_a_server_without_the_encryption_asked_for_says_what_to_set(plc, tmp_path):
    write_pair(tmp_path)
    subscription = TagSubscription(
        Server(plc.address, folder=str(tmp_path)), ["i=1"], lambda: None
    )
    end_s = time.monotonic() + 60.0
    while "set pki, or leave it out" not in subscription.figures.trouble:
        assert time.monotonic() < end_s, subscription.figures
        time.sleep(0.02)
    subscription.close()


def test_nobody_there_is_a_word_and_no_end():
    client = Client(f"opc.tcp://127.0.0.1:{free_port()}")
    client.until(lambda: "refused" in client.figures.trouble.lower() or client.figures.trouble)
    client.subscription.close()
    assert not client.figures.connected
