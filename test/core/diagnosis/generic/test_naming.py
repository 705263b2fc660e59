# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults named by what explains the motion of their cycles."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.finding import UNKNOWN, Finding
from valve_twin.core.diagnosis.config import OF_ANY_VALVE
from valve_twin.core.diagnosis.generic.explained import NAMED
from valve_twin.core.diagnosis.generic.naming import by_repeats, in_travel, renamed
from valve_twin.core.diagnosis.generic.signatures import signatures_of
from valve_twin.core.valves.registry import get_model

ONSET, CYCLES = 15, np.arange(1, 25)


def table():
    """Return the signatures of a first-order valve: derived once a process, and by no import."""
    found = signatures_of(get_model("first_order"))
    assert found is not None
    return found


def finding(fault, *, onset=ONSET, end=-1):
    return Finding(fault, (), "valve", 0.1, 9.0, onset, onset + 2, end)


def shown(*, scatter=0.01, fall=0.0, **more):
    """How much faults explain: at random before, by so much more from the onset on."""
    rng = np.random.default_rng(4)
    rows = 0.1 + scatter * rng.standard_normal((len(CYCLES), len(NAMED)))
    for name, value in more.items():
        rows[CYCLES >= ONSET, NAMED.index(name)] += value
    rows[CYCLES == ONSET] += fall
    return rows


def vectors(fault="delay", size=2.0):
    change = next(s.change for s in table().signatures if s.fault == fault)
    rows = np.zeros((len(CYCLES), len(table().features)))
    rows[CYCLES >= ONSET] = size * np.array(change)
    return rows


def named(found, rows, *, features=None, **more):
    features = vectors() if features is None else features
    return renamed([found], CYCLES, features, rows, table(), OF_ANY_VALVE, **more)[0]


def stood(lost, regained):
    """What cycles lost by standing still and regained: a little before, so much from the onset."""
    rows = 0.01 + 0.002 * np.random.default_rng(5).standard_normal((len(CYCLES), 2))
    rows[CYCLES >= ONSET] += (lost, regained)
    return rows


@pytest.mark.parametrize("wrong", ["lost_motion", "sensor_gain", UNKNOWN])
def test_what_explains_more_than_before_names_it(wrong):
    found = named(finding(wrong), shown(delay=1.0))
    small = next(s.severity for s in table().signatures if s.fault == "delay")
    assert (found.fault, found.part, found.rivals) == ("delay", "valve", ())
    assert found.severity == pytest.approx(2.0 * small, rel=0.3)
    assert (found.onset, found.alarm, found.end) == (ONSET, ONSET + 2, -1)


def test_a_size_is_told_only_where_the_features_show_that_fault():
    """A damper whose zero was off was "slower motion up, size 0.0015", at over 100 deviations."""
    least, rng = table().least(), np.random.default_rng(11)
    rays = [np.array(s.change) / least for s in table().signatures if s.fault == "delay"]
    other = rng.standard_normal(len(least))
    for ray in np.linalg.qr(np.array(rays).T)[0].T:
        other -= (other @ ray) * ray
    other *= 3.0 * np.linalg.norm(rays[0]) / np.linalg.norm(other)
    for share, is_told in ((0.1, False), (1.0, True)):  # 0.1 % and 10 % of the squares
        rows = np.zeros((len(CYCLES), len(least)))
        rows[CYCLES >= ONSET] = (other + share * rays[0]) * least
        found = named(finding("lost_motion"), shown(delay=1.0), features=rows)
        assert found.fault == "delay"
        assert np.isfinite(found.severity) == is_told, share


def test_what_explains_nearly_as_much_is_named_with_it():
    found = named(finding("lost_motion"), shown(delay=1.0, slow=0.85, slow_up=0.4))
    assert (found.fault, found.rivals) == ("delay", ("slow",))


@pytest.mark.parametrize("fault", ["sensor_noise", "sensor_offset", "no_motion"])
def test_what_no_motion_shows_keeps_its_name(fault):
    assert named(finding(fault), shown(delay=0.9)) == finding(fault)


def test_a_sensor_that_repeats_more_values_keeps_its_name_and_one_that_does_not_is_none():
    frozen = vectors("sensor_freeze", 1.0)
    frozen[CYCLES >= ONSET, table().features.index("repeats")] = 0.1
    rows = shown(sticking=1.0)
    assert named(finding("sensor_freeze"), rows, features=frozen) == finding("sensor_freeze")
    assert named(finding("sensor_freeze"), rows).fault == "sticking"


@pytest.mark.parametrize(
    ("told", "noise", "repeats", "name"),
    [
        ("command_loss", 2.0, 0.6, "sensor_freeze"),  # noise is gone: no stem does that
        ("command_loss", 2.0, 0.25, "command_loss"),
        ("command_loss", 0.3, 0.6, "command_loss"),
        ("sensor_freeze", 0.3, 1.0, "no_motion"),  # noise was never seen
        ("sensor_freeze", 0.3, 0.6, "sensor_freeze"),
        ("sensor_freeze", 2.0, 1.0, "sensor_freeze"),
        ("sensor_freeze", np.nan, 1.0, "sensor_freeze"),
    ],
)
def test_repeated_values_are_the_sensors_where_its_noise_is_seen(told, noise, repeats, name):
    features = np.zeros((len(CYCLES), len(table().features)))
    features[:, table().features.index("repeats")] = np.where(CYCLES >= ONSET, repeats, 0.2)
    found = by_repeats([finding(told)], CYCLES, features, table(), noise, OF_ANY_VALVE)[0]
    assert found.fault == name
    assert found.rivals == (("sensor_freeze",) if name == "no_motion" else ())


