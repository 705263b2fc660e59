# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is shown is what the topics say, at once; where nobody speaks it is the history."""

from __future__ import annotations

import json
import re
import urllib.request
from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("starlette", reason="needs the extra gateway")

from valve_twin_msgs import msg

from test.gateway.chromium import Browser
from test.gateway.test_browser import CONTRASTS, EVIL, WIDTHS
from test.gateway.test_web import store
from test.nodes.conftest import NS
from valve_twin.core.aging.verdict import LimitState, Trend, TrendStatus, Verdict, VerdictKind
from valve_twin.core.faults.advice import advise
from valve_twin.core.faults.ne107 import NODE_FAULTS
from valve_twin.gateway.plant import Plant
from valve_twin.nodes.aging.node import AgingMonitorNode
from valve_twin.nodes.gateway.node import GatewayNode
from valve_twin.nodes.gateway.state_feed import LATCHED
from valve_twin.nodes.runtime.messages import to_message, to_value

END_NS = 1_700_000_500 * 10**9
WORD = Verdict(
    END_NS, NS, VerdictKind.VALVE, "valve", "leak has grown by 40 %", cycle=31, fault="leak"
)
TREND = Trend(
    END_NS, NS, "leak", "1/s", "cycles", TrendStatus.BEYOND_THRESHOLD, "beyond its threshold",
    samples=30, segments=1, segment_start=1.0, axis_value=31.0, level=1.4e-3, reference=1e-3,
    drift_reference=40.0, drift_reference_lower_95=35.0, drift_reference_upper_95=45.0,
    threshold=1.2e-3, limit_state=LimitState.ALARM,
)  # fmt: skip


@pytest.fixture
def history(tmp_path):
    path = tmp_path / "history.sqlite"
    store(path, NS, range(1, 21), 0.0)
    return path


def ask(node: GatewayNode, path: str = "/api/valves") -> str:
    with urllib.request.urlopen(node.address.rstrip("/") + path, timeout=60) as answer:
        return str(answer.read().decode())


def row_of(node: GatewayNode, valve: str = NS) -> dict[str, Any]:
    rows = json.loads(ask(node))["valves"]
    return next((row for row in rows if row["valve"] == valve), {})


def faults_message(node: str, *codes: str, valve: str = NS, status: int = 1) -> msg.Faults:
    return msg.Faults(
        node=node,
        faults=[
            msg.Fault(
                valve=valve,
                code=code,
                severity=msg.Fault.ERROR,
                status=status,
                evidence=f"what {code} shows",
                remedy=f"mend {code}",
            )
            for code in codes
        ],
    )


class Speaker:
    """Speaks on the state topics as twin and aging monitor of a valve do."""

    def __init__(self, graph, valve: str = NS) -> None:
        self._node = graph.stranger("speaker")
        self._topics = {
            kind: self._node.create_publisher(kind, f"{valve}/{name}", LATCHED)
            for kind, name in (
                (msg.Verdict, "aging_monitor/verdict"),
                (msg.Trend, "aging_monitor/trend/leak"),
                (msg.CycleSummary, "twin/cycle"),
                (msg.Faults, "twin/faults"),
            )
        }

    def say(self, message) -> None:
        self._topics[type(message)].publish(message)

    def go(self) -> None:
        for publisher in self._topics.values():
            self._node.destroy_publisher(publisher)


def summary(cycle: int, end_ns: int, *, accepted: bool, reason: str = "") -> msg.CycleSummary:
    made = msg.CycleSummary(valve=NS, cycle=cycle, accepted=accepted, reason=reason)
    made.end.sec, made.end.nanosec = divmod(end_ns, 10**9)
    return made


