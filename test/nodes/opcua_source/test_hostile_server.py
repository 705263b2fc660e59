# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A server that lies, floods or breaks off: told in a line, bounded, and heard once it is sound.

A server of asyncua in a process of its own writes on; what it answers is harmed on its way.
"""

from __future__ import annotations

import math
import random
import struct
import threading
import time
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("asyncua", reason="needs the extra gateway")

from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import nodeid_from_binary, struct_from_binary, struct_to_binary

from test.nodes.opcua_source.plc import Plc
from test.nodes.opcua_source.proxy import HEAD_B, Proxy, untouched
from test.nodes.opcua_source.test_subscription import MS, Client
from test.ports import free_port
from valve_twin.nodes.opcua_source import subscription as module

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from test.nodes.opcua_source.proxy import Harm
    from valve_twin.nodes.opcua_source.tags import Sample

MORE_MB = 120.0
MARK = b"MARKMARK"
LONG_AGO = datetime(1601, 1, 1, tzinfo=timezone.utc)
FAR_AHEAD = datetime(9999, 12, 31, tzinfo=timezone.utc)


def memory_mb() -> float:
    """Return what this process holds [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096e-6


def kind_of(chunk: bytes) -> int:
    """Return what a chunk holds, by the numeric id of its encoding; 0 = no message."""
    if chunk[:3] != b"MSG":
        return 0
    return int(nodeid_from_binary(Buffer(chunk[HEAD_B : HEAD_B + 4])).Identifier)


def with_body(chunk: bytes, body: bytes) -> bytes:
    """Return a chunk with another body."""
    return chunk[:4] + struct.pack("<I", HEAD_B + len(body)) + chunk[8:HEAD_B] + body


def answer(kind: Any, alter: Callable[[Any], bytes | None]) -> Harm:
    """Alter answers of a kind, or return other bytes in their place."""
    wanted = getattr(ua.ObjectIds, f"{kind.__name__}_Encoding_DefaultBinary")

    def harm(number: int, chunk: bytes) -> bytes:
        del number
        if kind_of(chunk) != wanted:
            return chunk
        message = struct_from_binary(kind, Buffer(chunk[HEAD_B:]))
        return with_body(chunk, alter(message) or struct_to_binary(message))

    return harm


def granting(kind: Any, **terms: float) -> Harm:
    """Grant other terms."""

    def alter(message: Any) -> None:
        for name, value in terms.items():
            setattr(message.Parameters, name, value)

    return answer(kind, alter)


def sending(make: Callable[[ua.DataValue], ua.DataValue]) -> Harm:
    """Send other values."""

    def alter(message: Any) -> None:
        for item in notified(message):
            item.Value = make(item.Value)

    return answer(ua.PublishResponse, alter)


def notified(message: Any) -> list[Any]:
    notes = message.Parameters.NotificationMessage.NotificationData or []
    return [i for n in notes if isinstance(n, ua.DataChangeNotification) for i in n.MonitoredItems]


def array_of_nothing(message: Any) -> bytes:
    """Claim 30 million elements that take no byte, in the place of a number."""
    for item in notified(message):
        item.Value = ua.DataValue(ua.Variant(struct.unpack("<d", MARK)[0]))
    claimed = b"\x80" + struct.pack("<i", 30_000_000) + bytes(4)
    return bytes(struct_to_binary(message).replace(b"\x0b" + MARK, claimed))


def cut_short(message: Any) -> bytes:
    return bytes(struct_to_binary(message)[:-9])


def elsewhere(message: Any) -> None:
    message.Parameters.SubscriptionId = 77


def for_more_tags(message: Any) -> None:
    message.Results = message.Results * 100


def for_no_tag(message: Any) -> None:
    message.Results = []


def looking_at_no_time(message: Any) -> None:
    for result in message.Results:
        result.RevisedSamplingInterval = math.nan


def channel_of_no_time(number: int, chunk: bytes) -> bytes:
    del number
    hour = struct.pack("<I", 3_600_000)
    return chunk.replace(hour, bytes(4)) if chunk[:3] == b"OPN" else chunk


def endless(number: int, chunk: bytes) -> bytes:
    """Send parts of a message that has no last one."""
    del number
    if kind_of(chunk) != ua.ObjectIds.PublishResponse_Encoding_DefaultBinary:
        return chunk
    first, request = struct.unpack_from("<II", chunk, 16)
    head = b"MSGC" + struct.pack("<I", HEAD_B + 60_000) + chunk[8:16]
    numbers = range(first, first + 200)
    return b"".join(head + struct.pack("<II", n, request) + bytes(60_000) for n in numbers)


def huge(number: int, chunk: bytes) -> bytes:
    """Declare 4 GB and send 20 MB of them."""
    del number
    published = kind_of(chunk) == ua.ObjectIds.PublishResponse_Encoding_DefaultBinary
    return b"MSGF" + b"\xff" * 4 + bytes(20_000_000) if published else chunk


def broken_off(number: int, chunk: bytes) -> bytes | None:
    return None if number == 6 else chunk[: 40 if number == 5 else None]


def silent(number: int, chunk: bytes) -> bytes:
    return b"" if number > 4 else chunk


class Plant:
    """A sound server that writes two tags, the way to it, and a client."""

    def __init__(self) -> None:
        self._plc = Plc(free_port(), 2)
        self.proxy = Proxy(int(self._plc.address.rsplit(":")[-1]))
        self.client = Client(self.proxy.address, tags=2)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._write)
        self._thread.start()
        self.begin()

    def _write(self) -> None:
        number = 0.0
        while not self._ended.wait(0.02):
            self._plc.write({0: [number], 1: [-number]}, time.time_ns(), MS)
            number += 1.0

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.client.subscription.close()
        self.proxy.close()
        self._plc.kill()

    def begin(self, harm: Harm = untouched) -> None:
        """Begin a new connection, with a harm or, waited for, a sound one."""
        figures = self.client.figures
        before = figures.connections
        self.proxy.harm = harm
        self.proxy.cut()
        if harm is untouched:
            self.client.until(lambda: figures.connections > before)
            self.client.samples.clear()
            self.client.until(lambda: any(math.isfinite(s.value) for s in self.client.take()))
        else:
            figures.trouble = ""

    def samples(self, harm: Harm) -> list[Sample]:
        """Return some samples that came by a connection with a harm."""
        before = self.client.figures.connections
        self.begin(harm)
        self.client.until(lambda: self.client.figures.connections > before)
        self.client.take()  # what waits from the connection before
        self.client.samples.clear()
        self.client.until(lambda: len(self.client.take()) > 4)
        return self.client.samples


