# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The OPC UA face as `valve-twin serve` starts it, in its own process; asyncua's client here."""

from __future__ import annotations

import asyncio
import gc
import json
import random
import re
import signal
import socket
import sqlite3
import statistics
import subprocess
import sys
import threading
import time
import urllib.request
from contextlib import asynccontextmanager, suppress
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("asyncua", reason="needs the extra gateway")

from asyncua import Client, ua
from asyncua.client.ua_client import UaClient
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

from test.gateway.test_web import HOSTILE, store
from test.ports import free_port
from valve_twin.cli import main
from valve_twin.core.operation.stroke_due import stroke_event
from valve_twin.core.operation.stroke_test import StrokeTest, StrokeVerdict
from valve_twin.gateway.opcua.access import MOST_SESSIONS, Access
from valve_twin.gateway.opcua.devices import ALARMS
from valve_twin.gateway.opcua.server import MOST_UNREAD, OpcUaFace
from valve_twin.gateway.opcua.units import unit_number
from valve_twin.gateway.opcua.valve_nodes import OF_PARAMETER, VALUES, stamp
from valve_twin.gateway.passwords import user_line
from valve_twin.gateway.plant import Plant
from valve_twin.gateway.view import View
from valve_twin.io.errors import ConfigError
from valve_twin.io.history.fleet import FleetRow
from valve_twin.io.history.store import History

DI, VALVES = "http://opcfoundation.org/UA/DI/", "urn:valve_twin:valves"
PASSWORD = "a long password"
DAY_NS = 86_400 * 10**9
PLATE = """\
/press/worn/twin:
  ros__parameters:
    model: press_cartridge
    aging: {stroke_test_days: 30.0}
    nameplate: {tag: FV-1205, serial: "0815", maker: ACME, place: hall 3}
"""


@pytest.fixture(autouse=True)
def nothing_left_open(monkeypatch):
    """Let go at the end of all that a client connected to.

    asyncua keeps a connection open that it took for dead while the machine was busy.
    """
    made: dict[UaClient, list[Any]] = {}
    make, disconnect = UaClient._make_protocol, UaClient.disconnect_socket

    def noted(client):
        protocol = make(client)
        made.setdefault(client, []).append(protocol)
        return protocol

    def let_go(client):
        disconnect(client)
        for protocol in made.pop(client, ()):
            if protocol.transport is not None:
                protocol.transport.abort()

    monkeypatch.setattr(UaClient, "_make_protocol", noted)
    monkeypatch.setattr(UaClient, "disconnect_socket", let_go)


class Server:
    """`valve-twin serve --opcua`, and where it listens."""

    def __init__(self, path, folder, *more: str) -> None:
        command = [sys.executable, "-m", "valve_twin.cli", "serve", "--port", "0"]
        command += ["--opcua", "opc.tcp://127.0.0.1:0", "--opcua-pki", str(folder)]
        self.process = subprocess.Popen(
            [*command, "--url", f"sqlite:///{path}", *more], stderr=subprocess.PIPE, text=True
        )
        assert self.process.stderr is not None
        lines = [self.process.stderr.readline() for _ in range(2)]
        found = re.search(r"opc\.tcp://127\.0\.0\.1:\d+", lines[0])
        web = re.search(r"http://127\.0\.0\.1:\d+", lines[1])
        assert found, lines
        assert web, lines
        self.opcua, self.web = found.group(), web.group()

    def json(self):
        with urllib.request.urlopen(f"{self.web}/api/valves", timeout=30) as answer:
            return {row["valve"]: row for row in json.load(answer)["valves"]}

    def end(self) -> str:
        self.process.send_signal(signal.SIGINT)
        try:
            assert self.process.wait(30) == 0
        finally:
            self.process.kill()
        assert self.process.stderr is not None
        with self.process.stderr as stream:
            return stream.read()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("opcua")


@pytest.fixture(scope="module")
def path(folder):
    made = folder / "history.sqlite"
    store(made, "/press/worn", range(1, 61), -0.0045)
    store(made, HOSTILE, range(1, 3), 0.0)
    tested = StrokeTest(StrokeVerdict.FAIL, stroke=0.98)
    with History(made) as history:
        (last,) = history.cycles("/press/worn", 60)
        assert history.log.add_stroke("/press/worn", stroke_event(last.end_ns - DAY_NS, tested))
    return made