def test_verdict_state_and_last_cycle_shown_are_those_of_the_topics(graph, history):
    node = graph.host(GatewayNode, port=0, history_url=f"sqlite:///{history}")
    graph.spin_until(lambda: row_of(node).get("verdict") == "ok", what="the history")
    stored = row_of(node)
    speaker = Speaker(graph)
    speaker.say(summary(31, END_NS, accepted=False, reason="too short"))
    speaker.say(to_message(TREND))
    speaker.say(to_message(WORD))
    graph.spin_until(lambda: row_of(node)["last"] is not None, what="the cycle")
    graph.spin_until(lambda: row_of(node)["evidence"] == WORD.evidence, what="the verdict")
    graph.spin_until(lambda: row_of(node)["drift"] == 40.0, what="the trend")
    told, wanted = row_of(node), advise(WORD, [TREND])
    assert told["verdict"] == "valve"
    assert told["ne107"] == wanted.ne107.value == "out of specification"
    assert told["action"] == wanted.sentence
    assert (told["parameter"], told["limit_state"]) == ("leak", "alarm")
    last = {"cycle": 31, "end_ns": END_NS, "accepted": False, "reason": "too short"}
    assert told["last"] == last
    assert told["cycle"] == 20  # what is stored
    assert {p["parameter"] for p in told["parameters"]} == {
        p["parameter"] for p in stored["parameters"]
    }
    page = ask(node, f"/valve{NS}?lang=en")
    assert "<b>out of specification</b>" in page
    assert WORD.evidence in page
    assert "<dd>31<small>refused</small></dd>" in page
    assert WORD.evidence in ask(node, "/?lang=en")
    again = replace(WORD, kind=VerdictKind.OK, text="ok", evidence="all is well", fault="")
    speaker.say(to_message(again))
    graph.spin_until(lambda: row_of(node)["evidence"] == "all is well", what="the next verdict")
    speaker.go()
    graph.spin_until(lambda: row_of(node)["last"] is None, what="the history again")
    graph.spin_until(
        lambda: {**row_of(node), "parameters": 0} == {**stored, "parameters": 0},
        what="all of the history again",
    )


def test_what_is_new_is_told_beside_the_moving_plot(graph, history):
    node = graph.host(GatewayNode, port=0, history_url=f"sqlite:///{history}")
    graph.spin_until(lambda: row_of(node).get("verdict") == "ok", what="the history")
    before = node._told.number(NS)
    speaker = Speaker(graph)
    speaker.say(to_message(WORD))
    graph.spin_until(lambda: node._told.number(NS) > before, what="news")
    live = node._channels._valves[NS]
    news = json.loads(live.whole(live.frame()).decode().removeprefix("data: "))["news"]
    assert news == node._told.number(NS)


def test_faults_of_nodes_are_shown_while_they_last(graph, history):
    node = graph.host(GatewayNode, port=0, history_url=f"sqlite:///{history}")
    speaker, recorder = Speaker(graph), graph.stranger("recorder")
    speaker.say(faults_message(f"{NS}/twin", "input.silent", "input.gaps"))
    loss = recorder.create_publisher(msg.Faults, "/bag_recorder/faults", LATCHED)
    loss.publish(faults_message("/bag_recorder", "recorder.disk", valve=""))

    def codes() -> list[str]:
        return [f["code"] for f in json.loads(ask(node))["faults"]]

    wanted = ["input.silent", "input.gaps", "recorder.disk"]  # worst first
    graph.spin_until(lambda: codes() == wanted, what="all faults")
    found = {f["code"]: f for f in json.loads(ask(node))["faults"]}
    assert [f["ne107"] for f in found.values()] == [NODE_FAULTS[code].value for code in wanted]
    assert [f["code"] for f in row_of(node)["faults"]] == wanted[:2]
    fleet, own = ask(node, "/?lang=en"), ask(node, f"/valve{NS}?lang=en")
    for code in wanted:
        assert f"what {code} shows" in fleet
    assert "its nodes: failure" in fleet
    assert "what input.silent shows" in own
    assert "mend input.gaps" in own
    assert "recorder.disk" not in own
    speaker.say(faults_message(f"{NS}/twin", "input.silent", status=msg.Fault.HEALED))
    graph.spin_until(lambda: codes() == ["recorder.disk"], what="the healed ones gone")
    recorder.destroy_publisher(loss)
    graph.spin_until(lambda: codes() == [], what="none of a node that is gone")


