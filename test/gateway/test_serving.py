# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where the pages are served: what cannot be is one line, what everybody can see is told."""

from __future__ import annotations

import asyncio
import io
import socket
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from starlette.requests import Request

pytest.importorskip("cryptography", reason="needs the extra gateway")

from test.gateway.page.test_forms import make_pair
from valve_twin.cli import main
from valve_twin.gateway import serving
from valve_twin.gateway.passwords import read_users
from valve_twin.gateway.serving import Place, check_pair, check_place, listen
from valve_twin.io.errors import ConfigError


def refusal(*given: str) -> str:
    with pytest.raises(ConfigError) as caught:
        check_pair(*given)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_a_pair_that_browsers_would_not_take_is_refused_in_a_line(tmp_path):
    certificate, key = make_pair(tmp_path / "a")
    check_pair(certificate, key)
    other = make_pair(tmp_path / "b")
    assert f"{other[1]}: is no key" in refusal(certificate, other[1])
    old = make_pair(tmp_path / "c", days=-1)
    assert f"{old[0]}: holds from" in refusal(*old)
    early = make_pair(tmp_path / "d", days=30)
    assert f"{early[0]}: holds from" in refusal(*early)
    assert "is no certificate (PEM)" in refusal(key, key)
    missing = str(tmp_path / "none.pem")
    assert refusal(missing, key) == f"{missing}: cannot be read: No such file or directory"
    assert refusal(certificate, missing).startswith(missing)


def test_who_can_look_on_is_told_and_passwords_do_not_go_in_the_clear(tmp_path):
    certificate, key = make_pair(tmp_path)
    for host in ("127.0.0.1", "localhost", "::1"):
        assert check_place(Place(host), accounts=True) == ""
    for host in ("0.0.0.0", "::", "192.168.0.7", "plant.example"):
        assert "without TLS" in check_place(Place(host), accounts=False)
        with pytest.raises(ConfigError, match="in the clear"):
            check_place(Place(host), accounts=True)
        assert check_place(Place(host, 0, certificate, key), accounts=True) == ""
    with pytest.raises(ConfigError, match="the key is missing"):
        check_place(Place(certificate=certificate), accounts=False)
    with pytest.raises(ConfigError, match="the certificate is missing"):
        check_place(Place(key=key), accounts=False)
    with pytest.raises(ConfigError, match="choose another port or host"):
        listen(Place("256.1.1.1"))


def connections(port: int) -> int:
    """Return how many connections are served at a port of this machine."""
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:]
    rows = [line.split()[1:4] for line in lines]
    return sum(own.endswith(f":{port:04X}") and state == "01" for own, _, state in rows)


def test_who_is_connected_and_idle_is_let_go_and_who_waits_for_an_answer_is_not(monkeypatch):
    from starlette.applications import Starlette
    from starlette.responses import PlainTextResponse, Response
    from starlette.routing import Route

    async def slow(_: Request) -> Response:
        await asyncio.sleep(5 * 0.2)
        return PlainTextResponse("at last")

    async def form(request: Request) -> Response:
        return PlainTextResponse(await request.body())

    def large(_: Request) -> Response:
        return PlainTextResponse("x" * 50_000_000)

    monkeypatch.setattr(serving, "IDLE_S", 0.2)
    routes = [Route("/slow", slow), Route("/large", large), Route("/form", form, methods=["POST"])]
    server = serving.Background(Starlette(routes=routes), Place(port=0), pytest.fail)
    place = "127.0.0.1", int(server.address.rstrip("/").rpartition(":")[2])
    head = b"Host: x\r\n\r\n"
    asked = [
        b"",
        b"GET /slow HT",
        b"POST /form HTTP/1.1\r\nContent-Length: 9\r\n" + head + b"half",
        b"GET /large HTTP/1.1\r\n" + head,
    ]
    with ExitStack() as stack:
        stack.callback(server.stop)
        waiting = stack.enter_context(socket.create_connection(place, timeout=20.0))
        waiting.sendall(b"GET /slow HTTP/1.1\r\nConnection: close\r\n" + head)
        idle = [stack.enter_context(socket.create_connection(place, timeout=20.0)) for _ in asked]
        for client, text in zip(idle, asked, strict=True):
            client.sendall(text)
        answer = b"".join(iter(lambda: waiting.recv(4096), b""))
        assert answer.endswith(b"at last")
        for client in idle[:3]:
            with suppress(ConnectionResetError):
                assert client.recv(10) == b""
        while connections(place[1]):  # it may still make what is not read
            time.sleep(0.05)
        seen = 0
        with suppress(ConnectionResetError):
            seen = sum(map(len, iter(lambda: idle[3].recv(1 << 20), b"")))
        assert seen < 50_000_000  # not read until now: cut off


def test_who_asks_now_and_then_is_not_idle_where_a_request_has_the_address_of_the_last():
    class Answered:
        response_complete = True

    protocol: Any = object.__new__(serving._impatient())
    protocol.transport = SimpleNamespace(get_write_buffer_size=lambda: 0)
    seen = []
    for _ in range(2):
        protocol.cycle = None  # the last one goes before the next comes
        protocol.cycle = Answered()
        seen.append(protocol._hindered())
    assert seen[0] != seen[1]
    assert seen[1] == protocol._hindered()


def test_a_user_is_added_with_a_password_that_no_list_of_processes_shows(
    tmp_path, monkeypatch, capsys
):
    users = tmp_path / "users"
    command = ["serve", "--users", str(users), "--add-user"]
    monkeypatch.setattr(sys, "stdin", io.StringIO("correct horse\nmore\n"))
    assert main([*command, "anna"]) == 0
    assert set(read_users(users)) == {"anna"}
    assert "correct horse" not in users.read_text()
    assert users.stat().st_mode & 0o077 == 0
    monkeypatch.setattr(sys, "stdin", io.StringIO("correct horse\n"))
    assert main([*command, "anna"]) == 1
    monkeypatch.setattr(sys, "stdin", io.StringIO("short\n"))
    assert main([*command, "bert"]) != 0
    assert main(["serve", "--add-user", "bert"]) == 2
    assert "needs --users FILE" in capsys.readouterr().err
    assert set(read_users(users)) == {"anna"}


def test_the_loop_is_one_that_asks_our_listener_whom_to_take(monkeypatch):
    from starlette.applications import Starlette

    monkeypatch.setitem(sys.modules, "uvloop", SimpleNamespace(new_event_loop=None))
    factory = serving.make_server(Starlette(), Place()).config.get_loop_factory()
    assert factory is not None
    loop = factory()
    assert isinstance(loop, asyncio.SelectorEventLoop)
    loop.close()
