# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A history in a browser: a real server in a process of its own, asked over TCP."""

from __future__ import annotations

import json
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from test.io.history.test_fleet import estimate, record
from test.ports import free_port
from valve_twin.cli import main
from valve_twin.gateway.page.answers import HEADERS
from valve_twin.io.history.store import History

HOSTILE = '/press/<script>alert(1)</script> & "co"'


def store(path: Path, valve: str, cycles: range, rate: float) -> None:
    with History(path) as history:
        for cycle in cycles:
            wave = 0.003 * (-1) ** cycle
            values = {"K_in": 0.01 * (1 + rate * cycle + wave), "K_out": 0.045, "leak": 1e-3}
            history.store(valve, record(cycle), (estimate(cycle, values),))


class Server:
    """`valve-twin serve` as a user starts it."""

    def __init__(
        self,
        path: Path,
        *more: str,
        scheme: str = "http",
        program: tuple[str, ...] = ("-m", "valve_twin.cli", "serve", "--port", "0"),
    ) -> None:
        command = [sys.executable, *program]
        self.process = subprocess.Popen(
            [*command, "--url", f"sqlite:///{path}", *more], stderr=subprocess.PIPE, text=True
        )
        assert self.process.stderr is not None
        found, told = None, []
        while found is None:  # what is damaged is told first
            told.append(self.process.stderr.readline())
            assert told[-1], told
            found = re.search(rf"{scheme}://127\.0\.0\.1:\d+", told[-1])
        self.begun, self.address = "".join(told), found.group()
        self._lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self._lines.append(line)

    def said(self) -> str:
        """Return what it has written since its first line."""
        return "".join(self._lines)

    def get(
        self, path: str, method: str = "GET", headers: dict[str, str] | None = None
    ) -> tuple[int, str, dict[str, str]]:
        request = urllib.request.Request(self.address + path, method=method, headers=headers or {})
        try:
            with urllib.request.urlopen(request, timeout=30) as answer:
                return answer.status, answer.read().decode(), dict(answer.headers)
        except urllib.error.HTTPError as err:
            return err.code, err.read().decode(), dict(err.headers)

    def end(self) -> int:
        self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(30)
        finally:
            self.kill()

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(30)
        self._reader.join(30)
        assert self.process.stderr is not None
        self.process.stderr.close()


FAILS_LATE = """
import sys, time
from pathlib import Path
from valve_twin.cli import main
from valve_twin.gateway import plant
from valve_twin.io.errors import StoreError

def marks(_):
    while not Path(sys.argv[1]).exists():
        time.sleep(0.05)
    raise StoreError("the database does not answer")

plant.LATE_S, plant.History.marks = 0.1, marks
sys.exit(main(["serve", "--port", "0", *sys.argv[2:]]))
"""


def test_a_first_reading_that_fails_once_the_pages_are_served_is_told(tmp_path):
    """The page alone said so, and whoever had started it read that all is well."""
    path, go_on = tmp_path / "history.sqlite", tmp_path / "go_on"
    store(path, "/v", range(1, 3), 0.0)
    server = Server(path, program=("-c", FAILS_LATE, str(go_on)))
    try:
        assert "valves still to be assessed" in server.begun
        go_on.touch()
        wait_for(lambda: "the database does not answer; waiting" in server.said())
        assert server.end() == 0
    finally:
        server.kill()


INTERRUPTED = """
import os, signal, sys
import uvicorn.server
from valve_twin.cli import main
from valve_twin.cli.archive import serve

def then(does):
    def first(*given, **named):
        does(*given)
        os.kill(os.getpid(), signal.SIGINT)
    return first

def begins(coroutine, *, loop_factory, runs=uvicorn.server.asyncio_run):
    os.kill(os.getpid(), signal.SIGINT)
    runs(coroutine, loop_factory=loop_factory)

serve.say, uvicorn.server.asyncio_run = then(serve.say), begins
sys.exit(main(["serve", "--port", "0", "--url", sys.argv[1]]))
"""


def test_ctrl_c_ends_it_as_soon_as_the_address_is_said_and_while_it_begins_to_serve(path):
    command = [sys.executable, "-c", INTERRUPTED, f"sqlite:///{path}"]
    found = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert (found.returncode, found.stdout, found.stderr.count("\n")) == (0, "", 1), found.stderr
    assert "valves at http://127.0.0.1:" in found.stderr


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    made = tmp_path_factory.mktemp("gateway") / "history.sqlite"
    store(made, "/press/worn", range(1, 61), -0.0045)
    store(made, "/press/new", range(1, 61), 0.0)
    store(made, HOSTILE, range(1, 3), 0.0)
    return made