def test_a_monitor_without_its_twin_is_shown_before_anything_is_stored(graph, tmp_path):
    url = f"sqlite:///{tmp_path / 'none.sqlite'}"
    node = graph.host(GatewayNode, port=0, history_url=url)
    graph.host(AgingMonitorNode, history_url=url)
    graph.spin_until(lambda: row_of(node).get("faults"), what="twin.absent")
    row = row_of(node)
    (fault,) = row["faults"]
    assert (fault["code"], fault["ne107"]) == ("twin.absent", "failure")
    assert fault["node"] == f"{NS}/aging_monitor"
    assert row["evidence"] == "nothing of it is stored yet"
    assert fault["evidence"] in ask(node, f"/valve{NS}?lang=en")


def test_a_browser_shows_faults_on_every_screen_as_soon_as_they_are_said(graph, history, tmp_path):
    made = graph.start("gateway", port=0, history_url=f"sqlite:///{history}")
    address = graph.spin_until(
        lambda: re.search(r"http://127\.0\.0\.1:\d+", made.log), what="the gateway"
    ).group()
    speaker, browser = Speaker(graph), Browser(tmp_path / "profile")
    try:
        browser.open(f"{address}/valve{NS}?lang=en")
        browser.wait_for("document.querySelector('#live').dataset.state === 'stale'")
        assert browser.run("document.querySelectorAll('.faults li').length") == 0
        codes = "input.silent", "history.not_stored", "input.gaps", "parameter.refused"
        speaker.say(faults_message(f"{NS}/twin", *codes, EVIL))
        speaker.say(to_message(WORD))
        browser.wait_for("document.querySelectorAll('.faults li').length === 5")
        browser.wait_for("document.querySelector('.tile').innerText.includes('by 40 %')")
        for page in (f"/valve{NS}", "/"):
            browser.open(f"{address}{page}?lang=en")
            assert browser.run("document.querySelectorAll('.faults li').length") == 5
            assert f"what {EVIL} shows" in browser.text(".faults")
            signs = browser.run(
                "[...document.querySelectorAll('.faults .sign')].map((s) => s.innerText).join('')"
            )
            assert signs == "FSCCM"
            for width in WIDTHS:
                for dark in (False, True):
                    browser.resize(width, 800, dark=dark)
                    assert browser.run("document.documentElement.scrollWidth") <= width
                    faint = {k: v for k, v in browser.run(CONTRASTS).items() if v < 4.5}
                    assert not faint, (page, width, dark)
                    name = f"{'valve' if 'valve' in page else 'fleet'}_{width}_{dark}.png"
                    browser.shoot(tmp_path / name, whole=False)
        assert browser.complaints() == []
    finally:
        browser.close()


def test_real_nodes_are_shown_as_they_speak_and_as_stored_once_they_are_gone(graph, tmp_path):
    path = tmp_path / "history.sqlite"
    store(path, NS, range(1, 61), -0.0045)
    url = f"sqlite:///{path}"
    twin = graph.start("twin", history_url=url)
    words = graph.record(f"{NS}/aging_monitor/verdict", msg.Verdict, LATCHED)
    trends = graph.record(f"{NS}/aging_monitor/trend/K_in", msg.Trend, LATCHED)
    monitor = graph.start("aging_monitor", history_url=url)
    graph.spin_until(lambda: words and trends, what="the monitor")
    node = graph.host(GatewayNode, port=0, history_url=url)
    view = node._plant.glance

    def heard() -> bool:
        told = view().verdicts.get(NS)
        return told is not None and view().live and NS in node._told._said

    graph.spin_until(heard, what="the verdict")
    graph.spin_until(lambda: "K_in" in node._state._trends[NS], what="the trend")
    word, trend, row = words[-1], trends[-1], row_of(node)
    assert node._told._said[NS].verdict == to_value(Verdict, word)
    assert (row["verdict"], row["evidence"]) == (word.text, word.evidence)
    assert (row["parameter"], row["drift"]) == ("K_in", trend.drift_reference)
    stored = Plant(url).view().row(NS)
    assert stored is not None
    assert (row["ne107"], row["action"]) == (stored.ne107, stored.action)
    monitor.kill()
    twin.kill()
    graph.spin_until(lambda: node._told._said[NS].verdict is None, what="that they are gone")
    assert row_of(node)["evidence"] == stored.evidence