@pytest.fixture(scope="module")
def server(path, folder):
    users = folder / "users"
    users.write_text(f"# who may look\n{user_line('anna', PASSWORD)}\n", encoding="utf-8")
    config = folder / "valves.yaml"
    config.write_text(PLATE, encoding="utf-8")
    made = Server(path, folder / "pki", "--opcua-users", str(users), "--config", str(config))
    yield made
    said = made.end()
    assert "Traceback" not in said
    assert said.count("5 wrong passwords of user anna from 127.0.0.2: refused for 30 s") == 1
    assert 1 <= said.count("users that do not exist from 127.0.0.1: refused for 30 s") <= 2
    assert len(said.splitlines()) <= 4


@asynccontextmanager
async def connected(server, folder, user="anna", password=PASSWORD):
    """Connect as a plant's client does: signed, encrypted, with a password."""
    client = Client(server.opcua)
    client.application_uri = "urn:test:client"
    await make_client_pair(folder)
    await client.set_security(
        SecurityPolicyBasic256Sha256, str(folder / "client.der"), str(folder / "client.pem")
    )
    client.set_user(user)
    client.set_password(password)
    async with client:
        yield client


async def make_client_pair(folder):
    from asyncua.crypto.cert_gen import setup_self_signed_certificate
    from cryptography.x509.oid import ExtendedKeyUsageOID

    if not (folder / "client.der").exists():
        await setup_self_signed_certificate(
            folder / "client.pem",
            folder / "client.der",
            "urn:test:client",
            socket.gethostname(),
            [ExtendedKeyUsageOID.CLIENT_AUTH],
            {"organizationName": "test"},
        )


def test_a_client_finds_devices_of_di_with_what_the_json_shows(server, folder):
    async def look():
        async with connected(server, folder) as client:
            di = await client.get_namespace_index(DI)
            own = await client.get_namespace_index(VALVES)
            device_set = await client.nodes.objects.get_child(f"{di}:DeviceSet")
            devices = {
                (await d.read_browse_name()).Name: d for d in await device_set.get_children()
            }
            json_rows = server.json()
            assert set(devices) == set(json_rows) == {"/press/worn", HOSTILE}
            for valve, device in devices.items():
                assert await device.read_type_definition() == ua.NodeId(1002, di)
                await agrees(device, json_rows[valve], own, di)
            worn = devices["/press/worn"]
            assert json_rows["/press/worn"]["nameplate"]["tag"] == "FV-1205"
            assert json_rows[HOSTILE]["nameplate"] == {}
            stroke = {
                f"{own}:StrokeTest": "fail",
                f"{own}:StrokeTestDaysSince": 1.0,
                f"{own}:StrokeTestDaysUntil": 29.0,
            }
            for name, value in stroke.items():
                assert await (await worn.get_child(name)).read_value() == value
            plate = {
                f"{di}:SerialNumber": "0815",
                f"{own}:Tag": "FV-1205",
                f"{own}:Place": "hall 3",
            }
            for name, text in plate.items():
                assert await (await worn.get_child(name)).read_value() == text
            maker = await (await worn.get_child(f"{di}:Manufacturer")).read_value()
            assert maker.Text == "ACME"
            health = await worn.get_child(f"{di}:DeviceHealth")
            assert await health.read_value() == 3  # OFF_SPEC
            assert await health.read_data_type() == ua.NodeId(6244, di)
            names = await client.get_node(ua.NodeId(6450, di)).read_value()
            assert [n.Text for n in names][3] == "OFF_SPEC"

    asyncio.run(look())


