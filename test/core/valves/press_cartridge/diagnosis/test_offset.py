# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""An offset of the command is a dead band of the other sign, and both are named."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.finding import describe_finding
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.table import with_floor
from valve_twin.core.valves.press_cartridge import MODEL

TABLE = MODEL.signatures()
ONSET = 50


def found(change):
    """Return what is found where the features change at `ONSET`."""
    covariance = with_floor(np.array(TABLE.covariance), np.array(TABLE.floor))
    noise = np.random.default_rng(1).standard_normal((ONSET + 8, len(covariance)))
    vectors = noise @ np.linalg.cholesky(covariance).T
    vectors[ONSET:] += change
    return detect(np.arange(1, len(vectors) + 1), vectors, TABLE).present


@pytest.mark.parametrize(
    ("sign", "name", "rival"),
    [(1.0, "dead_band", "command_offset"), (-1.0, "command_offset", "dead_band")],
)
def test_either_sign_is_found_and_told_with_what_settles_it(sign, name, rival):
    medium = [s for s in TABLE.signatures if s.fault == "dead_band"][1]
    finding = found(sign * np.array(medium.change))
    assert (finding.fault, finding.rivals) == (name, (rival,))
    # 12 standard deviations a cycle, 6 cycles against a line of 40: 5 % each
    assert finding.severity == pytest.approx(medium.severity, rel=0.15)
    assert "measure the command at the valve" in describe_finding(finding)


def test_faults_without_a_partner_are_told_alone():
    leak = [s for s in TABLE.signatures if s.fault == "leak"][2]
    finding = found(np.array(leak.change))
    assert (finding.fault, finding.rivals) == ("leak", ())
