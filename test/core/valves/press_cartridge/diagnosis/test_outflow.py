# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Emptying pilots that deliver less are a fault of their own, not a lost command."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.table import with_floor
from valve_twin.core.valves.press_cartridge import MODEL

TABLE = MODEL.signatures()
ONSET = 50


def test_a_step_of_both_gains_of_emptying_is_the_emptying_pilots():
    covariance = with_floor(np.array(TABLE.covariance), np.array(TABLE.floor))
    noise = np.random.default_rng(1).standard_normal((ONSET + 8, len(covariance)))
    vectors = noise @ np.linalg.cholesky(covariance).T
    gains = [TABLE.features.index(name) for name in ("gain_out_low", "gain_out_high")]
    vectors[ONSET:, gains] -= np.log(1.08)
    found = detect(np.arange(1, len(vectors) + 1), vectors, TABLE).present
    assert found is not None
    assert (found.fault, found.part) == ("weak_outflow", "valve")
    # small commands scatter by 2 %, large ones by 0.7 %, 6 cycles against a line of 40
    assert found.severity == pytest.approx(0.08, rel=0.15)