@pytest.fixture(scope="module")
def server(path):
    made = Server(path)
    yield made
    assert made.end() == 0


def test_the_page_of_all_valves_shows_the_worst_first_with_state_and_what_to_do(server):
    status, page, headers = server.get("/")
    assert status == 200
    assert page.index("/press/worn") < page.index("/press/new")
    assert '<span class="sign out_of_specification">S</span>' in page
    assert '<span class="sign good">' in page
    assert "overhaul it, now" in page
    assert {k.lower(): v for k, v in headers.items()}.items() >= {
        k.lower(): v for k, v in HEADERS.items()
    }.items()


def test_a_hostile_name_is_text(server):
    _, page, _ = server.get("/")
    assert re.findall("<script[^>]*>", page) == ['<script src="page.js" defer>']
    assert "&lt;script&gt;alert(1)&lt;/<wbr>script&gt; &amp; " in page
    link = re.findall(r'href="(valve/press/%3Cscript[^"]*)"', page)
    assert len(link) == 1
    for room, ours in (("valve", 1), ("report", 1), ("cycles", 1)):
        status, own, _ = server.get("/" + link[0].replace("valve", room, 1))
        assert status == 200
        assert len(re.findall("<script", own)) == ours
        assert "<script>alert" not in own


def test_cycles_without_samples_show_no_key_of_curves_and_what_is_not_known_as_such(server):
    status, page, _ = server.get("/cycles/press/worn")
    assert status == 200
    assert "No samples:" in page
    assert 'class="legend"' not in page
    assert "<td></td>" not in page


def test_a_valve_leads_to_its_page_and_to_the_one_that_report_writes(server):
    status, page, _ = server.get("/valve/press/worn")
    assert status == 200
    assert "<b>out of specification</b>" in page
    assert "overhaul it, now" in page.lower()
    wait_for(lambda: 'class="trend"' in server.get("/valve/press/worn")[1])
    assert re.findall(r'href="([^"]*)">Report', page) == ["../../report/press/worn"]
    status, report, _ = server.get("/report/press/worn")
    assert status == 200
    assert "NE 107: out of specification" in report
    assert "K_in" in report


def test_what_a_page_shows_already_is_not_sent_again(server):
    for path in ("/", "/valve/press/new"):
        wait_for(lambda: "being drawn" not in server.get(path)[1])  # noqa: B023
        (mark,) = re.findall(r'data-mark="(\w+)"', server.get(path)[1])
        assert server.get(path, headers={"X-Valve-Twin-Mark": mark})[:2] == (204, "")
        assert server.get(path, headers={"X-Valve-Twin-Mark": "00000000"})[0] == 200


def test_json_says_what_fleet_says(server, path, capsys):
    _, text, _ = server.get("/api/valves")
    assert main(["fleet", "--url", f"sqlite:///{path}", "--json"]) == 0
    theirs = {x["valve"]: x for x in map(json.loads, capsys.readouterr().out.splitlines())}
    ours = json.loads(text)
    assert ours["failure"] == ""
    for row in ours["valves"]:
        other = theirs[row["valve"]]
        assert row["verdict"].replace(" ", "_").upper() == other["verdict"]
        for name in ("ne107", "failure_mode", "action", "drift", "way", "cycle", "parameter"):
            assert row[name] == other[name], name
    told = [p for row in ours["valves"] for p in row["parameters"]]
    when = {"beyond its threshold", "so many cycles left"}
    assert {p["outlook"] in when for p in told} == {True, False}
    for parameter in told:  # no number stands where no forecast is told
        assert (parameter["remaining"] is not None) == (parameter["outlook"] in when)
    status, one, _ = server.get("/api/valves/press/worn")
    assert (status, json.loads(one)["valve"]) == (200, "/press/worn")


def test_prometheus_reads_every_valve(server):
    from prometheus_client.parser import text_string_to_metric_families

    status, text, headers = server.get("/metrics")
    assert status == 200
    assert headers["content-type"].startswith("text/plain; version=0.0.4")
    samples = [s for f in text_string_to_metric_families(text) for s in f.samples]
    states = {
        s.labels["valve"]: s.labels["state"]
        for s in samples
        if s.name == "valve_twin_ne107" and s.value == 1.0
    }
    assert states["/press/worn"] == "out of specification"
    assert states["/press/new"] == "good"
    assert HOSTILE in states
    (drift,) = (
        s.value
        for s in samples
        if s.name == "valve_twin_drift_percent" and s.labels["valve"] == "/press/worn"
    )
    assert -30.0 < drift < -20.0
    document = (Path(__file__).parents[2] / "docs" / "browser.md").read_text(encoding="utf-8")
    assert {s.name for s in samples} <= set(re.findall(r"valve_twin_\w+", document))