async def agrees(device, row, own, di) -> None:
    for name, (key, kind, _) in VALUES.items():
        found = await (await device.get_child(f"{own}:{name}")).read_data_value(False)
        wanted = stamp(row[key]) if kind is ua.VariantType.DateTime else row[key]
        assert found.Value.Value == wanted, name
        unknown = found.StatusCode.value == ua.StatusCodes.BadNoData
        assert unknown == (wanted is None), name
        if row["end_ns"] and wanted is not None:
            assert found.SourceTimestamp == stamp(row["end_ns"])
    group = await device.get_child(f"{di}:ParameterSet")
    assert len(await group.get_children()) == len(row["parameters"])
    for parameter in row["parameters"]:
        node = await group.get_child(f"{own}:{parameter['parameter']}")
        assert await node.read_type_definition() == ua.NodeId(ua.ObjectIds.AnalogItemType)
        level = await node.read_data_value(False)
        assert level.Value.Value == parameter["level"]
        unit = await (await node.get_child("0:EngineeringUnits")).read_value()
        assert unit.DisplayName.Text == parameter["unit"]
        assert (await (await node.get_child("0:EURange")).read_value()).High is not None
        for name, (key, _) in OF_PARAMETER.items():
            value = await (await node.get_child(f"{own}:{name}")).read_data_value(False)
            assert value.Value.Value == parameter[key], name


def test_every_write_and_call_of_a_client_is_refused(server, folder):
    async def attack():
        async with connected(server, folder) as client:
            own = await client.get_namespace_index(VALVES)
            cycle = client.get_node(ua.NodeId("/press/worn#Cycle", own))
            before = await cycle.read_value()
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await cycle.write_value(7)
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await client.nodes.server.call_method("0:GetMonitoredItems", 1)
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await client.nodes.objects.add_object(own, "mine")
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await client.delete_nodes([cycle])
            assert await cycle.read_value() == before
            assert await cycle.get_access_level() == {ua.AccessLevel.CurrentRead}

    asyncio.run(attack())


def test_without_user_or_encryption_nobody_looks(server, folder):
    async def knock():
        with pytest.raises(ua.UaError):  # anonymous
            async with Client(server.opcua):
                pass
        plain = Client(server.opcua)
        plain.set_user("anna")
        plain.set_password(PASSWORD)
        with pytest.raises((ua.UaError, ValueError)):  # in clear
            async with plain:
                await plain.get_node(ua.ObjectIds.Server_NamespaceArray).read_value()
        for user, password in (("anna", "wrong"), ("nobody", PASSWORD)):
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                async with connected(server, folder, user, password):
                    pass
        async with connected(server, folder):
            pass

    asyncio.run(knock())


def test_who_guesses_does_not_shut_out_the_owner_of_the_name_elsewhere(server, folder):
    async def guess() -> None:
        loop = asyncio.get_running_loop()
        connect = loop.create_connection
        from_elsewhere: Any = partial(connect, local_addr=("127.0.0.2", 0))
        for password in (*5 * ["wrong"], PASSWORD):
            loop.create_connection = from_elsewhere  # type: ignore[method-assign]
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                async with connected(server, folder, "anna", password):
                    pass
        loop.create_connection = connect  # type: ignore[method-assign]
        async with connected(server, folder):
            pass

    asyncio.run(guess())


def test_more_wrong_users_than_sessions_are_one_line_and_keep_nobody_out(server, folder):
    asyncio.run(guess(server, folder, MOST_SESSIONS + 50))


@pytest.mark.slow
def test_a_thousand_wrong_users_are_a_line_in_half_a_minute_and_keep_nobody_out(path, folder):
    users = folder / "users_of_thousand"
    users.write_text(f"{user_line('anna', PASSWORD)}\n", encoding="utf-8")
    server = Server(path, folder / "pki", "--opcua-users", str(users))
    begun_s = time.monotonic()
    try:
        asyncio.run(guess(server, folder, 1000))
    finally:
        took_s, said = time.monotonic() - begun_s, server.end()
    lines = said.count("users that do not exist from 127.0.0.1: refused for 30 s")
    assert 1 <= lines == len(said.splitlines()) <= 1 + took_s / 30.0
    print(f"\n1000 wrong users in {took_s:.0f} s: {lines} lines")  # noqa: T201


