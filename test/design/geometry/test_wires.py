# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Wires of EN IEC 60317-0-1."""

from __future__ import annotations

import pytest

from valve_twin.design.geometry.wires import find_wire


def test_the_enamel_of_grade_2_is_thicker():
    for copper in (0.1e-3, 0.63e-3, 1.6e-3):
        thin, thick = find_wire(copper).overall, find_wire(copper, 2).overall
        assert copper < thin < thick < 1.3 * copper


def test_grade_1_of_a_tenth_is_at_most_117_um():
    assert find_wire(0.1e-3).overall == pytest.approx(0.117e-3)


def test_a_diameter_outside_the_series_names_its_neighbours():
    with pytest.raises(ValueError, match=r"wire = 0.0006: .* 0.00056 and 0.00063"):
        find_wire(0.6e-3)