def test_a_page_says_what_it_does_not_judge(tmp_path):
    path, rng = tmp_path / "history.sqlite", np.random.default_rng(7)
    with History(path) as history:
        for cycle in range(1, 31):
            gains = {name: 0.01 * (1.0 + 0.004 * rng.normal()) for name in ("K_in", "K_out")}
            leak = {"leak": 1e-3 * (1.0 + 0.4 * rng.normal())}
            history.store("/press", record(cycle), (estimate(cycle, gains | leak),))
    server = Server(path)
    try:
        for address in ("/", "/valve/press"):
            english, german = (server.get(f"{address}?lang={x}")[1] for x in ("en", "de"))
            assert 'not judged: <span translate="no">leak</span>' in english, address
            assert 'nicht beurteilt: <span translate="no">leak</span>' in german, address
        assert server.end() == 0
    finally:
        server.kill()


def test_the_linter_of_prometheus_finds_nothing(server):
    program = shutil.which("promtool")
    if program is None:
        pytest.skip("promtool is not on this machine: sudo apt install prometheus")
    text = server.get("/metrics")[1]
    found = subprocess.run(
        [program, "check", "metrics"], input=text, capture_output=True, text=True, check=False
    )
    assert (found.returncode, found.stdout + found.stderr) == (0, "")


def test_prometheus_answers_every_query_of_the_dashboard(server, tmp_path):
    """The program itself scrapes the server, as the page of docs sets it up."""
    program = shutil.which("prometheus")
    if program is None:
        pytest.skip("prometheus is not on this machine: sudo apt install prometheus")
    port = free_port()
    target = server.address.removeprefix("http://")
    job = {"job_name": "valves", "static_configs": [{"targets": [target]}]}
    config = {"global": {"scrape_interval": "1s"}, "scrape_configs": [job]}
    (tmp_path / "prometheus.yml").write_text(json.dumps(config), encoding="utf-8")
    board = json.loads(
        (Path(__file__).parents[2] / "layouts" / "grafana.json").read_text(encoding="utf-8")
    )
    queries = [
        target["expr"].replace("$valve", ".*").replace("$parameter", ".*")
        for panel in board["panels"]
        for target in panel["targets"]
    ]
    files = [f"--config.file={tmp_path / 'prometheus.yml'}", f"--storage.tsdb.path={tmp_path}/db"]
    with subprocess.Popen(
        [program, *files, f"--web.listen-address=127.0.0.1:{port}"], stderr=subprocess.PIPE
    ) as process:
        assert process.stderr is not None
        reader = threading.Thread(target=process.stderr.read, daemon=True)
        reader.start()
        try:

            def answer(query: str) -> list[object]:
                asked = urllib.parse.urlencode({"query": query})
                url = f"http://127.0.0.1:{port}/api/v1/query?{asked}"
                try:
                    with urllib.request.urlopen(url, timeout=30) as given:
                        return list(json.loads(given.read())["data"]["result"])
                except urllib.error.HTTPError:
                    raise  # no query that it knows
                except urllib.error.URLError:
                    return []  # not yet listening

            wait_for(lambda: answer("valve_twin_history_up"))
            unanswered = [query for query in queries if not answer(query)]
        finally:
            process.kill()
            reader.join(30)
    assert len(queries) > 10
    assert unanswered == []


def test_the_dashboard_asks_for_series_and_labels_that_there_are(server):
    from prometheus_client.parser import text_string_to_metric_families

    path = Path(__file__).parents[2] / "layouts" / "grafana.json"
    board = json.loads(path.read_text(encoding="utf-8"))
    labels: dict[str, set[str]] = {}
    for family in text_string_to_metric_families(server.get("/metrics")[1]):
        for sample in family.samples:
            labels.setdefault(sample.name, set()).update(sample.labels)
    asked = [target for panel in board["panels"] for target in panel["targets"]]
    assert len(asked) > 10
    for target in asked:
        (name,) = re.findall(r"valve_twin_\w+", target["expr"])
        used = re.findall(r"(\w+)=~", target["expr"])
        used += re.findall(r"{{(\w+)}}", target["legendFormat"])
        assert set(used) <= labels[name], target
    queries = [v["query"]["query"] for v in board["templating"]["list"] if v["type"] == "query"]
    for name, label in (re.findall(r"label_values\((\w+), (\w+)\)", q)[0] for q in queries):
        assert label in labels[name]


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_nothing_is_taken(server, method):
    assert server.get("/", method)[0] == 405
    assert server.get("/api/valves", method)[0] == 405