def test_an_offset_that_comes_with_another_shape_is_what_makes_that():
    assert named(finding("sensor_offset"), shown(sticking=1.5)).fault == "sticking"


@pytest.mark.parametrize("told", ["lost_motion", "sticking"])
def test_what_regains_by_jumps_what_it_lost_sticks_and_what_does_not_has_play(told):
    found = finding(told)
    both = shown(lost_motion=1.0, sticking=0.9)
    assert named(found, both, stood=stood(0.5, 0.4)).fault == "sticking"
    assert named(found, both, stood=stood(0.5, 0.01)).fault == "lost_motion"
    assert named(found, both, stood=stood(0.5, 0.01)).rivals == ()


@pytest.mark.parametrize("ways", [(0.0, 0.0), (0.5, 0.11)])
def test_where_jumps_do_not_tell_the_better_explanation_does_and_both_are_named(ways):
    found = named(finding("sticking"), shown(lost_motion=1.0, sticking=0.9), stood=stood(*ways))
    assert (found.fault, found.rivals) == ("lost_motion", ("sticking",))
    quiet = shown(lost_motion=0.05, sticking=0.02)
    assert named(finding("sticking"), quiet, stood=stood(*ways)) == finding("sticking")


def test_a_motion_that_explains_nothing_more_names_no_fault_while_another_explains_a_little():
    rows = shown(sticking=0.15, lost_motion=0.14)
    rows[:, NAMED.index("end_stop_upper")] = 0.0
    found = named(finding("end_stop_upper"), rows, stood=stood(0.5, 0.4))
    assert (found.fault, found.part) == ("sticking", "valve")
    assert named(finding("end_stop_upper"), shown(sticking=0.03)).fault == "end_stop_upper"
    assert named(finding(UNKNOWN), rows) == finding(UNKNOWN)  # which claims no motion


def test_commands_that_no_cycle_shows_lost_are_an_offset_where_the_levels_are_one():
    rows = shown()
    rows[:, NAMED.index("command_loss")] = 0.0
    levels = vectors("sensor_offset", 1.0)
    levels[CYCLES >= ONSET, table().features.index("unfollowed")] = 0.1
    lost = finding("command_loss")
    found = named(lost, rows, features=levels)
    assert (found.fault, found.part) == ("sensor_offset", "sensor")
    assert abs(found.severity) > 0.0
    assert named(lost, rows, features=vectors("command_loss", 1.0)) == lost
    rows[CYCLES > ONSET, NAMED.index("command_loss")] = 0.1  # which some cycles show
    assert named(lost, rows, features=levels) == lost


def test_a_length_is_told_as_a_share_of_the_travel_whatever_a_cycle_uses_of_it():
    model = get_model("first_order")
    spans = np.where(CYCLES % 2 == 0, 0.1, 0.2)
    found = replace(finding("sensor_offset"), severity=0.5 * (0.06 / 0.1 + 0.06 / 0.2))
    (sized,) = in_travel([found], CYCLES, spans, model)
    assert sized.severity == pytest.approx(0.06)
    unknown = np.full(len(CYCLES), np.nan)
    assert in_travel([found], CYCLES, unknown, model) == (found,)
    delay = finding("delay")
    assert in_travel([delay], CYCLES, spans, model) == (delay,)


@pytest.mark.parametrize("name", ["first_order", "press_cartridge"])
def test_a_length_stays_where_no_position_is_a_share_of_a_travel_or_features_are_its_own(name):
    given = get_model(name)
    model: Any = SimpleNamespace(normalised=name != "first_order", feature_set=given.feature_set)
    found = finding("sensor_offset")
    assert in_travel([found], CYCLES, np.full(len(CYCLES), 0.1), model) == (found,)


def test_the_name_by_signatures_stays_where_it_explains_a_third_or_nothing_does():
    found = finding("lost_motion")
    beside = named(found, shown(delay=1.0, lost_motion=0.5, slow=0.4, slow_up=0.3))
    assert beside == replace(found, rivals=("delay", "slow"))
    assert named(found, shown(delay=0.03)) == found
    assert named(found, shown(delay=0.1, lost_motion=0.05)) == found
    assert named(found, shown(scatter=0.5, delay=0.5)) == found


def test_the_cycle_of_the_onset_is_left_out():
    assert named(finding("lost_motion"), shown(delay=1.0, fall=-5.0)).fault == "delay"


def test_features_that_were_stored_without_it_keep_their_names():
    rows = shown(delay=1.0)
    rows[:12] = np.nan
    assert named(finding("lost_motion"), rows) == finding("lost_motion")
    assert named(finding("lost_motion"), np.full_like(rows, np.nan)).fault == "lost_motion"


def test_what_was_before_maintenance_is_no_measure():
    found = finding("lost_motion")
    assert named(found, shown(delay=1.0), restarts=[ONSET - 2]) == found
    assert named(found, shown(delay=1.0), restarts=[3]).fault == "delay"


def test_cycles_of_another_fault_are_no_measure():
    early = finding("sensor_noise", onset=5, end=12)
    rows = shown(delay=1.0)
    rows[4:11] += 1.0
    both = renamed([early, finding("lost_motion")], CYCLES, vectors(), rows, table(), OF_ANY_VALVE)
    assert [f.fault for f in both] == ["sensor_noise", "delay"]
