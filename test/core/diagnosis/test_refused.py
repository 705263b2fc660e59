# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cycles without an estimate withdraw what was said, and one that does not end names its cause."""

from dataclasses import replace

import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig, Axis
from valve_twin.core.aging.series import order_history
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.diagnosis.changes.finding import FRESH, Finding, describe_finding
from valve_twin.core.diagnosis.generic.motion import Motion
from valve_twin.core.diagnosis.refused import (
    LEAST_REFUSED,
    featureless,
    refused_lately,
    still,
    with_still,
)
from valve_twin.core.past.columns import past_of
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.types import Condition, Estimate, EstimateStatus, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL

CYCLE_NS = 10**10


def given(cycle, *, status=EstimateStatus.ACCEPTED, code="", reason="", length=1.0, stroke=0.5):
    """Return the estimate of a cycle of `length` usual lengths, which ran through `stroke`."""
    start = cycle * CYCLE_NS
    return Estimate(
        model=MODEL.name,
        estimator="output_error",
        cycle=cycle,
        start_ns=start,
        end_ns=start + round(0.9 * length * CYCLE_NS),
        parameters=tuple(
            ParameterValue(p.name, 1.0 + 1e-3 * (cycle % 5)) for p in MODEL.parameters
        ),
        status=status,
        reason=reason,
        reason_code=code,
        used_by_trend=True,
        conditions=(Condition("stroke", stroke),),
    )


def refused(cycle, code, **options):
    return given(cycle, status=EstimateStatus.REFUSED, code=code, reason="why", **options)


USUAL = [given(c) for c in range(1, 21)]


def verdict(history):
    return assess(history, (), AgingConfig(), parameters=MODEL.parameters).verdict


def test_ok_is_withdrawn_after_the_fifth_refused_cycle_and_comes_back():
    bad = [refused(c, RefusalCode.MISFIT.value) for c in range(21, 21 + LEAST_REFUSED)]
    assert verdict(USUAL).kind is VerdictKind.OK
    assert verdict(USUAL + bad[:-1]).kind is VerdictKind.OK
    said = verdict(USUAL + bad)
    assert said.text == "not enough data"
    assert said.evidence == "the newest 5 cycles gave no estimate: why"
    assert not said.kind.asks_for_help
    assert verdict([*USUAL, *bad, given(26)]).kind is VerdictKind.OK


@pytest.mark.parametrize("before", [[], USUAL])
def test_signals_that_cannot_be_those_of_a_valve_are_an_unusable_recording(before):
    bad = [refused(c, RefusalCode.IMPLAUSIBLE.value) for c in range(21, 21 + LEAST_REFUSED)]
    said = verdict(before + bad)
    assert (said.kind, said.text) == (VerdictKind.RECORDING_UNUSABLE, "recording unusable")
    assert said.fault == ""
    assert said.evidence == "the newest 5 cycles gave no estimate: why"
    assert said.kind.asks_for_help
    other = [*bad[1:], refused(26, RefusalCode.MISFIT.value)]
    assert verdict(before + other).text == "not enough data"


def test_what_does_not_feed_the_trend_says_nothing():
    others = [replace(refused(c, "other"), used_by_trend=False) for c in range(21, 31)]
    assert refused_lately(USUAL + others) == FRESH


@pytest.mark.parametrize("code", [RefusalCode.NO_MOTION, RefusalCode.NOT_EXCITED])
def test_a_cycle_that_does_not_end_and_does_not_move_is_no_motion_until_one_moves(code):
    stuck = refused(21, code.value, length=3.0, stroke=0.01)
    found = still([*USUAL, stuck])
    assert found is not None
    assert (found.fault, found.part, found.onset, found.end) == ("no_motion", "valve", 21, -1)
    assert still([*USUAL, stuck, given(25)]) is None


def with_repeats(cycle, share):
    """Return the features of a cycle of which this share of samples repeats the one before."""
    features = (ParameterValue("repeats", share),)
    return replace(
        refused(cycle, ""), estimator="features", parameters=features, used_by_trend=False
    )


