# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The page names sudden faults, or says that there is none."""

import math
from dataclasses import replace

import pytest

from test.core.diagnosis.test_detection import healthy, medium, search, with_fault
from test.report.example import report_data
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.operation.counters import Counters
from valve_twin.core.operation.events import Event
from valve_twin.core.operation.step_metrics import METRICS, Metric, StepMetrics
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.report.faults import faults_section
from valve_twin.report.page import render_report


@pytest.fixture(scope="module")
def told():
    table = MODEL.signatures()
    leak = next(s for s in medium(table) if s.fault == "leak")
    quiet = healthy(table, 68, 4)
    return {"none": search(table, quiet), "leak": search(table, with_fault(table, quiet, leak))}


def page(diagnosis):
    data = report_data()
    assert data.assessment is not None
    return replace(data, assessment=replace(data.assessment, diagnosis=diagnosis))


def test_a_fault_stands_with_part_size_and_onset(told):
    html = render_report(page(told["leak"]))
    section = html.split("<h2>Sudden faults</h2>")[1].split("</section>")[0]
    assert "leak of the chamber" in section
    assert "<td>valve</td>" in section
    assert "1/s</td><td>61</td>" in section
    assert "lasts" in section


@pytest.mark.parametrize(("language", "word"), [("en", "unknown"), ("de", "unbekannt")])
def test_a_size_that_no_signature_tells_is_said_to_be_unknown(told, language, word):
    (leak,) = told["leak"].findings
    unknown = replace(told["leak"], findings=(replace(leak, severity=math.nan),))
    assert f"<td>{word}</td>" in render_report(replace(page(unknown), language=language))


def test_an_end_that_nothing_tells_is_not_dated(told):
    (leak,) = told["leak"].findings
    unseen = replace(told["leak"], findings=(replace(leak, end=66, end_seen=False),))
    section = render_report(page(unseen)).split("<h2>Sudden faults</h2>")[1].split("</section>")[0]
    assert "<td>not known</td>" in section
    assert "<td>66</td>" not in section


def test_the_table_says_no_more_than_the_verdict(told):
    """Clocks are no part of a valve; whether a fault lasts that the verdict leaves open is too."""
    (leak,) = told["leak"].findings
    clock = replace(leak, fault="clock", part="sensor")
    data = page(replace(told["leak"], findings=(leak, clock)))
    html = render_report(data)
    assert "<td>sensor</td>" not in html
    assert html.count("<td>lasts</td>") == 2
    unusable = replace(data.assessment.verdict, kind=VerdictKind.RECORDING_UNUSABLE, fault="")
    left_open = replace(data, assessment=replace(data.assessment, verdict=unusable))
    html = render_report(left_open)
    assert "<td>lasts</td>" not in html
    assert html.count("<td>not known</td>") == 2


def test_no_fault_is_said(told):
    assert "None in 68 cycles" in render_report(page(told["none"]))


def test_without_features_there_is_no_section():
    assert "Sudden faults" not in render_report(report_data())
    assert faults_section(None) == ""


def test_counters_and_the_event_log_stand_on_the_page_as_text():
    done = Counters(
        cycles=1205, reversals=4819, starts=2400, direction=1, done=2409.5, begin=0.0, level=1.0,
        stroke=1.0, spans=(0,) * 13 + (4819,), length_ns=3600 * 10**9, open_ns=1800 * 10**9,
    )  # fmt: skip
    seen = Event(1, 3, "fault.leak", "failure", "leak", 7, "/v", True, "J. Doe", "seal")
    events = (seen, *(replace(seen, id=k, acknowledged=False, text="<b>") for k in range(8, 70)))
    data = replace(report_data(), counters=done, events=events)
    html = render_report(data)
    section = html.split("<h2>Operation</h2>")[1].split("<h2>Estimates")[0]
    assert "4\u202f820" in section
    assert "2\u202f410.5" in section or "2410.5" in section
    assert "a stroke and more" in section
    assert "&lt;b&gt;" in section
    assert "<b>" not in section.split("<h2>Events</h2>")[1]
    assert section.count("fault.leak") == 62
    assert "1 older entries are in the history" in section
    assert "<h2>Operation</h2>" not in render_report(report_data())


def test_step_metrics_stand_on_the_page_with_intervals_and_reasons():
    known = {"t63": Metric("t63", 0.512, 0.503, 0.541)}
    found = [known.get(name, Metric(name, reason="the <b> is too coarse")) for name in METRICS]
    steps = tuple(StepMetrics(c, 1, 10**18, "command", 0.25, tuple(found)) for c in range(1, 71))
    html = render_report(replace(report_data(), steps=steps))
    section = html.split("<h2>Steps of the command</h2>")[1].split("<h2>")[0]
    assert "0.512<small>0.503 … 0.541</small>" in section
    assert section.count("0.512") == 60
    assert "10 older steps are not shown" in section
    assert "the &lt;b&gt; is too coarse" in section
    assert "<td>70</td>" in section
    assert "Steps of the command" not in render_report(report_data())
