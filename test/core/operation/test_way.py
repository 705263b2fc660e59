# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The end of a rest and the moving median."""

import numpy as np

from valve_twin.core.operation.way import end_of, smooth_way


def test_the_end_of_a_rest_is_its_last_fifth_and_not_too_short():
    rest = np.arange(100.0)
    assert end_of(rest).tolist() == rest[80:].tolist()
    assert len(end_of(rest[:12])) == 5
    assert len(end_of(rest[:12], 10)) == 10


def test_single_samples_are_no_movement_and_edges_stay():
    way = np.repeat([0.0, 1.0], 20)
    way[[7, 30]] = 9.0
    assert smooth_way(way).tolist() == np.repeat([0.0, 1.0], 20).tolist()