@pytest.mark.parametrize(("share", "fault"), [(1.0, "sensor_freeze"), (0.8, "no_motion")])
def test_two_still_cycles_are_a_frozen_sensor_where_not_even_noise_is_left(share, fault):
    cycles = [refused(c, RefusalCode.NO_MOTION.value, stroke=0.0) for c in (21, 22)]
    shown = [with_repeats(c, share) for c in (21, 22)]
    found = still([*USUAL, *cycles, *shown])
    assert found is not None
    assert (found.fault, found.onset, found.alarm) == (fault, 21, 22)
    assert still([*USUAL, cycles[0], shown[0]]) is None


@pytest.mark.parametrize(("length", "alarm"), [(1.0, 22), (3.0, 21)])
def test_the_cycle_that_told_it_stays_while_more_are_still(length, alarm):
    cycles = [
        refused(c, RefusalCode.NO_MOTION.value, stroke=0.0, length=length) for c in range(21, 26)
    ]
    found = [still([*USUAL, *cycles[:count]]) for count in range(2, 6)]
    assert [(f.onset, f.alarm) for f in found if f] == 4 * [(21, alarm)]


def with_noise(cycle, noise):
    """Return the features of a cycle with motion, and with noise at rest where there is any."""
    shown = with_repeats(cycle, 0.5)
    known = (ParameterValue("rest_noise", noise),) if noise else ()
    return replace(shown, parameters=(*shown.parameters, *known))


@pytest.mark.parametrize(
    ("noise", "length", "fault"),
    [
        (1e-4, 3.0, "sensor_freeze"),  # the noise is gone
        (0.0, 3.0, "no_motion"),  # there was none, and the command does not end
        (0.0, 1.0, "sensor_freeze"),  # there was none, and the commands went on as usual
    ],
)
def test_a_sensor_without_noise_stands_still_where_the_command_does_not_end(noise, length, fault):
    codes = RefusalCode.NO_MOTION.value
    cycles = [refused(c, codes, stroke=0.0, length=length) for c in (21, 22)]
    before = [with_noise(c, noise) for c in range(1, 21)]
    found = still([*USUAL, *before, *cycles, *(with_repeats(c, 1.0) for c in (21, 22))])
    assert found is not None
    assert found.fault == fault


@pytest.mark.parametrize(
    "last",
    [
        refused(21, RefusalCode.NO_MOTION.value, stroke=0.01),
        refused(21, RefusalCode.MISFIT.value, length=3.0),
        given(21, length=3.0),
    ],
)
def test_a_cycle_of_usual_length_or_with_motion_is_not(last):
    assert still([*USUAL, last]) is None


def driven(cycle, spread, *, repeats=1.0, motion=()):
    """Return the features of a cycle whose command changes by so much, of any valve."""
    shown = with_repeats(cycle, repeats)
    more = (ParameterValue("program.command.spread", spread), *motion)
    return replace(shown, parameters=(*shown.parameters, *more))


@pytest.mark.parametrize(("spread", "told"), [(0.0, False), (0.09, False), (0.15, True)])
def test_a_valve_that_is_not_asked_to_move_is_not_stuck(spread, told):
    before = [driven(c, 0.2, repeats=0.1) for c in range(1, 21)]
    cycles = [refused(c, RefusalCode.NO_MOTION.value, stroke=0.0) for c in (21, 22, 23)]
    still_shown = [driven(c, spread, repeats=0.1) for c in (21, 22, 23)]
    assert bool(still([*USUAL, *before, *cycles, *still_shown])) is told
    since = [*still_shown[:2], driven(23, 0.0, repeats=0.1)]
    assert bool(still([*USUAL, *before, *cycles, *since])) is told  # nothing tells that it is over


@pytest.mark.parametrize(("noise", "fault"), [(2e-3, "sensor_freeze"), (2.9e-4, "no_motion")])
def test_a_sensor_whose_steps_hide_its_noise_may_be_right_where_nothing_moves(noise, fault):
    motion = Motion(0.1, noise, 1e-3, (0.0, 9.0), (0.0, 1.0)).values()
    before = [driven(c, 0.2, repeats=0.5, motion=motion if c == 6 else ()) for c in range(1, 21)]
    cycles = [refused(c, RefusalCode.NO_MOTION.value, stroke=0.0) for c in (21, 22)]
    found = still([*USUAL, *before, *cycles, *(driven(c, 0.2) for c in (21, 22))])
    assert found is not None
    assert found.fault == fault
    assert "freezing position sensor" in describe_finding(found)