@pytest.fixture(scope="module")
def plant() -> Iterator[Plant]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "TIMEOUT_S", 1.0)
        patch.setattr(module, "RETRY_S", 0.05)
        made = Plant()
        yield made
        made.close()


TOLD = {
    "a channel of 0 ms": (channel_of_no_time, "the server grants a channel of 0 ms"),
    "a session of nan": (
        granting(ua.CreateSessionResponse, RevisedSessionTimeout=math.nan),
        "what the server sends cannot be read (ValueError: cannot convert float NaN",
    ),
    "publishing at nan": (
        granting(ua.CreateSubscriptionResponse, RevisedPublishingInterval=math.nan),
        "the server grants a publishing every nan ms",
    ),
    "publishing at -5": (
        granting(ua.CreateSubscriptionResponse, RevisedPublishingInterval=-5.0),
        "the server grants a publishing every -5 ms",
    ),
    "200 tags": (
        answer(ua.CreateMonitoredItemsResponse, for_more_tags),
        "the server answers for 200 tags of 2",
    ),
    "no tag": (
        answer(ua.CreateMonitoredItemsResponse, for_no_tag),
        "the server answers for 0 tags of 2",
    ),
    "an endless message": (endless, "Message size: "),
    "a huge message": (huge, "the server sends a message of more than 4194304 bytes"),
    "half a message": (broken_off, "Connection"),
    "no answer": (silent, "the server did not answer in time"),
}


@pytest.mark.parametrize(("harm", "told"), TOLD.values(), ids=TOLD)
def test_what_no_sound_server_does_is_a_line_and_no_connection(plant, capfd, harm, told):
    before_mb, most_mb = memory_mb(), 0.0

    def said() -> bool:
        nonlocal most_mb
        most_mb = max(most_mb, memory_mb())
        return told in plant.client.figures.trouble

    plant.begin(harm)
    plant.client.until(said)
    assert plant.client.figures.trouble.isprintable()
    plant.begin()
    assert most_mb < before_mb + MORE_MB
    assert capfd.readouterr().err == ""


UNREAD = {
    "an array of nothing": (
        answer(ua.PublishResponse, array_of_nothing),
        "an array of 30000000 elements in a message of",
    ),
    "messages cut short": (answer(ua.PublishResponse, cut_short), "cannot be read"),
    "another subscription": (
        answer(ua.PublishResponse, elsewhere),
        "Received data for unknown subscription 77",
    ),
}


@pytest.mark.parametrize(("harm", "told"), UNREAD.values(), ids=UNREAD)
def test_a_message_that_cannot_be_read_is_counted_and_told(plant, capfd, harm, told):
    before_mb = memory_mb()
    before = plant.client.figures.unread
    plant.begin(harm)
    plant.client.until(lambda: plant.client.figures.unread > before + 2)
    assert told in plant.client.figures.unread_why
    assert memory_mb() < before_mb + MORE_MB
    plant.begin()
    assert capfd.readouterr().err == ""


def unknown_structure(value: ua.DataValue) -> ua.DataValue:
    body = ua.ExtensionObject(ua.NodeId(12345, 7), b"abc")
    return ua.DataValue(ua.Variant(body, ua.VariantType.ExtensionObject), value.StatusCode)


MASKED = {
    "infinite": lambda v: ua.DataValue(ua.Variant(math.inf), v.StatusCode, v.SourceTimestamp),
    "a text": lambda v: ua.DataValue(ua.Variant("1.0")),
    "an array": lambda v: ua.DataValue(ua.Variant([1.0] * 1000)),
    "a structure of unknown type": unknown_structure,
    "nothing": lambda v: ua.DataValue(),
    "an unknown status": lambda v: ua.DataValue(ua.Variant(1.0), ua.StatusCode(0x80FF0000)),
}