async def guess(server, folder, users: int) -> None:
    """Try so many users in as many sessions of one channel; somebody else comes in meanwhile."""
    await make_client_pair(folder)
    client = Client(server.opcua)
    client.application_uri = "urn:test:client"
    pair = str(folder / "client.der"), str(folder / "client.pem")
    await client.set_security(SecurityPolicyBasic256Sha256, *pair)
    await client.connect_socket()
    try:
        await client.send_hello()
        await client.open_secure_channel()
        for number in range(users):
            await client.create_session()
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await client.activate_session(username=f"user {number}", password=PASSWORD)
        async with connected(server, folder):  # while the guesser stays
            pass
    finally:
        client.disconnect_socket()


class Events:
    """What came of a subscription to events."""

    def __init__(self) -> None:
        self.seen: list[Any] = []

    def event_notification(self, event) -> None:
        self.seen.append(event)


def test_the_alarm_of_a_valve_that_comes_begins_and_that_of_one_that_goes_ends(tmp_path):
    path = tmp_path / "history.sqlite"
    store(path, "/v", range(1, 11), 0.0)
    server = Server(path, tmp_path / "pki", "--anonymous")

    async def follow():
        async with Client(server.opcua) as client:
            own, di = [await client.get_namespace_index(uri) for uri in (VALVES, DI)]
            alarms = Events()
            following = await client.create_subscription(100, alarms)
            await following.subscribe_alarms_and_conditions(
                client.nodes.server, ua.NodeId(15143, di)
            )
            await asyncio.to_thread(store, path, "/worn", range(1, 61), -0.0045)
            await until(lambda: [a for a in alarms.seen if a.SourceName == "/worn"])
            state = await client.get_node(ua.NodeId("/worn#State", own)).read_value()
            assert state != "good"
            with sqlite3.connect(path) as raw:
                ((number,),) = raw.execute("SELECT id FROM valve WHERE name = '/worn'")
                for table in ("estimate", "cycle", "verdict", "counters"):
                    raw.execute(f"DELETE FROM {table} WHERE valve_id = ?", [number])
                raw.execute("DELETE FROM valve WHERE id = ?", [number])
            await until(lambda: len([a for a in alarms.seen if a.SourceName == "/worn"]) > 1)
            begins, ends = [a for a in alarms.seen if a.SourceName == "/worn"]
            types = {s.value: ua.NodeId(n, di) for s, (_, n) in ALARMS.items()}
            assert begins.EventType == ends.EventType == types[state]
            assert [getattr(a, "ActiveState/Id") for a in (begins, ends)] == [True, False]
            assert [a.Retain for a in (begins, ends)] == [True, False]
            assert begins.NodeId == ends.NodeId

    try:
        asyncio.run(follow())
    finally:
        server.end()


def test_a_verdict_that_changes_is_an_event_and_a_lost_history_a_status(tmp_path):
    path = tmp_path / "history.sqlite"
    store(path, "/v", range(1, 41), 0.0)
    server = Server(path, tmp_path / "pki", "--anonymous")

    async def follow():
        async with Client(server.opcua) as client:
            own = await client.get_namespace_index(VALVES)
            device = client.get_node(ua.NodeId("/v", own))
            kind = await client.nodes.base_event_type.get_child(f"{own}:VerdictChangedEventType")
            events = Events()
            subscription = await client.create_subscription(100, events)
            await subscription.subscribe_events(device, kind)
            alarms = Events()
            following = await client.create_subscription(100, alarms)
            di = await client.get_namespace_index(DI)
            await following.subscribe_alarms_and_conditions(device, ua.NodeId(15143, di))
            state = await client.get_node(ua.NodeId("/v#State", own)).read_value()
            before = await client.get_node(ua.NodeId("/v#Verdict", own)).read_value()
            await asyncio.to_thread(store, path, "/v", range(41, 101), -0.006)
            await until(lambda: events.seen)
            event: Any = events.seen[-1]
            assert event.Verdict != before
            assert event.SourceName == "/v"
            assert event.State != state
            await until(lambda: len(alarms.seen) >= (event.State != "good") + (state != "good"))
            told: list[Any] = alarms.seen
            ends = {a.EventType: getattr(a, "ActiveState/Id") for a in told}
            types = {s.value: ua.NodeId(n, di) for s, (_, n) in ALARMS.items()}
            wanted = {types[s]: s == event.State for s in (state, event.State) if s in types}
            assert ends == wanted
            assert all(a.NodeId.Identifier.startswith("/v#DeviceHealthAlarms#") for a in told)
            assert all(a.SourceName == "/v" and a.Retain == (a.Severity == event.Severity)
                       for a in told)  # fmt: skip
            assert event.Message.Text.startswith(f"/v: {event.Verdict} ({event.State}): ")
            cycle = client.get_node(ua.NodeId("/v#Cycle", own))
            kept = await cycle.read_value()

            async def status(node=cycle) -> int:
                return int((await node.read_data_value(False)).StatusCode.value)

            with sqlite3.connect(path) as raw:
                raw.execute("ALTER TABLE cycle RENAME TO gone")
            await until_status(status, ua.StatusCodes.UncertainLastUsableValue)
            assert (await cycle.read_data_value(False)).Value.Value == kept
            readable = client.get_node(ua.NodeId("History#Readable", own))
            assert not await readable.read_value()
            failure = await client.get_node(ua.NodeId("History#Failure", own)).read_value()
            assert "no such table" in failure
            with sqlite3.connect(path) as raw:
                raw.execute("ALTER TABLE gone RENAME TO cycle")
            await until_status(status, ua.StatusCodes.Good)
            assert await readable.read_value()

    try:
        asyncio.run(follow())
    finally:
        assert "Traceback" not in server.end()


