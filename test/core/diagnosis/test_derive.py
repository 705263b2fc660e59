# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is derived is what the valve's own features tell."""

from dataclasses import replace

import pytest

from valve_twin.core.diagnosis.derive import Effort, derive


def test_a_valve_derives_the_faults_that_its_features_tell(rig):
    own = replace(rig.model.feature_set, first_sizes={"leak": 1e-4}, largest={"leak": 5e-4})
    model = replace(rig.model, feature_set=own)
    found = derive(replace(rig, model=model), effort=Effort((900,), healthy=30, faulty=2))
    assert found.features == own.names
    assert found.faults == ("leak",)
    assert max(s.severity for s in found.signatures) == 5e-4


def test_sizes_beyond_the_usual_ones_end_at_the_greatest(rig):
    own = replace(rig.model.feature_set, first_sizes={"leak": 1e-4}, largest={"leak": 4e-3})
    model = replace(rig.model, feature_set=own)
    effort = Effort((900,), healthy=30, faulty=2, factors=(1.0, 3.0, 10.0, 30.0, 1e4))
    sizes = [s.severity for s in derive(replace(rig, model=model), effort=effort).signatures]
    assert len(sizes) == 4
    assert [s / sizes[0] for s in sizes] == pytest.approx([1.0, 3.0, 10.0, 30.0])
