# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The end of a fault that comes in one direction only is told from the begin of one."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.match import fits_an_end, match
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.detection import RIVAL
from valve_twin.core.diagnosis.watch.whitened import whitened
from valve_twin.core.valves.press_cartridge import MODEL

TABLE = MODEL.signatures()
CONFIG = DetectionConfig()


def matches(name, sign, times=1.0):
    """Return the matches of some times a medium change and of its reverse."""
    rng = np.random.default_rng(3)
    rows = rng.multivariate_normal(np.zeros(len(TABLE.features)), TABLE.covariance, 45)
    signature = [s for s in TABLE.signatures if s.fault == name][1]
    rows[40:] += sign * times * np.array(signature.change)
    w, _, rays = whitened(rows, 40, 45, TABLE, CONFIG)
    off = w[40:] - w[:40].mean(axis=0)
    found = match(off, rays, TABLE, CONFIG, line=1.0 / 40)
    return found, match(-off, rays, TABLE, CONFIG, line=1.0 / 40)


def fits(name, sign):
    """Return whether a medium change fits the end of a fault."""
    found, reverse = matches(name, sign)
    return fits_an_end(found, reverse, CONFIG, least=RIVAL)


@pytest.mark.parametrize("name", ["leak", "stiction"])
def test_a_fault_that_goes_fits_its_end_and_one_that_comes_does_not(name):
    assert fits(name, -1.0)
    assert not fits(name, 1.0)


def test_what_comes_in_both_directions_has_no_end_of_its_own():
    for sign in (-1.0, 1.0):
        assert not fits("sensor_gain", sign)


def test_the_likeliest_fault_and_its_size_are_told():
    found, _ = matches("leak", 1.0)
    assert max(found.likelihood, key=found.likelihood.__getitem__) == "leak"
    size = [s.severity for s in TABLE.signatures if s.fault == "leak"][1]
    # 12 standard deviations a cycle, five cycles: 4 %, and 0.3 of it may be unlike
    assert found.severity == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize("times", [1e6, 1e50, 1e95])
def test_a_change_of_any_size_is_told_with_its_size(times):
    """Its square was no number from 1e154 standard deviations on, its matrix singular from 1e9."""
    usual, found = (matches("sensor_gain", 1.0, by)[0] for by in (1e4, times))
    assert max(found.likelihood, key=found.likelihood.__getitem__) == "sensor_gain"
    assert np.isfinite(list(found.likelihood.values())).any()
    assert found.like == pytest.approx(usual.like)
    assert found.deviation == pytest.approx(usual.deviation * times / 1e4, rel=1e-3)
    assert found.severity == pytest.approx(usual.severity * times / 1e4, rel=1e-3)
