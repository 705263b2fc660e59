# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Every face says the same of a named fault: state, failure mode, severity, cause and remedy."""

from __future__ import annotations

import json
import random
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from valve_twin_msgs import msg

from test.nodes.aging.test_monitor_faults import Book, look_at
from test.report.example import report_data
from valve_twin.core.aging.assess import Assessment
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.verdict import LimitState, TrendStatus, decide
from valve_twin.core.diagnosis.changes.finding import CLOCK, UNKNOWN, Diagnosis, Finding
from valve_twin.core.diagnosis.generic.faults import FAULTS
from valve_twin.core.diagnosis.table import FAULT_TYPES, PAIRS
from valve_twin.core.faults.advice import FAULT_ADVICE, advise
from valve_twin.core.operation.events import verdict_events
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.gateway.foxglove.face import _conditions
from valve_twin.gateway.live.told import Told
from valve_twin.gateway.metrics import exposition
from valve_twin.gateway.mqtt.plain import JsonSpeaker
from valve_twin.gateway.page.lines import fault_lines
from valve_twin.gateway.plain import plain_valve, plain_words
from valve_twin.gateway.view import View
from valve_twin.io.tables.json_lines import json_lines
from valve_twin.nodes.gateway.state_feed import StateFeed
from valve_twin.nodes.runtime.diagnostics import ERROR, Report
from valve_twin.nodes.runtime.fault_reporter import _message
from valve_twin.report.page import _light

VALVE = "/press/valve_1"
_KINDS = [(UNKNOWN, "valve"), *((f.name, f.part) for f in FAULT_TYPES)]


@pytest.fixture(scope="module")
def page():
    return report_data()


def assessed(name: str, part: str, trends: tuple[Any, ...], size: float) -> Assessment:
    rivals = tuple(n for pair in PAIRS if name in pair for n in pair if n != name)
    found = Finding(name, rivals, part, size, 20.0, 33, 36)
    verdict = decide(trends, AgingConfig(), valve=VALVE, stamp_ns=1, cycle=40, fault=found)
    return Assessment(trends, verdict, (), Diagnosis((found,), 40, ready=True))


def shown(found: Assessment) -> tuple[View, Book]:
    """Return what the gateway shows once the nodes have told it, and the node's faults."""
    told, book = Told({VALVE: "press_cartridge"}), Book()
    told.judge(VALVE, found.verdict, found.trends)
    look_at(book, found)
    faults = msg.Faults(node=f"{VALVE}/aging_monitor", faults=[_message(f) for f in book.faults()])
    feed: Any = SimpleNamespace(_told=told)
    StateFeed._on_faults(feed, "faults", faults)
    return told.over(View(), lambda _: AgingConfig()), book


def states(found: Assessment, page: Any) -> dict[str, str]:
    """Return the state of NE 107 that each face shows, by face."""
    view, book = shown(found)
    row = view.row(VALVE)
    assert row is not None
    said = {"fleet, OPC UA": row.ne107, "JSON": str(plain_valve(view, row)["ne107"])}
    *_, line = json_lines([], found, VALVE)
    said["JSON lines"] = json.loads(line)["ne107"]
    told = re.search(
        r'valve_twin_ne107\{state="([^"]+)",valve="[^"]+"\} 1\.0|'
        r'valve_twin_ne107\{valve="[^"]+",state="([^"]+)"\} 1\.0',
        exposition(view).decode(),
    )
    assert told is not None
    said["Prometheus"] = told[1] or told[2]
    *_, condition = _conditions(view)
    said["Foxglove"] = str(condition.values["NE 107"])
    why = _light(replace(page, assessment=found)).state
    said["report"] = why.split("; ")[0].removeprefix("NE 107: ")
    if found.verdict.fault == CLOCK:
        assert not view.faults  # no part of the valve has it
        return said
    (fault,) = view.faults
    (active,) = (f for f in book.faults(VALVE) if f.is_active)
    report = Report("aging", VALVE)
    report.add_faults([active])
    values = {key.rpartition(".")[2]: value for key, value in report.values.items()}
    said["/diagnostics"] = str(values["NE 107"])
    said["fault of the node"] = fault.ne107.value
    said["page"] = str(fault_lines([fault]).shown[0]["state"])
    faults: Any = plain_words(view, row)["faults"]
    (plain,) = faults
    said["faults by MQTT"] = plain["ne107"]
    by_topic = {m.topic: m for m in JsonSpeaker("valve_twin").born(view)}
    (filed,) = json.loads(by_topic["valve_twin/faults"].payload)
    said["faults of all by MQTT"] = filed["ne107"]
    advice = advise(found.verdict, found.trends)
    assert fault.remedy == values["remedy"] == row.action == advice.sentence
    assert values["failure mode (ISO 14224)"] == row.failure_mode == advice.failure_mode
    assert values["cause"] == json.loads(line)["cause"] == advice.cause
    assert (report.level == ERROR) == (condition.level == 2) or found.trends
    assert (report.level == ERROR) == (said["page"] == "failure")
    return said


@pytest.mark.parametrize(("name", "part"), _KINDS)
@pytest.mark.parametrize("limit", [LimitState.NONE, LimitState.WARNING, LimitState.ALARM])
def test_no_two_faces_exclude_each_other(name, part, limit, page):
    trends: tuple[Any, ...] = ()
    if limit is not LimitState.NONE:
        beyond = limit is LimitState.ALARM
        status = TrendStatus.BEYOND_THRESHOLD if beyond else TrendStatus.DRIFTING
        one = page.assessment.trends[0]
        trends = (replace(one, parameter=name, status=status, limit_state=limit),)
    size = random.Random(f"{name} {limit}").choice([0.01, 0.3, float("nan")])
    found = assessed(name, part, trends, size)
    said = states(found, page)
    assert len(set(said.values())) == 1, said
    *_, event = verdict_events(found.verdict, "")
    if limit is not LimitState.ALARM:  # a limit has an entry of its own
        assert event.status == said["JSON"]


def test_every_fault_that_any_model_names_has_one_row():
    tables = (get_model(name).signatures() for name in model_names())
    named = {fault for table in tables if table is not None for fault in table.faults}
    assert named <= set(FAULT_ADVICE)
    assert {*FAULTS} <= set(FAULT_ADVICE)
    assert {f.name for f in FAULT_TYPES} | {UNKNOWN} == set(FAULT_ADVICE)


def test_what_no_data_tell_apart_has_one_state_and_one_failure_mode_or_says_which_part():
    for pair in PAIRS:
        one, other = (FAULT_ADVICE[name] for name in sorted(pair))
        assert one.ne107 is other.ne107, pair
        same_part = one.part == other.part or one.failure_mode == other.failure_mode
        assert same_part or {one.failure_mode, other.failure_mode} == {"AIR", "LOO"}, pair


def test_a_jam_fails_to_regulate_as_it_may_stand_open_as_well_as_closed():
    assert FAULT_ADVICE["no_motion"].failure_mode == "FTR"
    named = {name: a.failure_mode for name, a in FAULT_ADVICE.items()}
    ends = {name: mode for name, mode in named.items() if mode in {"FTO", "FTC"}}
    assert ends == {"no_opening": "FTO", "no_closing": "FTC"}  # switches tell which end it lacks