def test_values_that_a_node_tells_stay_good_while_the_history_cannot_be_read(tmp_path):
    """All were uncertain, also those that every other face showed as live."""
    rows = FleetRow("/a", cycle=3), FleetRow("/b", cycle=5)
    view = View(rows, failure="no disk", told=frozenset({"/b"}))
    face = OpcUaFace(lambda: view, "opc.tcp://127.0.0.1:0", Access(tmp_path, anonymous=True))
    try:
        face.start()
        found = {str(node.Identifier): value for node, value in face._shown.items()}
    finally:
        face.stop()
    assert found["/a#Cycle"].StatusCode.name == "UncertainLastUsableValue"
    assert found["/b#Cycle"].StatusCode.name == "Good"
    assert found["History#Readable"].Value.Value is False


def test_a_server_that_could_not_start_is_stopped_while_its_thread_ends(tmp_path, monkeypatch):
    """Between its last word and its end 'Event loop is closed' took the place of the reason."""
    folder = tmp_path / "pki"
    folder.touch()
    face = OpcUaFace(View, "opc.tcp://127.0.0.1:0", Access(folder, anonymous=True))
    with pytest.raises(ConfigError, match="cannot be written"):
        face.start()
    monkeypatch.setattr(face._thread, "is_alive", lambda: True)
    face.stop()


async def until(condition, most_s=60.0) -> None:
    end = time.monotonic() + most_s
    while not condition():
        assert time.monotonic() < end
        await asyncio.sleep(0.1)


async def until_status(read, wanted, most_s=60.0) -> None:
    end = time.monotonic() + most_s
    while await read() != wanted:
        assert time.monotonic() < end
        await asyncio.sleep(0.1)


@pytest.mark.parametrize(
    "kills",
    [2, pytest.param(100, marks=(pytest.mark.slow, pytest.mark.timeout(3600)))],
)
def test_a_server_that_is_killed_shows_all_that_was_stored_to_a_client_that_stays(tmp_path, kills):
    """5 s where an import of asyncua takes 0.45 s: live again within eleven of them."""
    gone_s, imports_s = outlive(tmp_path, kills, random.Random(14))
    ratio = statistics.median(g / i for g, i in zip(gone_s, imports_s, strict=True))
    median_s, most_s = statistics.median(gone_s), max(gone_s)
    said = f"{median_s:.1f} s, at most {most_s:.1f} s of {kills}, {ratio:.1f} imports of asyncua"
    print(f"\nlive again: {said}")  # noqa: T201
    assert ratio < 11.0, said


