# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Results as strict JSON under the names of the messages."""

from __future__ import annotations

import json
import math
import re

import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.operation.counters import Counters
from valve_twin.core.types import (
    Disagreement,
    Estimate,
    EstimateStatus,
    Guard,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.core.valves.registry import get_model
from valve_twin.io.tables.json_lines import estimate_fields, json_lines

LEFT_OUT = {"header", "start", "end", "stored", "wall_time"}
"""Fields of the message that a line gives as nanoseconds or leaves out."""

MORE = {"kind", "missed_cycles"}
"""What a line says beyond the message: missed cycles are those of CycleSummary."""


def fields_of(root, name):
    """Return the field names and the constants of a message in their order."""
    text = (root / "msg_defs" / "msg" / f"{name}.msg").read_text(encoding="utf-8")
    fields = re.findall(r"^[\w/]+(?:\[\])? +(\w+)(?: |$)", text, re.MULTILINE)
    constants = re.findall(r"^uint8 +(\w+)=(\d+)", text, re.MULTILINE)
    return fields, dict(constants)


def estimate(cycle: int, value: float = 0.01) -> Estimate:
    values = (
        ParameterValue("K_in", value),
        ParameterValue("leak", math.nan, ParameterStatus.NOT_EXCITED, "never closed"),
    )
    return Estimate(
        model="press_cartridge",
        estimator="output_error",
        cycle=cycle,
        start_ns=10**18 + cycle * 10**10,
        end_ns=10**18 + cycle * 10**10 + 9 * 10**9,
        parameters=values,
        status=EstimateStatus.PARTIAL,
        reason="not excited: leak",
        condition_number=math.inf,
        lag=2,
        counts=MaskCounts(used=300, seat=5, stuck=4, stale=3),
        used_by_trend=True,
        trend_reason="output_error always feeds the trend",
        disagreements=(Disagreement("kalman", "K_in", -1e-5, math.nan),),
        guards=(Guard("condition number", False, math.inf, 1e6, "not finite"),),
    )


@pytest.fixture
def lines():
    """Return the lines of 20 cycles of a valve that does not age."""
    found = [estimate(n, 0.01 + 1e-5 * (n * 7 % 5)) for n in range(1, 21)]
    parameters = get_model("press_cartridge").parameters
    assessment = assess(found, (), AgingConfig(), parameters=parameters, valve="/v")
    done = Counters(
        cycles=3, reversals=4, direction=1, done=4.5, begin=0.25, level=0.5, stroke=2.0,
        length_ns=1800 * 10**9,
    )  # fmt: skip
    return list(json_lines(found, assessment, "/v", done))


def strict(line: str):
    def refuse(constant: str) -> None:
        pytest.fail(f"{constant} is no JSON")

    return json.loads(line, parse_constant=refuse)


def test_an_estimate_has_the_fields_of_its_message_in_their_order(root):
    expected = [f for f in fields_of(root, "Estimate")[0] if f not in LEFT_OUT]
    found = [k for k in estimate_fields(estimate(1), "/v") if not k.endswith("_ns")]
    assert [k for k in found if k not in MORE] == expected


@pytest.mark.parametrize(("name", "kind"), [("Trend", "trend"), ("Verdict", "verdict")])
def test_trend_and_verdict_have_the_fields_of_their_messages(root, lines, name, kind):
    message = {f for f in fields_of(root, name)[0] if f != "header"}
    found = next(x for x in map(strict, lines) if x["kind"] == kind)
    plain = {k.removesuffix("_ns") for k in found} - {"kind", "stamp"}
    assert plain == message


def test_words_of_status_are_the_constants_of_the_message(root):
    constants = fields_of(root, "Estimate")[1]
    found = estimate_fields(estimate(1), "/v")
    assert found["status"] in constants
    assert all(f"PARAMETER_{s}" in constants for s in found["parameter_status"])


def test_what_is_not_known_is_null_and_what_is_unbounded_is_a_word(lines):
    first = strict(lines[0])
    assert first["values"] == [0.01 + 1e-5 * 2, None]
    assert first["condition_number"] == "Infinity"
    assert first["mse_test"] is None
    assert (first["disagreement"], first["disagreement_errors"]) == ([-1e-5], [None])
    assert (first["guard_passed"], first["guard_values"]) == ([False], ["Infinity"])
    assert (first["names"], first["units"]) == (["K_in", "leak"], ["1", "1/s"])
    masked = [first[f"samples_{k}"] for k in ("used", "masked_seat", "masked_stuck")]
    assert masked == [300, 5, 4]
    trend = next(x for x in map(strict, lines) if x["kind"] == "trend")
    assert trend["unbounded"] is True
    assert float(trend["remaining_high"]) == math.inf


def test_estimates_come_first_then_trends_then_one_verdict_with_its_advice(lines):
    kinds = [strict(line)["kind"] for line in lines]
    trends = len(kinds) - 23
    assert trends >= 1
    assert kinds == ["estimate"] * 20 + ["trend"] * trends + ["verdict", "advice", "counters"]
    advice = strict(lines[-2])
    assert advice["ne107"] in {state.value for state in Ne107}
    assert {"part", "cause", "action", "urgency", "failure_mode"} < set(advice)
    told = strict(lines[-1])
    assert (told["cycles"], told["movements"], told["reversals"], told["hours"]) == (3, 5, 4, 0.5)
    assert (told["travel"], told["strokes"]) == (4.75, 4.75 / 2)
    assert told["span_edges"][0] == 0.0
    assert told["span_edges"][-1] == "Infinity"
    assert len(told["span_counts"]) == len(told["span_edges"]) - 1


def test_every_value_survives_to_the_last_bit():
    value = 0.1 + 1e-17 + 2**-40
    (line,) = json_lines([estimate(1, value)], None, "/v")
    assert strict(line)["values"][0] == value
