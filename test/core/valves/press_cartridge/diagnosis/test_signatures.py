# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The committed signatures of the press valve are what its simulation gives."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.derive import DETECTABLE, Effort, derive
from valve_twin.core.diagnosis.table import BY_NAME, FACTORS, whitener, with_floor
from valve_twin.io.config.campaign import load_campaign


def test_the_sizes_follow_one_rule(root, table):
    campaign = load_campaign(root / "config" / "faults_press.yaml")
    for name, sizes in campaign.config.severities.items():
        known = [s.severity for s in table.signatures if s.fault == name][:3]
        assert sizes == pytest.approx(known, rel=5e-3)  # three digits in the file
        assert np.allclose(np.array(sizes) / sizes[0], FACTORS, rtol=5e-3)


@pytest.mark.no_cover
def test_the_committed_signatures_are_what_the_simulation_gives(rig, table):
    effort = Effort(seeds=(900, 901, 902), healthy=30, faulty=3)
    found = derive(rig, ("leak",), effort=effort)
    for one in found.signatures:
        other = next(
            s
            for s in table.signatures
            if s.fault == one.fault
            and np.sign(s.severity) == np.sign(one.severity)
            and 0.5 < s.severity / one.severity < 2.0
        )
        # 87 degrees of freedom: the scatter behind the size is known to 8 %
        assert one.severity == pytest.approx(other.severity, rel=0.2)
        k = table.features.index("hold_slope")
        expected = other.change[k] * one.severity / other.severity
        assert one.change[k] == pytest.approx(expected, rel=0.05)


def test_small_is_what_four_deviations_are(table):
    white = whitener(with_floor(np.array(table.covariance), np.array(table.floor)))
    for name in table.faults:
        small = next(s for s in table.signatures if s.fault == name)
        distance = np.linalg.norm(white @ np.array(small.change))
        # two digits of the size, and chance in faults that come and go
        tolerance = 0.25 if BY_NAME[name].part == "command" else 0.08
        assert distance == pytest.approx(DETECTABLE, rel=tolerance), name