def test_a_client_that_never_reads_is_let_go_and_one_that_reads_slowly_stays(tmp_path, caplog):
    plant = Plant(f"sqlite:///{tmp_path}/none.sqlite")
    access = Access(tmp_path, None, anonymous=True)
    face = OpcUaFace(plant.view, "opc.tcp://127.0.0.1:0", access)

    async def left(unread: int) -> bool:
        ours, theirs = socket.socketpair()
        with theirs:
            _, writer = await asyncio.open_connection(sock=ours)
            writer.write(bytes(unread))
            client = SimpleNamespace(transport=writer.transport, peer_name=f"{unread} unread")
            face._let_go(SimpleNamespace(bserver=SimpleNamespace(clients=[client])))
            gone = writer.transport.is_closing()
            writer.transport.abort()
        return gone

    assert asyncio.run(left(2 * MOST_UNREAD))
    assert not asyncio.run(left(MOST_UNREAD // 2))
    assert [r.getMessage() for r in caplog.records if "let go" in r.getMessage()] == [
        f"OPC UA: {2 * MOST_UNREAD} unread does not read: let go"
    ]


def test_a_client_that_asks_and_never_reads_is_let_go_while_another_one_reads(path, tmp_path):
    server = Server(path, tmp_path / "pki", "--anonymous")

    async def ask_and_never_read(client) -> None:
        """Ask for 3.4 MB at a time, until the server has hung up."""
        whole = ua.ReadValueId(NodeId=ua.NodeId(8252))  # the types as XML: 343 kB
        whole.AttributeId = ua.AttributeIds.Value
        asked = ua.ReadParameters(NodesToRead=[whole] * 10)
        transport, tasks = client.uaclient.protocol.transport, []
        transport.pause_reading()
        end_s = time.monotonic() + 100.0
        while not transport.is_closing():
            assert time.monotonic() < end_s
            tasks.append(asyncio.create_task(client.uaclient.session.read(asked)))
            await asyncio.sleep(0.1)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def look() -> None:
        deaf = Client(server.opcua, timeout=200)
        await deaf.connect()
        async with Client(server.opcua) as other:
            name = other.get_node(ua.NodeId(ua.ObjectIds.Server_ServerStatus_State))
            asking = asyncio.create_task(ask_and_never_read(deaf))
            while not asking.done():
                assert await name.read_value() == ua.ServerState.Running
                await asyncio.sleep(0.05)
            await asking
        deaf.disconnect_socket()

    try:
        asyncio.run(look())
    finally:
        said = server.end()
    assert re.fullmatch(r".*OPC UA: .*127\.0\.0\.1.* does not read: let go\n", said)


def test_no_look_for_garbage_holds_up_the_making_of_the_nodes(tmp_path):
    looks: list[str] = []
    plant = Plant(f"sqlite:///{tmp_path}/none.sqlite")
    access = Access(tmp_path / "pki", None, anonymous=True)
    face = OpcUaFace(plant.view, "opc.tcp://127.0.0.1:0", access)
    gc.callbacks.append(note := lambda phase, _: looks.append(phase))
    try:
        asyncio.run(face._made())
    finally:
        gc.callbacks.remove(note)
    assert len(looks) < 100  # of 6000 nodes, each made of 100 values; 700 values are a look


def test_valves_are_shown_as_soon_as_the_history_was_read_for_the_first_time(
    tmp_path, path, monkeypatch
):
    monkeypatch.setattr("valve_twin.gateway.opcua.server.PERIOD_S", 3600.0)
    read, asked = Plant(f"sqlite:///{path}").view(), list[View]()

    def news() -> View:
        asked.append(read if len(asked) >= 3 else View(whole=False))
        return asked[-1]

    face = OpcUaFace(news, "opc.tcp://127.0.0.1:0", Access(tmp_path, None, anonymous=True))
    face.start()
    try:
        end_s = time.monotonic() + 120.0
        while set(face._said) != {row.valve for row in read.rows}:
            assert time.monotonic() < end_s, len(asked)
            time.sleep(0.02)
    finally:
        face.stop()
    assert [view.whole for view in asked] == [False, False, False, True]


class Follower:
    """A client that stays: connects again and again and notes each cycle that it sees."""

    def __init__(self, address: str, valve: str = "/v") -> None:
        self.seen: list[int] = []
        self._address, self._valve, self._ends = address, valve, threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._follow()), daemon=True)
        self._thread.start()

    async def _follow(self) -> None:
        while not self._ends.is_set():
            client = Client(self._address, timeout=2)
            with suppress(Exception):  # the server is gone, or not there yet
                await self._look(client)
            channel = client.uaclient.protocol
            if channel is not None and channel.transport is not None:
                channel.transport.abort()  # asyncua leaves it open where connecting took too long
            await asyncio.sleep(0.05)

    async def _look(self, client: Client) -> None:
        async with client:
            own = await client.get_namespace_index(VALVES)
            node = client.get_node(ua.NodeId(f"{self._valve}#Cycle", own))
            while not self._ends.is_set():
                self._note(await node.read_value())
                await asyncio.sleep(0.05)

    def _note(self, cycle: int) -> None:
        if self.seen[-1:] != [cycle]:
            self.seen.append(cycle)

    def wait_for(self, cycle: int) -> None:
        end = time.monotonic() + 120.0
        while self.seen[-1:] != [cycle]:
            assert time.monotonic() < end, (cycle, self.seen[-3:])
            time.sleep(0.02)

    def end(self) -> None:
        self._ends.set()
        self._thread.join(30.0)


