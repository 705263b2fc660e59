# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The moving plot: from the topics of a twin over the gateway into a real browser."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

import pytest

pytest.importorskip("starlette", reason="needs the extra gateway")

from diagnostic_msgs.msg import DiagnosticArray

from test.gateway.chromium import Browser
from test.gateway.test_web import store
from test.nodes.conftest import NS, CoreWait
from test.nodes.gateway.fake_twin import RATE_HZ, expected
from test.small_disk import small_disk
from valve_twin.gateway.first_reading import WAITING
from valve_twin.gateway.passwords import user_line
from valve_twin.io.history.store import History
from valve_twin.nodes.gateway.node import GatewayNode
from valve_twin.nodes.runtime.diagnostics import OK, WARN

FAKE = Path(__file__).with_name("fake_twin.py")
MINUS = "\N{MINUS SIGN}"


class FakeTwin:
    """A publisher in a process of its own, to be killed."""

    def __init__(self, domain: int, rate_hz: float = RATE_HZ) -> None:
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        command = [sys.executable, str(FAKE), str(rate_hz), NS]
        self.process = subprocess.Popen(command, env=environment)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture
def history(tmp_path):
    path = tmp_path / "history.sqlite"
    store(path, NS, range(1, 21), 0.0)
    return path


@pytest.fixture
def gateway(graph, history):
    made = graph.start("gateway", port=0, history_url=f"sqlite:///{history}")
    found = graph.spin_until(
        lambda: re.search(r"http://127\.0\.0\.1:\d+", made.log), what="the gateway"
    )
    return found.group(), made


@pytest.fixture
def twin(graph):
    made = FakeTwin(graph.domain)
    yield made
    made.kill()


@pytest.fixture
def browser(tmp_path):
    made = Browser(tmp_path / "profile")
    yield made
    made.close()


def cpu_s(pid: int) -> float:
    """Return the CPU time of a process so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident(pid: int) -> int:
    """Return the memory of a process [B]."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def has_read_the_history(address: str) -> bool:
    """Return whether every valve was assessed since the start."""
    with urllib.request.urlopen(address, timeout=60) as answer:
        return WAITING not in answer.read().decode()


def events(address: str):
    """Yield what the moving plot is told."""
    with urllib.request.urlopen(f"{address}/live{NS}", timeout=60) as answer:
        for line in answer:
            if line.startswith(b"data: "):
                yield json.loads(line[6:])


def test_values_shown_are_those_of_the_topic_with_that_stamp(gateway, twin):
    address, _ = gateway
    seen = 0
    for told in events(address):
        if told["state"] != "live":
            continue
        values = expected(told["stamp"] * 1_000_000)
        for name, value in values.items():
            shown = float(told["values"][name].replace(MINUS, "-"))
            assert shown == pytest.approx(value, abs=0.6e-5), name
        assert told["values"]["cycle"] == "7"
        seen += 1
        if seen == 10:
            break


def test_foxglove_shows_the_topics_of_a_twin_beside_those_of_the_history(graph, history, twin):
    pytest.importorskip("foxglove", reason="needs the extra gateway")
    from test.gateway.foxglove.test_face import Viewer

    url = f"sqlite:///{history}"
    made = graph.start("gateway", port=0, foxglove=0, history_url=url)
    address = graph.spin_until(
        lambda: re.search(r"ws://127\.0\.0\.1:\d+", made.log), what="Foxglove"
    ).group()
    prediction, command = f"{NS}/twin/prediction", f"{NS}/command/v_in"
    viewer = Viewer(address)
    try:
        viewer.look_at(prediction, command, f"{NS}/twin/estimate")
        viewer.until(lambda: len(viewer.of(prediction)) > 100, "predictions")
        viewer.until(lambda: viewer.of(command), "commands")
        viewer.until(lambda: viewer.of(f"{NS}/twin/estimate"), "estimates of the history")
        for told in viewer.of(prediction):
            stamp_ns = told.header.stamp.sec * 10**9 + told.header.stamp.nanosec
            wanted = expected(stamp_ns)
            assert told.measured == wanted["measured"]
            assert told.simulated == wanted["freerun"]
        assert viewer.of(command)[-1].value in {0.0, 1.0}
    finally:
        viewer.socket.close()


