# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A table of signatures on the levels of a valve that is not the simulated one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.diagnosis.table import Signature, SignatureTable

TABLE = SignatureTable(
    features=("rest_noise", "rough_move", "level_zero"),
    covariance=((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-6)),
    floor=(0.0, 0.0, 0.0),
    signatures=(
        Signature("sticking", 0.01, (0.0, math.log(5.0), 0.02), (0.0, 0.1, 0.01)),
        Signature("sensor_noise", 1.0, (math.log(2.0), math.log(2.0), 0.0), (0.0, 0.0, 0.0)),
    ),
    levels=(("rest_noise", math.log(1e-3)), ("rough_move", math.log(1e-3))),
)


def test_a_valve_at_the_levels_of_the_table_has_its_signatures():
    changes, scatters = TABLE.on_levels(np.log([1e-3, 1e-3, 1.0]))
    assert changes == pytest.approx(TABLE.changes())
    assert scatters == pytest.approx(TABLE.scatters())


def test_a_fault_adds_squares_to_what_a_rougher_valve_has():
    changes, scatters = TABLE.on_levels(np.log([1e-3, 7e-3, 1.0]))
    added = (5e-3) ** 2 - (1e-3) ** 2
    rough = math.log(math.sqrt((7e-3) ** 2 + added) / 7e-3)
    assert changes[0] == pytest.approx([0.0, rough, 0.02])
    share = (5e-3) ** 2 / ((7e-3) ** 2 + added)  # of that square which scatters
    assert scatters[0] == pytest.approx([0.0, share * 0.1, 0.01])


def test_a_noisier_sensor_multiplies_the_noise_of_any_valve():
    changes, _ = TABLE.on_levels(np.log([4e-3, 1e-3, 1.0]))
    assert changes[1] == pytest.approx([math.log(2.0), math.log(2.0), 0.0])


def test_a_table_without_levels_has_its_signatures_for_every_valve():
    table = replace(TABLE, levels=())
    assert table.on_levels(np.zeros(3))[0] == pytest.approx(TABLE.changes())


def test_no_feature_scatters_less_than_sampling_or_rounding_makes_it():
    own = replace(TABLE, covariance=((0.04, 0.0), (0.0, 0.01)), floor=(0.1, 0.3))
    assert own.least() == pytest.approx([0.2, 0.3])
    assert own.least(0.25) == pytest.approx([0.1, 0.3])
