# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Plant and measurement layer together: least squares errs as on the reference plant.

Paper 002 reports theta_1 = -1.16 (3 terms) and -1.24 (5 terms), outside its physical interval
[-1, 0]; which layers do that is known for the reference experiment of 105 aging cycles with random
refresh phases.
"""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.simulation import AgingRule, configure, simulate_cycles
from valve_twin.core.valves.press_cartridge.plant import default_simulation

CYCLES = 105
AGING = AgingRule("area_in", "linear", -0.15 / 104, 430)


def least_squares_poles(delay, noise, refresh):
    """Return mean theta_1 with 3 and with 5 terms (paper 002, eqs. (17) and (32)), lag 2."""
    layer = {"measurement": {"delay": delay, "noise": noise, "refresh": refresh}}
    config = configure(replace(default_simulation(), first_cycle=429, aging=(AGING,)), layer)
    poles = []
    for block in simulate_cycles(config, CYCLES, 11):
        x, (v_in, v_out) = block.position, block.inputs[:-2].T
        bend = np.diff(x, 2)
        three = np.stack([np.diff(x)[:-1], v_in, v_out], axis=1)
        five = np.column_stack([three, v_in**2, v_out**2])
        fits = (np.linalg.lstsq(terms, bend, rcond=None)[0][0] for terms in (three, five))
        poles.append(tuple(fits))
    return np.mean(poles, axis=0)


@pytest.mark.no_cover
@pytest.mark.parametrize(
    ("layer", "ls3", "ls5"),
    [
        ((1, 1e-5, 1), -0.76, -0.85),
        ((1, 1e-3, 1), -1.25, -1.39),
        ((1, 4e-3, 1), -1.48, -1.49),
        ((0, 4e-3, 3), -1.24, -1.26),
        ((0, 4e-3, 4), -1.20, -1.23),
        ((0, 1e-5, 5), -1.20, -1.24),
    ],
)
def test_least_squares_pole_is_that_of_the_reference_experiment(layer, ls3, ls5):
    # 0.03: the details of the controller are not given, seen differences are up to 0.02
    assert least_squares_poles(*layer) == pytest.approx([ls3, ls5], abs=0.03)


@pytest.mark.no_cover
def test_an_ideal_sensor_gives_a_pole_of_the_wrong_sign():
    three, five = least_squares_poles(0, 1e-5, 1)
    assert three > 0.5
    assert five > 1.5
