# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How a stranger is scored, on answers that are made up."""

import dataclasses

import pytest

from valve_twin.core.aging.assess import Assessment
from valve_twin.core.aging.verdict import Trend, TrendStatus, Verdict, VerdictKind
from valve_twin.core.diagnosis.changes.finding import Diagnosis, Finding
from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue
from valve_twin.validation.strangers.draw import draw
from valve_twin.validation.strangers.record import aged, gain
from valve_twin.validation.strangers.score import score
from valve_twin.validation.strangers.troubles import Trouble
from valve_twin.validation.strangers.watch import Said

KINDS = dict(zip("novcspru", VerdictKind, strict=True))
HEALTHY = dataclasses.replace(
    draw(0), cycles=40, troubles=(), aging=dataclasses.replace(draw(0).aging, law="none")
)


def with_fault(name, part, onset, end=0, size="large"):
    return dataclasses.replace(HEALTHY, troubles=(Trouble(name, part, size, 1.0, onset, end),))


def said(words, stranger=HEALTHY, diagnosis=None, trends=(), estimates=()):
    """Return answers from one letter a cycle."""
    found = []
    for number, word in enumerate(words, 1):
        kind = KINDS[word]
        verdict = Verdict(0, "", kind, kind.text, "", number)
        assessment = Assessment(tuple(trends), verdict, (), diagnosis or Diagnosis((), 0, True))
        found.append(Said(number, aged(stranger, number), tuple(estimates), assessment))
    return found


def shares(words, stranger=HEALTHY, **more):
    return score(stranger, said(words, stranger, **more)).shares


def test_a_part_named_on_a_healthy_press_is_a_false_alarm():
    assert shares("n" * 10 + "o" * 29 + "v")["false alarm"] == [1, 40]


def test_ok_in_a_cycle_with_a_fault_is_silent_wrong_and_the_delay_counts():
    found = score(with_fault("leak", "valve", 21), said("n" * 10 + "o" * 13 + "v" * 17, HEALTHY))
    assert found.shares["silent wrong"] == [3, 20]
    assert found.shares["silent wrong from the third cycle"] == [1, 18]
    assert found.shares["right part"] == [17, 17]
    assert found.delays == [4]


def test_a_small_fault_may_be_overlooked_and_is_no_false_alarm():
    small = with_fault("leak", "valve", 21, size="small")
    found = shares("n" * 10 + "o" * 20 + "v" * 10, small)
    assert "silent wrong" not in found
    assert found["false alarm"] == [0, 20]


def test_another_part_is_wrong_unless_the_pair_is_published():
    supply = with_fault("supply_drop", "supply", 21)
    words = "n" * 10 + "o" * 10 + "s" * 20
    assert shares(words, supply)["right part"] == [0, 20]
    finding = Finding("sensor_gain", ("supply_drop",), "sensor", 0.1, 9.0, 21, 22)
    both = Diagnosis((finding,), 40, ready=True)
    assert shares(words, supply, diagnosis=both)["right part"] == [20, 20]
    three = dataclasses.replace(finding, rivals=("supply_drop", "leak"))
    assert shares(words, supply, diagnosis=Diagnosis((three,), 40, ready=True))["right part"] == [
        0,
        20,
    ]


def test_a_fault_of_the_first_cycles_is_counted_apart():
    found = shares("n" * 10 + "o" * 30, with_fault("leak", "valve", 3))
    assert found["early: silent wrong"] == [30, 30]
    assert "silent wrong" not in found
    assert "not enough data" not in found


def test_no_reference_is_right_of_a_fault_of_the_first_cycles_and_told_apart_from_few_data():
    found = shares("n" * 10 + "r" * 20 + "o" * 10, with_fault("leak", "valve", 3))
    assert found["early: no reference"] == [20, 30]
    assert found["early: silent wrong"] == [10, 30]
    healthy = shares("r" * 20 + "o" * 20)
    assert healthy["no reference in a healthy cycle"] == [10, 30]
    assert healthy["not enough data"] == [0, 30]
    assert healthy["false alarm"] == [0, 40]


@pytest.mark.parametrize(("bits", "apart", "alarms"), [(6, 0.0, 0), (12, 1e-4, 0), (12, 0.0, 20)])
def test_a_recording_is_unusable_only_where_bits_or_clocks_say_so(bits, apart, alarms):
    logger = dataclasses.replace(HEALTHY.logger, bits=bits, clocks_apart=apart)
    found = shares("r" * 20 + "u" * 20, dataclasses.replace(HEALTHY, logger=logger))
    assert found["false alarm"] == [alarms, 40]
    assert found["recording unusable"] == [20, 30]
    assert found["not enough data"] == [0, 30]


def test_a_verdict_that_comes_back_within_five_cycles_flickers():
    assert shares("n" * 10 + "o" * 10 + "v" + "o" * 19)["flicker"] == [1, 29]
    assert shares("n" * 10 + "o" * 10 + "v" * 20)["flicker"][0] == 0


@pytest.mark.parametrize(("low", "high", "held"), [(0.9, 1.1, 1), (1.02, 1.1, 0)])
def test_an_interval_of_a_cycle_is_held_against_the_press(low, high, held):
    true = gain(HEALTHY.press._replace(load=0.0), 0.5, HEALTHY.logger.period_s)
    estimate = Estimate(
        model="press_cartridge",
        estimator="output_error",
        cycle=1,
        start_ns=0,
        end_ns=1,
        parameters=(
            ParameterValue("K_in", true, lower_95=low * true, upper_95=high * true),
            ParameterValue("v_in_mean", 0.5),
        ),
        status=EstimateStatus.ACCEPTED,
        reason="",
        used_by_trend=True,
    )
    found = shares("n", estimates=[estimate])
    assert found["cycle interval: output_error K_in at 1e-3"] == [held, 1]


def test_drift_and_life_are_held_against_the_law_of_aging():
    linear = dataclasses.replace(
        HEALTHY,
        press=HEALTHY.press._replace(damping=0.0, coulomb=0.0, breakaway=0.0),
        aging=dataclasses.replace(HEALTHY.aging, law="linear", part="r_in", size=-0.15),
    )
    trend = Trend(
        stamp_ns=0,
        valve="",
        parameter="K_in",
        unit="1",
        axis="cycles",
        status=TrendStatus.DRIFTING,
        reason="",
        samples=40,
        segments=1,
        segment_start=0.0,
        axis_value=40.0,
        reference=1.0,
        threshold=0.85,
        drift_reference_lower_95=-6.5,
        drift_reference_upper_95=-2.5,
        unbounded=False,
        remaining_low=20.0,
        remaining_median=24.0,
        remaining_high=46.0,
    )
    found = shares("n" * 10 + "o" * 30, linear, trends=[trend])
    # 0.25 % a cycle: in cycle 15-30 the drift is -2.5 .. -6.5 %; the limit is passed at cycle 66
    held, cases = found["drift interval: K_in"]
    assert (held, cases) == (pytest.approx(17, abs=2), 40)
    assert found["life told: linear"] == [5, 5]
    assert found["life interval: linear"] == [5, 5]
