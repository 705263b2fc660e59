# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A solenoid whose coenergy is known in closed form, as new and worn."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from test.core.physics.test_coenergy_tables import (
    CURRENTS,
    GAIN,
    MAP,
    MUTUAL,
    POSITIONS,
    SATURATION,
    X0,
)
from valve_twin.core.physics.coenergy import CoenergyMap, spline_coefficients
from valve_twin.core.quantity import replaced
from valve_twin.core.valves.designed import Wear
from valve_twin.core.valves.double_solenoid.designed import map_lists
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant

U = np.sqrt(1 + (CURRENTS / SATURATION) ** 2)
OWN = GAIN * SATURATION**2 * (U - 1), GAIN * CURRENTS / U
SHORT = CURRENTS * OWN[1], OWN[1] + CURRENTS * GAIN / U**3
PLACE = POSITIONS / X0


def product(value, slope, level, rise):
    """Return the spline values of f(i) g(x) with their slopes, of coil A."""
    out = np.zeros((2 * len(value), 2 * len(value), 2 * len(level)))
    ones = np.ones(len(value))
    for f, i in ((value, 0), (slope, 1)):
        for g, k in ((level, 0), (rise, 1)):
            out[i::2, 0::2, k::2] = np.einsum("a,b,x->abx", f, ones, g)
    return out


def changed(values):
    axes = (CURRENTS, CURRENTS, POSITIONS)
    return CoenergyMap(("A", "B"), CURRENTS, POSITIONS, spline_coefficients(values, axes), {})


def mixed():
    """Return the spline values of M a b."""
    ones = np.ones(len(POSITIONS))
    out = np.zeros((2 * len(CURRENTS), 2 * len(CURRENTS), 2 * len(POSITIONS)))
    out[0::2, 0::2, 0::2] = MUTUAL * np.einsum("a,b,x->abx", CURRENTS, CURRENTS, ones)
    out[1::2, 0::2, 0::2] = MUTUAL * np.einsum("a,b,x->abx", ones[: len(CURRENTS)], CURRENTS, ones)
    out[0::2, 1::2, 0::2] = MUTUAL * np.einsum("a,b,x->abx", CURRENTS, ones[: len(CURRENTS)], ones)
    out[1::2, 1::2, 0::2] = MUTUAL
    return out


def turned(of):
    flipped = np.ascontiguousarray(of.coefficients.transpose(1, 0, 2)[:, :, ::-1])
    return CoenergyMap(of.coils, of.currents, of.positions, flipped, {})


def wear():
    """Return gap, rim and turns of both sides, and steel."""
    even = np.ones(len(PLACE))
    gap = changed(-product(*OWN, (0.5 + PLACE) ** 2, 2 * (0.5 + PLACE) / X0))
    rim = changed(-product(*OWN, 0.3 * (1 - PLACE), -0.3 / X0 * even))
    turns = changed(-product(*SHORT, 1 + PLACE, even / X0) - mixed())
    square = OWN[0] ** 2, 2 * OWN[0] * OWN[1]
    iron = changed(-product(*square, 1 + PLACE, even / X0))
    iron = changed_sum(iron, turned(iron))
    sides = (("gap", gap), ("rim", rim), ("turns", turns))
    both = [Wear(f"{n}_{s}", m) for n, a in sides for s, m in (("a", a), ("b", turned(a)))]
    return (*both, Wear("steel", iron))


def changed_sum(one, other):
    return CoenergyMap(
        one.coils, one.currents, one.positions, one.coefficients + other.coefficients, {}
    )


WEAR = wear()
PLANT = replaced(DoubleSolenoidPlant(spring_1=2e4, spring_2=2e4), map_lists(MAP))


def worn_plant(name, size, **numbers):
    """Return the plant with a worn dimension."""
    of = next(w.change for w in WEAR if w.name == name)
    coefficients = MAP.coefficients + size * of.coefficients
    worn = CoenergyMap(MAP.coils, MAP.currents, MAP.positions, coefficients, {})
    return replaced(PLANT, {**map_lists(worn), **numbers})


@pytest.fixture(scope="session")
def solenoid():
    return SimpleNamespace(plant=PLANT, wear=WEAR, worn=worn_plant)
