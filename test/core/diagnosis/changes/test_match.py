# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The end of a fault that comes in one direction only is told from the begin of one."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.match import fits_an_end, match
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.detection import RIVAL
from valve_twin.core.diagnosis.watch.alarm import whitened
from valve_twin.core.valves.press_cartridge import MODEL

TABLE = MODEL.signatures()
CONFIG = DetectionConfig()


def matches(name, sign):
    """Return the matches of a medium change and of its reverse."""
    rng = np.random.default_rng(3)
    rows = rng.multivariate_normal(np.zeros(len(TABLE.features)), TABLE.covariance, 45)
    signature = [s for s in TABLE.signatures if s.fault == name][1]
    rows[40:] += sign * np.array(signature.change)
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


def test_a_signature_unlike_the_change_gives_way_to_one_that_is_alike():
    """A fault that scatters much was the likeliest of any change, which then was unknown."""
    rng = np.random.default_rng(3)
    rows = rng.multivariate_normal(np.zeros(len(TABLE.features)), TABLE.covariance, 45)
    leak = next(s for s in TABLE.signatures if s.fault == "leak")
    other = next(s for s in TABLE.signatures if s.fault == "dead_band")
    wild = replace(other, scatter=tuple(30.0 * np.sqrt(np.diag(TABLE.covariance))))
    table = replace(TABLE, signatures=(leak, wild))
    w, _, rays = whitened(rows, 40, 45, table, CONFIG)
    varied = 20.0 * rng.standard_normal((5, len(rows.T)))  # as the commands of each cycle do it
    shown = 10.0 * rays.changes[0] + varied - varied.mean(axis=0)
    told = {}
    for known_first in (False, True):
        config = replace(CONFIG, known_first=known_first)
        found = match(w[40:] + shown, rays, table, config, line=1.0 / 40)
        told[known_first] = (max(found.likelihood, key=found.likelihood.__getitem__), found.like)
    assert told[False][0] == "dead_band"
    assert told[True][0] == "leak"
    assert told[True][1] > CONFIG.like