@pytest.mark.parametrize("make", MASKED.values(), ids=MASKED)
def test_what_is_no_number_is_masked(plant, make):
    assert all(math.isnan(s.value) for s in plant.samples(sending(make))[-4:])
    plant.begin()


STAMPS = {
    "none": (None, None),
    "1601": (LONG_AGO, LONG_AGO),
    "9999": (FAR_AHEAD, LONG_AGO),
}


@pytest.mark.parametrize(("source", "server"), STAMPS.values(), ids=STAMPS)
def test_samples_come_whatever_their_stamps_are(plant, source, server):
    def stamped(value: ua.DataValue) -> ua.DataValue:
        return ua.DataValue(value.Value, value.StatusCode, source, server)

    stamps = {s.stamp_ns for s in plant.samples(sending(stamped))[-4:]}
    assert stamps == {int(FAR_AHEAD.timestamp()) * 10**9 if source is FAR_AHEAD else 0}
    plant.begin()


def test_a_sampling_interval_that_is_no_number_is_not_known(plant):
    assert plant.samples(answer(ua.CreateMonitoredItemsResponse, looking_at_no_time))
    plant.begin()


def test_a_flood_of_sound_samples_is_kept_in_bounds_and_what_is_lost_is_counted(
    plant, monkeypatch
):
    """Nobody takes them, as where the node has no computing time."""
    monkeypatch.setattr(module, "MOST_WAITING", 20_000)
    monkeypatch.setattr(module, "TIMEOUT_S", 30.0)  # neither the flood nor a busy machine ends it

    def flooding(message: Any) -> None:
        for note in message.Parameters.NotificationMessage.NotificationData or []:
            if isinstance(note, ua.DataChangeNotification):
                items = list(note.MonitoredItems)  # a part of a message is 64 kB at most
                note.MonitoredItems = items * (1000 // len(items))

    before_mb = memory_mb()
    figures = plant.client.figures
    dropped = figures.dropped
    plant.begin(answer(ua.PublishResponse, flooding))
    plant.client.until(lambda: figures.dropped > dropped + 20_000)
    assert len(plant.client.subscription._waiting) <= 20_000
    assert memory_mb() < before_mb + MORE_MB
    assert figures.connected
    plant.begin()


def test_a_server_that_tells_its_namespaces_late_is_not_taken_for_gone(plant, monkeypatch):
    monkeypatch.setattr(module, "TIMEOUT_S", 1.0)

    def late(message: Any) -> None:
        if any(isinstance(result.Value.Value, list) for result in message.Results):
            time.sleep(1.5)  # as long as the server takes

    figures = plant.client.figures
    before = figures.connections
    plant.begin(answer(ua.ReadResponse, late))
    plant.client.until(lambda: figures.connections > before)
    plant.begin()


def mutated(rng: random.Random, chunk: bytes) -> bytes:
    """Return a chunk with one damage by chance."""
    data, at = bytearray(chunk), rng.randrange(len(chunk))
    number = rng.choice([0, 1, 8, 11, 12, 10**6, 2**31 - 1, 2**31, 2**32 - 1, len(chunk) + 1])
    damage = rng.randrange(8)
    if damage == 0:
        for _ in range(rng.randint(1, 8)):
            data[rng.randrange(len(data))] = rng.randrange(256)
    elif damage == 1:
        del data[at:]
    elif damage == 2:
        data[4:8] = struct.pack("<I", number)
    elif damage == 3:
        data[at : at + 4] = struct.pack("<I", number)
    elif damage == 4:
        data[at:at] = rng.randbytes(rng.randint(1, 30))
    elif damage == 5:
        data += bytes(data)
    elif damage == 6:
        data[:4] = rng.choice([b"MSGC", b"MSGA", b"ERRF", b"OPNF", b"ACKF", b"XXXF", b"MSGX"])
    else:
        data[at : at + 8] = struct.pack("<d", rng.choice([math.nan, math.inf, -math.inf, 1e308]))
    return bytes(data)


def outlive(plant: Plant, count: int, seed: int) -> None:
    """Damage one chunk in each connection; what is sound afterwards is heard."""
    rng = random.Random(seed)
    for _ in range(count):
        which, hit = rng.randrange(12), threading.Event()

        def harm(number: int, chunk: bytes, which: int = which, hit: Any = hit) -> bytes:
            if number != which or hit.is_set():
                return chunk
            hit.set()
            return mutated(rng, chunk)

        plant.begin(harm)
        hit.wait(5.0)
        time.sleep(0.05)
        assert plant.client.figures.trouble.isprintable()
        plant.begin()


def test_damaged_answers_are_outlived(plant, capfd):
    before_mb = memory_mb()
    outlive(plant, 10, 1)
    assert memory_mb() < before_mb + MORE_MB
    assert capfd.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_so_are_three_hundred(plant, capfd):
    before_mb = memory_mb()
    outlive(plant, 300, 2)
    assert memory_mb() < before_mb + MORE_MB
    assert capfd.readouterr().err == ""
