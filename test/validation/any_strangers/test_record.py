# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A stranger's record: clocks, what repeats, what is lost."""

import numpy as np

from valve_twin.validation.any_strangers.draw import draw
from valve_twin.validation.any_strangers.record import Machine, branch, record
from valve_twin.validation.any_strangers.troubles import Trouble

SPOOLED = draw(73_002)


def test_stamps_go_on_by_one_period_through_all_cycles():
    stamps = np.concatenate([part.stamp_ns for part in record(SPOOLED, 3)])
    steps = np.diff(stamps)
    assert np.abs(steps - SPOOLED.logger.period_s * 1e9).max() <= 1.0


def test_a_branch_goes_on_by_itself_with_the_same_chances():
    machine = Machine(SPOOLED)
    machine.next_cycle()
    other = branch(machine)
    frozen = other.next_cycle(Trouble("frozen", "large", 1.0, 2))
    sound = machine.next_cycle()
    assert np.ptp(frozen.position) == 0.0
    assert np.ptp(sound.position) > 0.5
    assert np.array_equal(frozen.command, sound.command)


def test_a_lost_command_is_recorded_as_sent_and_moves_nothing():
    machine = Machine(SPOOLED)
    machine.next_cycle()
    lost = machine.next_cycle(Trouble("command_loss", "large", 1.0, 2))
    assert np.ptp(lost.command) > 0.5
    assert np.ptp(lost.position) < 0.1
