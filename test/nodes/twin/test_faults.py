# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a twin files against itself is told in German on the German pages."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from valve_twin.core.alignment import SignalCounts
from valve_twin.core.signal_clocks import ClockOffset
from valve_twin.nodes.twin.faults import TwinFaults
from valve_twin.nodes.twin.inputs import DEAF_BEHIND, DEAF_FROM_START, TopicInput
from valve_twin.report.language.words import sentence, words

SPOOL, TYPE = "/press/v1/spool_position", "valve_twin_msgs/msg/Float64Stamped"


def topic(why: str = DEAF_BEHIND, **given):
    """Return an input of a twin at which everything went wrong."""
    counts = {"lost": 9, "overrun": 2, "broken": 3, "deaf": 4, "deadlines_missed": 5}
    made = SimpleNamespace(topic=SPOOL, type=TYPE, deaf_why=why, **counts)
    made.problem = lambda: given.pop("problem", ("", ""))
    return made


def valve(topics, **changed):
    """Return a valve of which every counter counts."""
    twin = SimpleNamespace(pending_jobs=5, counts=lambda: {"v_in": SignalCounts(9, 1, 2, 3)})
    given = {
        "name": "/press/v1",
        "twin": twin,
        "model": SimpleNamespace(output="spool_position"),
        "config": SimpleNamespace(signals={"v_in": SimpleNamespace(topic="/press/v1/v_in")}),
        "inputs": SimpleNamespace(
            topics=topics, look_at_clocks=lambda: [ClockOffset("v_in", "spool_position", 2.0)]
        ),
        "publishers": SimpleNamespace(gaps=SimpleNamespace(missing=7, longest_s=0.5)),
        "jumps": 2,
        "jobs": SimpleNamespace(
            wall_s=2.5,
            failed=3,
            failure="cycle 8 is not estimated: database is locked",
            wait=SimpleNamespace(limit_s=0.5, cut=4),
        ),
        "spool": SimpleNamespace(dropped=6, trouble="/state/v-cycles: 12 MB are free"),
        "cycle_queue": SimpleNamespace(
            flushed=2, waiting=3, dropped=1, refused=1,
            writer=SimpleNamespace(error="database is locked", unsaved=1),
        ),
    }  # fmt: skip
    return SimpleNamespace(**given | changed)


def filed(made: Any) -> list[str]:
    """Return the evidence of all that is filed of a valve."""
    found: list[str] = []
    reporter: Any = SimpleNamespace(
        look=lambda _code, evidence, **_: found.append(evidence),
        report=lambda _code, evidence, **_: found.append(evidence),
    )
    TwinFaults(reporter, made).look()
    return [text for text in found if text]


def problems() -> list[str]:
    """Return why a topic gives nothing, in each way."""
    publisher = SimpleNamespace(
        topic_type="std_msgs/msg/Bool", node_name="plc", node_namespace="/"
    )
    graph = SimpleNamespace(suggestion=lambda _: "did you mean '/press/v2/spool_position'?")
    given = {
        "topic": SPOOL, "type": TYPE, "signals": ("spool_position",), "age_s": 7.2, "_matched": 0,
        "_heard": None, "_since": 0.0, "refused_policy": "", "_graph": graph,
        "_config": SimpleNamespace(silence_s=5.0), "_remedy": lambda: "deadline_s here",
    }  # fmt: skip
    found = []
    for published, changed in (
        ([publisher], {}),
        ([], {}),
        (
            [SimpleNamespace(**vars(publisher) | {"topic_type": TYPE})],
            {"refused_policy": "DEADLINE"},
        ),
        ([SimpleNamespace(**vars(publisher) | {"topic_type": TYPE})], {}),
        ([], {"_heard": 1.0}),
    ):
        graph.publishers = lambda _, there=published: there
        of: Any = SimpleNamespace(**given | changed)
        _, text = TopicInput.problem(of)
        found.append(text)
    return found


def test_what_is_filed_of_a_valve_is_told_in_german():
    told = filed(valve([topic(), topic(DEAF_FROM_START)])) + problems()
    told += [
        str(ClockOffset("v_in", "x", s, who)) for s in (-3.0, 80.0, -80.0) for who in ("", "x")
    ]
    assert len(told) > 28
    german = words("de")
    english = [t for t in told if sentence(t, german) == t or "lang=" in sentence(t, german)]
    assert english == []
    assert sentence(problems()[-1], german) == (
        f"Topic &#39;{SPOOL}&#39; (Signal spool_position) schweigt seit 7 s: "
        "es hat keinen Sender mehr: ihn starten"
    )
