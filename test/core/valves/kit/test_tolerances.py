# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import pickle
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from valve_twin.core.quantity import assumed
from valve_twin.core.valves.interface import ModelOptions
from valve_twin.core.valves.kit.tolerances import (
    Doubt,
    Tolerated,
    contradicted,
    limits,
    tolerance_section,
    tolerated,
)


@dataclass(frozen=True)
class Numbers:
    mass: float = assumed(2.0, "kg", "Moving mass", 0.1, 10.0)
    gas: float = assumed(0.0, "N", "Gas force", 0.0, 10.0)
    length: float = assumed(1.0, "m", "Length", 0.1, 10.0)


Section = tolerance_section(
    "Section", __name__, Numbers, {"mass": 0.03, "gas": 0.1, "length": 0.0}
)


@dataclass(frozen=True, slots=True)
class Options(Numbers, ModelOptions):
    tolerances: object = field(default_factory=Section)


def test_a_constant_of_zero_or_without_tolerance_is_exact():
    found = tolerated(Options())
    assert found.names == ("mass",)
    assert found.sigmas == pytest.approx([0.03 / np.sqrt(3.0)])


def test_a_section_goes_to_other_processes():
    changed = replace(Section(), mass=0.2)
    assert pickle.loads(pickle.dumps(changed)) == changed


def test_a_tolerance_of_an_unknown_number_is_refused():
    with pytest.raises(ValueError, match="no number mas"):
        tolerance_section("Wrong", __name__, Numbers, {"mas": 0.1})


def test_limits_hold_a_constant_inside_its_tolerance_in_95_of_100():
    # a value that is 3 mass, mass evenly spread over its tolerance of 3 %
    rng = np.random.default_rng(1)
    constants = tolerated(Options())
    doubt = Doubt(np.array([3.0 * 2.0 * constants.sigmas[0]]), constants.names)
    given = doubt.around("force", 6.0)
    true = 6.0 * (1.0 + rng.uniform(-0.03, 0.03, 2000))
    assert np.mean((given.lower_95 <= true) & (true <= given.upper_95)) >= 0.95
    assert given.reason == "limited by the tolerance of mass (100 %)"
    assert np.isnan(given.standard_error)


def test_the_constant_that_limits_is_named_with_its_share():
    # one unknown y = x + a + b with sigmas of 3 and 1 of the constants, no noise
    constants = Tolerated(("a", "b"), np.sqrt(3.0) * np.array([3.0, 1.0]))
    covariance = np.array([[10.0, 9.0, 1.0], [9.0, 9.0, 0.0], [1.0, 0.0, 1.0]])
    assert limits(covariance, constants) == ("limited by the tolerance of a (90 %), b (10 %)",)


def test_a_constant_beyond_its_tolerance_is_named():
    constants = Tolerated(("a", "b"), np.array([0.01, 0.01]))
    errors = np.array([0.001, 0.001])
    assert contradicted(np.array([1.012, 0.99]), errors, constants) == ""
    assert "shows b -4 % off" in contradicted(np.array([1.0, 0.96]), errors, constants)
