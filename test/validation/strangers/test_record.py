# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the logger of a stranger shows, and the truth behind it."""

import dataclasses

import numpy as np
import pytest

from valve_twin.validation.strangers.draw import draw
from valve_twin.validation.strangers.record import aged, gain, leak, record
from valve_twin.validation.strangers.troubles import Trouble

PLAIN = dataclasses.replace(
    draw(0),
    cycles=3,
    logger=dataclasses.replace(
        draw(0).logger, noise=0.0, bits=16, outliers=0.0, drift=0.0, refresh=1, clocks_apart=0.0
    ),
    control_noise=0.0,
    pauses=(0.0, 0.0, 0.0),
    supply_scatter=0.0,
    troubles=(),
)


def with_logger(**changes):
    return dataclasses.replace(PLAIN, logger=dataclasses.replace(PLAIN.logger, **changes))


def with_fault(name, severity):
    fault = Trouble(name, "", "large", severity, 2, 3)
    return dataclasses.replace(PLAIN, troubles=(fault,))


def test_stamps_go_on_through_all_cycles_at_the_nominal_period():
    stamps = np.concatenate([r.stamp_ns for r in record(PLAIN)])
    assert set(np.diff(stamps).tolist()) == {round(PLAIN.logger.period_s * 1e9)}


def test_the_position_falls_by_its_leak_in_the_hold():
    first = next(record(PLAIN))
    x, v = first.position, first.commands
    still = (x > 0.15) & (v.max(axis=1) == 0.0)
    runs = np.split(np.flatnonzero(still), np.flatnonzero(np.diff(np.flatnonzero(still)) > 1) + 1)
    run = max(runs, key=len)[5:-1]
    slope = np.polyfit(run * PLAIN.logger.period_s, x[run], 1)[0]
    assert -slope == pytest.approx(leak(first.present), rel=0.02)


def test_a_clock_apart_shifts_the_commands_by_its_rate():
    plain = [r.commands[:, 0] for r in record(PLAIN)]
    apart = [r.commands[:, 0] for r in record(with_logger(clocks_apart=0.01))]
    samples = sum(map(len, plain))
    assert samples - sum(map(len, apart)) == pytest.approx(0.01 * samples, abs=2)


@pytest.mark.parametrize(
    ("name", "severity"),
    [("sensor_gain", 0.1), ("sensor_offset", 0.01), ("supply_drop", 0.1), ("leak", 0.005)],
)
def test_a_fault_is_there_in_its_cycles_only(name, severity):
    healthy, faulty = list(record(PLAIN)), list(record(with_fault(name, severity)))
    assert np.array_equal(healthy[0].position, faulty[0].position)
    assert not np.allclose(healthy[1].position, faulty[1].position, atol=2e-3)
    assert healthy[2].present == faulty[2].present


def test_a_frozen_sensor_and_a_stale_one_repeat():
    frozen = list(record(with_fault("frozen", 1.0)))
    assert np.ptp(frozen[1].position) == 0.0
    assert np.ptp(frozen[2].position) > 0.1
    stale = next(record(with_logger(refresh=4, noise=1e-3))).position
    assert np.mean(np.diff(stale) == 0.0) > 0.7


def test_aging_lowers_the_gain_that_it_says():
    stranger = dataclasses.replace(
        PLAIN,
        press=PLAIN.press._replace(damping=0.0, coulomb=0.0, breakaway=0.0),
        aging=dataclasses.replace(PLAIN.aging, law="linear", part="r_in", size=-0.2),
    )
    new, old = (gain(aged(stranger, c), 0.5, 0.02) for c in (1, 61))
    assert old / new == pytest.approx(0.8, abs=0.01)


def test_what_coil_and_preload_take_from_the_command_is_part_of_the_gain():
    press, period_s = PLAIN.press, PLAIN.logger.period_s
    weak = gain(press._replace(coil=0.8), 0.5, period_s)
    assert weak == pytest.approx(0.8 * gain(press, 0.4, period_s))
    late = gain(press._replace(preload=0.1), 0.5, period_s)
    assert late == pytest.approx(0.8 * gain(press, 0.4, period_s))
    assert gain(press._replace(coil=0.8), 0.5, period_s, outflow=True) == pytest.approx(
        gain(press, 0.5, period_s, outflow=True)
    )