def test_the_browser_draws_says_stale_within_three_seconds_and_recovers(
    graph, gateway, twin, browser
):
    address, process = gateway
    browser.open(f"{address}/valve{NS}")
    state = "document.querySelector('#live').dataset.state"
    browser.wait_for(f"{state} === 'live'")
    browser.wait_for("document.querySelectorAll('#slices .measured').length > 8")
    browser.wait_for("document.querySelectorAll('#slices .expected').length > 8")
    browser.wait_for("document.querySelectorAll('#slices .s0').length > 1")
    assert browser.run("document.querySelector('#slices .measured').getBoundingClientRect().width")
    number = browser.run("Number(document.querySelector('[data-value=measured]').textContent)")
    assert 0.1 <= number <= 0.9
    # in the page, so that a busy test machine does not count
    browser.run(
        "window.heardAt = [performance.now()]; new EventSource(document.querySelector('#live')"
        ".dataset.source).onmessage = (e) => { const m = JSON.parse(e.data);"
        " if (m.stamp !== window.lastStamp) { window.lastStamp = m.stamp;"
        " window.heardAt[0] = performance.now(); } }; new MutationObserver(() => {"
        " if (document.querySelector('#live').dataset.state === 'stale' && !window.staleAt)"
        " window.staleAt = performance.now(); }).observe(document.querySelector('#live'),"
        " {attributes: true}); window.late = 0; let last = performance.now();"
        " setInterval(() => { const now = performance.now();"
        " window.late = Math.max(window.late, now - last - 50); last = now; }, 50); 1"
    )
    waited = CoreWait(process.pid)
    twin.kill()
    browser.wait_for(f"{state} === 'stale'")
    quiet_ms, late_ms = browser.run("[window.staleAt - window.heardAt[0], window.late]")
    late_ms += 1e3 * waited.so_far_s()
    assert quiet_ms < 3000.0 + late_ms  # what the machine kept page and gateway waiting: not ours
    assert "STALE" in browser.text("#live .now")
    again = FakeTwin(graph.domain)
    try:
        browser.wait_for(f"{state} === 'live'")
    finally:
        again.kill()
    assert browser.complaints() == []
    assert {"/".join(asked.split("/")[:3]) for asked in browser.asked()} == {address}


def test_a_gateway_that_is_killed_is_told_too(gateway, twin, browser):
    address, process = gateway
    browser.open(f"{address}/valve{NS}")
    state = "document.querySelector('#live').dataset.state"
    browser.wait_for(f"{state} === 'live'")
    process.kill()
    browser.wait_for(f"{state} === 'stale'")
    browser.wait_for("!document.querySelector('#gone').hidden")


def _participant(graph, topic: str) -> bytes:
    """Return whose the one reader of a topic is: the first part of its GUID (RTPS 9.3.1.5)."""
    (found,) = graph.node.get_subscriptions_info_by_topic(topic)
    return bytes(found.endpoint_gid[:12])


def test_nobody_who_looks_costs_nothing_and_twenty_cost_little(graph, gateway):
    address, made = gateway
    twin = FakeTwin(graph.domain, 1000.0)
    topic = f"{NS}/twin/prediction"
    try:
        graph.spin_until(lambda: graph.node.count_publishers(topic), what="the twin")
        assert graph.node.count_subscribers(topic) == 0
        got = [0] * 20

        def look(place: int) -> None:
            for _ in events(address):
                got[place] += 1
                if stop.is_set():
                    return

        stop = threading.Event()
        threads = [threading.Thread(target=look, args=(k,), daemon=True) for k in range(20)]
        for thread in threads:
            thread.start()
        graph.spin_until(lambda: min(got) > 10, what="all viewers")
        participants = {_participant(graph, t) for t in (topic, f"{NS}/aging_monitor/verdict")}
        assert len(participants) == 2  # no prediction is offered to readers of states
        shares = []
        for _ in range(5):
            before, begun = cpu_s(made.pid), time.monotonic()
            time.sleep(3.0)
            after, end = cpu_s(made.pid), time.monotonic()
            shares.append((after - before) / (end - begun))
        stop.set()
        for thread in threads:
            thread.join(60)
        assert sorted(shares)[2] <= 0.08, shares
        graph.spin_until(lambda: graph.node.count_subscribers(topic) == 0, what="no subscriber")
    finally:
        twin.kill()


