# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.simulation.program import CycleProgram


def test_default_program_is_the_press_cycle():
    reference = CycleProgram().reference(0.01)
    assert len(reference.position) == 2550
    at = {t: reference.position[round(t / 0.01)] for t in (0.5, 1.1, 7.4, 8.25, 9.5, 17.9, 18.1)}
    assert at == pytest.approx(
        {0.5: 0.0, 1.1: 0.2, 7.4: 0.2, 8.25: 0.24, 9.5: 0.28, 17.9: 0.28, 18.1: 0.0}
    )


def test_hold_is_where_the_reference_stands_still():
    reference = CycleProgram().reference(0.01)
    between = ~np.isin(reference.position, [0.0, 0.2, 0.28])
    assert between.sum() > 100
    assert not reference.hold[between].any()
    assert not reference.hold[round(8.0 / 0.01)]
    assert reference.hold[round(5.0 / 0.01)]
    assert reference.hold[round(15.0 / 0.01)]


def test_step_takes_its_rise_time():
    program = CycleProgram((0.0, 1.0), ("hold", "step"), (0.0, 1.0), 3.0, step_time_s=0.5)
    reference = program.reference(0.1)
    np.testing.assert_allclose(reference.position[10:17], [0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"kinds": ("hold", "jump")}, "kinds = 'jump': must be one of hold, step, ramp"),
        ({"targets": (0.0,)}, "2, 2 and 1 entries"),
        ({"targets": (0.0, 1.5)}, r"targets = 1\.5: must be a number from 0 to 1"),
        ({"times_s": (0.0, 30.0)}, "must start at 0, increase, and end before"),
        ({"times_s": (1.0, 2.0)}, "must start at 0"),
    ],
)
def test_refuses_what_is_no_cycle(changes, text):
    good = {"times_s": (0.0, 1.0), "kinds": ("hold", "step"), "targets": (0.0, 0.5)}
    with pytest.raises(ValueError, match=text):
        CycleProgram(**(good | changes))