def test_first_cycles_that_do_not_move_have_no_usual_stroke():
    still_ones = [
        refused(c, RefusalCode.NO_MOTION.value, length=9.0, stroke=0.0) for c in (5, 6, 7)
    ]
    assert still([*USUAL[:4], *still_ones]) is None


def fault(name, onset, *, end=-1):
    return Finding(name, (), "valve", 1.0, 9.0, onset, onset + 1, end)


STUCK = fault("no_motion", 23)


@pytest.mark.parametrize("name", ["command_loss", "sensor_freeze"])
def test_what_says_why_nothing_moves_is_told_alone(name):
    known = fault(name, 21)
    assert with_still([known], STUCK) == (known,)


def test_commands_lost_in_no_cycle_that_moved_may_be_a_stuck_spool():
    assert with_still([fault("command_loss", 23)], STUCK) == (STUCK,)
    frozen = fault("sensor_freeze", 23)
    assert with_still([frozen], STUCK) == (frozen,)
    silent = replace(STUCK, fault="sensor_freeze")
    lost = fault("command_loss", 23)
    assert with_still([lost], silent) == (lost,)


def test_a_fault_that_few_cycles_named_before_nothing_moved_is_that_nothing_moves():
    told = with_still([fault("sensor_gain", 21)], STUCK)
    assert told == (replace(STUCK, onset=21, alarm=22),)


def test_clocks_that_run_apart_are_told_beside_it():
    apart = fault("clock", 21)
    assert with_still([apart], STUCK) == (apart, STUCK)


def test_a_fault_of_long_ago_is_told_beside_it():
    old = [fault("sensor_gain", 3), fault("command_loss", 5), fault("delay", 21, end=22)]
    assert with_still(old, STUCK) == (*old, STUCK)
    assert with_still(old, None) == tuple(old)


def features(cycle, status=EstimateStatus.REFUSED):
    found = given(cycle, status=status)
    return replace(found, estimator="features", parameters=(), used_by_trend=False)


def mute_of(history):
    past = past_of(history)
    return featureless(order_history(past, Axis.CYCLES).rows, past.features)


def test_cycles_without_features_are_not_ok():
    shown = [features(c, EstimateStatus.PARTIAL) for c in range(1, 21)]
    later = [given(c) for c in range(21, 21 + LEAST_REFUSED)]
    mute = [features(c) for c in range(21, 21 + LEAST_REFUSED)]
    said = mute_of([*USUAL, *shown, *later, *mute])
    assert said.startswith(f"the newest {LEAST_REFUSED} cycles show no features")
    told = verdict([*USUAL, *later, *mute])
    assert told.kind is VerdictKind.NO_REFERENCE
    seen = features(later[0].cycle, EstimateStatus.PARTIAL)
    assert mute_of([*USUAL, *shown, *later, seen, *mute[1:]]) == ""
    assert mute_of([*USUAL, *shown, *later]) == ""  # they are not asked for any more
    beside = [refused(e.cycle, RefusalCode.MISFIT.value) for e in later[-2:]]
    assert mute_of([*USUAL, *shown, *later[:-2], *beside, *mute]) == said


def test_cycles_without_features_are_seen_behind_a_counter_that_began_anew():
    shown = [features(e.cycle, EstimateStatus.PARTIAL) for e in USUAL]
    anew = [
        replace(e, cycle=e.cycle - 20)
        for c in range(21, 21 + LEAST_REFUSED)
        for e in (given(c), features(c))
    ]
    assert mute_of([*USUAL, *shown, *anew]).startswith(f"the newest {LEAST_REFUSED} cycles")
    assert mute_of([*USUAL, *anew, *shown]) == mute_of([*USUAL, *shown, *anew])
    seen = replace(anew[1], status=EstimateStatus.PARTIAL)
    assert mute_of([*USUAL, *shown, anew[0], seen, *anew[2:]]) == ""


def test_wear_is_told_where_the_newest_cycles_show_no_features():
    worn = [
        replace(e, parameters=tuple(replace(p, value=p.value * share) for p in e.parameters))
        for e in (given(c) for c in range(1, 81))
        for share in [1.0 - 0.01 * max(e.cycle - 20, 0)]
    ]
    mute = [features(c) for c in range(76, 81)]
    assert verdict([*worn, *mute]).kind is VerdictKind.VALVE