def outlive(folder, kills: int, chance: random.Random) -> tuple[list[float], list[float]]:
    """Kill the server at any time while cycles are stored.

    Return how long it was gone, and how long an import of asyncua took just before [s].
    """
    path, port = folder / "history.sqlite", free_port()
    store(path, "/v", range(1, 41), 0.0)
    address = f"opc.tcp://127.0.0.1:{port}"
    more = ("--anonymous", "--opcua", address)
    server, follower = Server(path, folder / "pki", *more), Follower(address)
    cycle, gone_s, imports_s = 40, list[float](), list[float]()
    follower.wait_for(cycle)
    for _ in range(kills):
        store(path, "/v", range(cycle + 1, cycle + 2), 0.0)
        time.sleep(chance.uniform(0.0, 1.5))  # anywhere in reading and showing it
        server.process.kill()
        server.process.wait()
        assert server.process.stderr is not None
        server.process.stderr.close()
        store(path, "/v", range(cycle + 2, cycle + 3), 0.0)
        cycle += 2
        begun_s = time.monotonic()
        subprocess.run([sys.executable, "-c", "import asyncua"], check=True)
        imports_s.append(time.monotonic() - begun_s)
        begun_s = time.monotonic()
        server = Server(path, folder / "pki", *more)
        follower.wait_for(cycle)
        gone_s.append(time.monotonic() - begun_s)
    follower.end()
    assert follower.seen == sorted(set(follower.seen))  # never back, never twice
    assert server.json()["/v"]["cycle"] == cycle
    assert "Traceback" not in server.end()
    with History(path, read_only=True) as history:
        assert [c.cycle for c in history.cycles("/v")] == list(range(1, cycle + 1))
        assert [e.cycle for e in history.estimates("/v")] == list(range(1, cycle + 1))
    return gone_s, imports_s


def refusal(path, *more: str) -> tuple[int, str]:
    command = [sys.executable, "-m", "valve_twin.cli", "serve", "--port", "0", "--opcua", *more]
    done = subprocess.run(
        [*command, "--url", f"sqlite:///{path}"],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.stderr.count("\n") == 1, done.stderr
    return done.returncode, done.stderr


def test_what_cannot_be_served_gets_one_line(path, tmp_path, capsys):
    pki = ("--opcua-pki", str(tmp_path / "pki"))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        address = f"opc.tcp://127.0.0.1:{port}"
        code, said = refusal(path, address, "--anonymous", *pki)
    assert code == 1
    assert f"cannot listen at 127.0.0.1:{port}" in said
    (tmp_path / "pki" / "key.pem").unlink()
    for given, part in (
        (address, "key.pem: is missing"),
        ("http://x", "'http://x' is no address"),
    ):
        asked = ["serve", "--port", "0", "--url", f"sqlite:///{path}", "--opcua", given]
        assert main([*asked, "--anonymous", *pki]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert part in said


def test_the_number_of_a_unit_is_that_of_the_standard():
    assert unit_number("C81") == 4405297  # radian, of the foundation's table
    assert unit_number("DD") == 17476
    assert unit_number("4T") == 13396