@pytest.mark.parametrize(
    "path_", ["/valve/none", "/api/valves/none", "/x", "/valve/..%2f..%2fetc"]
)
def test_what_is_not_there_is_said(server, path_):
    status, text, _ = server.get(path_)
    assert status == 404
    assert "Traceback" not in text


def test_a_new_cycle_shows_and_a_history_that_is_gone_is_told(tmp_path):
    path = tmp_path / "history.sqlite"
    store(path, "/v", range(1, 21), 0.0)
    server = Server(path)
    try:

        def cycle() -> int:
            return int(json.loads(server.get("/api/valves")[1])["valves"][0]["cycle"])

        assert cycle() == 20
        store(path, "/v", range(21, 22), 0.0)
        wait_for(lambda: cycle() == 21)
        assert server.get("/health")[:2] == (200, "ok")
        with sqlite3.connect(path) as raw:
            raw.execute("ALTER TABLE cycle RENAME TO gone")
        wait_for(lambda: server.get("/health")[0] == 503)
        _, page, _ = server.get("/")
        assert "<b>Stale.</b> The history cannot be read now; what is shown is" in page
        assert "valve_twin_history_up 0.0" in server.get("/metrics")[1]
        with sqlite3.connect(path) as raw:
            raw.execute("ALTER TABLE gone RENAME TO cycle")
        wait_for(lambda: server.get("/health")[0] == 200)
    finally:
        assert server.end() == 0


def wait_for(condition, most_s: float = 60.0) -> None:
    end = time.monotonic() + most_s
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.2)  # the server reads the history every two seconds


def test_wrong_arguments_get_one_line(tmp_path, capsys, server, path):
    assert main(["serve", "--url", f"sqlite:///{tmp_path}/none.sqlite"]) == 1
    assert "there is no such file" in capsys.readouterr().err
    assert main(["serve", "--url", f"sqlite:///{path}", "--port", "70000"]) == 2
    assert "port 70000 is not in 0 .. 65535" in capsys.readouterr().err
    taken = server.address.rsplit(":", 1)[1]
    assert main(["serve", "--url", f"sqlite:///{path}", "--port", taken]) == 1
    said = capsys.readouterr().err
    assert f"cannot listen at 127.0.0.1:{taken}" in said
    assert said.count("\n") == 1


SLOW = """
import sys, time
from pathlib import Path
from valve_twin.cli import main
from valve_twin.gateway import plant

def slow(*given, does=plant.describe_valve):
    while not Path(sys.argv[1]).exists():
        time.sleep(0.05)
    return does(*given)

plant.describe_valve, plant.LATE_S = slow, 0.2
sys.exit(main(["serve", "--port", "0", *sys.argv[2:]]))
"""


def test_a_first_reading_that_takes_long_is_served_while_it_goes_on(tmp_path):
    """The first start on a busy machine, which compiles kernels, ended with 'does not answer'."""
    path, go_on = tmp_path / "history.sqlite", tmp_path / "go_on"
    store(path, "/slow", range(1, 4), 0.0)
    server = Server(path, program=("-c", SLOW, str(go_on)))
    try:
        assert f"{path}: valves still to be assessed at http" in server.begun
        assert "/slow" in server.get("/")[1]
        go_on.touch()
        end = time.monotonic() + 60.0
        while not json.loads(server.get("/api/valves")[1])["whole"]:
            assert time.monotonic() < end
            time.sleep(0.1)  # polls
    finally:
        assert server.end() == 0


def test_a_damaged_name_spoils_no_other_valve(tmp_path):
    path = tmp_path / "history.sqlite"
    store(path, "/sound", range(1, 21), 0.0)
    store(path, "/other", range(1, 3), 0.0)
    with sqlite3.connect(path) as raw:
        raw.execute("UPDATE valve SET name = CAST(x'2ff0ff' AS TEXT) WHERE name = '/other'")
    server = Server(path)
    try:
        status, text, _ = server.get("/api/valves")
        rows = {row["valve"]: row for row in json.loads(text)["valves"]}
        assert (status, set(rows)) == (200, {"/sound", "/name_damaged_2"})
        assert rows["/sound"]["verdict"] != ""
        assert rows["/name_damaged_2"]["evidence"].startswith("its name is damaged")
        for page in ("/", "/metrics", "/health"):
            assert server.get(page)[0] == 200
        assert server.get("/valve/sound")[0] == 200
    finally:
        assert server.end() == 0
