# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A product with which more came than a product changes is no reference."""

import numpy as np

from valve_twin.core.diagnosis.changes.across import doubt_across, doubt_of_product
from valve_twin.core.diagnosis.features import FeatureSet

KIND = FeatureSet(
    ("level", "gain", "other", "free"),
    frozenset({"gain", "other"}),
    across={"level": 1e-3, "gain": 0.02, "other": 0.03},
)
FALLEN = (0.0, np.log(0.82), np.log(0.82), 0.0)
CYCLES = np.arange(1, 31)
PRODUCT = np.repeat([0, 1], [12, 18])


def doubt(change, product=PRODUCT, cycles=30):
    """Return what is said where the features change with cycle 13."""
    vectors = 1e-3 * np.random.default_rng(1).standard_normal((30, 4))
    vectors[12:] += change
    return doubt_across(CYCLES[:cycles], vectors[:cycles], product[:cycles], KIND)


def test_what_a_product_changes_is_no_doubt():
    assert doubt((1e-3, -0.03, 0.03, 5.0)) == ""  # what is not named tells nothing


def test_a_gain_that_fell_with_the_product_is_told_with_its_change():
    said = doubt(FALLEN)
    assert said.startswith("no reference: with the product that is made since cycle 13 gain")
    assert "-18 %" in said
    assert doubt((0.0, np.log(0.82), 0.0, 0.0)) == ""  # one alone may be the product's
    assert doubt(FALLEN, cycles=20) == said  # a longer history says the same


def test_few_cycles_and_products_in_turn_say_nothing():
    assert doubt(FALLEN, cycles=16) == ""
    assert doubt(FALLEN, np.zeros(30, np.int64)) == ""
    assert doubt(FALLEN, np.arange(30) % 2) == ""


def test_two_newest_cycles_of_no_product_are_told():
    assert doubt_of_product(np.array([0, 0, 0, 0, -1])) == ""
    assert "the newest 2 cycles" in doubt_of_product(np.array([0, 0, 0, -1, -1]))