def test_a_viewer_that_never_reads_holds_up_nobody(gateway, twin):
    address, made = gateway
    host, port = address.removeprefix("http://").split(":")
    idle = []
    for _ in range(10):
        deaf = socket.create_connection((host, int(port)))
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.sendall(f"GET /live{NS} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        idle.append(deaf)
    begun, seen = 0, 0
    for told in events(address):
        seen += told["state"] == "live"
        if not begun and seen >= 10 and has_read_the_history(address):
            begun, seen = resident(made.pid), 10  # all is loaded that it needs
        if begun and seen >= 60:
            break
    assert resident(made.pid) - begun < 50e6
    for deaf in idle:
        deaf.close()


def test_work_is_marked_with_the_twin_and_with_the_history_where_none_runs(
    graph, history, tmp_path
):
    users = tmp_path / "users"
    users.write_text(user_line("anna", "correct horse") + "\n")
    url = f"sqlite:///{history}"
    node = graph.host(GatewayNode, port=0, history_url=url, users=str(users))
    from valve_twin.gateway.page.marking import Work

    def mark(note: str) -> str:
        said: list[str] = []
        work = Work(NS, note, "anna")
        thread = threading.Thread(target=lambda: said.append(node._marker.mark(work)))
        thread.start()
        graph.spin_until(lambda: said, what="an answer")
        thread.join()
        return said[0]

    assert mark("seal") == f"{NS}: maintenance noted from cycle 21 on"
    graph.start("twin", history_url=url)
    client = node._marker._clients[NS, next(iter(node._marker._clients))[1]]
    graph.spin_until(client.service_is_ready, what="the twin")
    graph.be_heard(f"{NS}/twin")  # or its answer may find nobody
    assert "maintenance noted from cycle" in mark("spring")
    with History(url, read_only=True) as stored:
        notes = [m.note for m in stored.maintenance(NS)]
    assert notes == ["seal (anna, on the page)", "spring (anna, on the page)"]


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"certificate": "/none.pem", "key": "/none.key"}, "/none.pem: cannot be read"),
        ({"certificate": "/none.pem"}, "the key is missing"),
        ({"users": "/none"}, "/none: cannot be read"),
        ({"users": "/none", "host": "0.0.0.0"}, "in the clear"),
    ],
)
def test_a_wrong_parameter_is_one_line(graph, history, capfd, more, why):
    node = graph.host(GatewayNode, port=0, history_url=f"sqlite:///{history}", **more)
    graph.spin_until(lambda: True)
    assert node.state == "unconfigured"
    said = capfd.readouterr().err
    assert why in said
    assert "Traceback" not in said


def test_a_port_that_is_taken_is_one_line(graph, history, capfd):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        node = graph.host(GatewayNode, port=port, history_url=f"sqlite:///{history}")
        assert node.state == "inactive"
        said = capfd.readouterr().err
        assert f"cannot activate: cannot listen at 127.0.0.1:{port}" in said
        assert "Traceback" not in said


def test_a_gateway_waits_for_its_disk_and_for_its_history_and_shows_both_faces_then(
    graph, tmp_path
):
    """It stayed inactive for good, later until the disk was there: no page was shown meanwhile."""
    path = tmp_path / "history.sqlite"
    with small_disk(tmp_path / "disk", "1m") as disk:
        disk.mount("remount,ro")
        told = graph.record("/diagnostics", DiagnosticArray)

        def pages() -> list[tuple[bytes, str]]:
            found = [s for t in told for s in t.status if s.name.endswith("pages")]
            return [(status.level, status.message) for status in found[-1:]]

        made = graph.start(
            "gateway",
            port=0,
            history_url=f"sqlite:///{path}",
            mqtt="mqtt://127.0.0.1:1",
            mqtt_state=str(disk.place / "marks" / "state"),
        )
        graph.wait_log(made, "cannot be written")
        graph.spin_until(lambda: "no such file: check the path; waiting" in made.log, 60.0, "it")
        graph.spin_until(
            lambda: any(
                level == WARN and "no such file" in said and "cannot be written" in said
                for level, said in pages()
            ),
            60.0,
            "both on /diagnostics",
        )
        store(path, NS, range(1, 4), 0.0)
        found = graph.spin_until(
            lambda: re.search(r"http://127\.0\.0\.1:\d+", made.log), what="the address"
        )

        def cycles() -> list[int]:
            with urllib.request.urlopen(f"{found.group()}/api/valves", timeout=60) as answer:
                return [v["cycle"] for v in json.load(answer)["valves"]]

        graph.spin_until(lambda: cycles() == [3], 60.0, "the history")
        graph.spin_until(lambda: f"{path}: is read" in made.log, 60.0, "a word of it")
        disk.mount("remount,rw")
        graph.spin_until((disk.place / "marks" / "state").exists, what="the marks")
        graph.wait_log(made, "MQTT to 127.0.0.1:1")
        graph.spin_until(lambda: pages() == [(OK, "ok")], 60.0, "it on /diagnostics")
        graph.wait_log(made, "state: cannot be written: Read-only file system: make the disk")
        assert "cannot activate" not in made.log
        assert made.log.count("cannot be written") == 1
        assert "Traceback" not in made.log
        made.kill()
