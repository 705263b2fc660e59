# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Samples of a stored cycle come out of the bag that recorded the predictions."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from valve_twin.gateway.page import samples as module
from valve_twin.gateway.page.samples import NoSamplesError, Samples
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.history.tables import CycleRecord

TOPIC = "/v/twin/prediction"
SECOND = 10**9


def record(cycle: int) -> CycleRecord:
    return CycleRecord(cycle, cycle * 100 * SECOND, cycle * 100 * SECOND + 9 * SECOND, 10)


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(TOPIC, "valve_twin_msgs/msg/Prediction")
        for cycle in (1, 2):
            for k in range(10):
                values = (0.1 * k, 0.1 * k + cycle, 0.0, -float(cycle), 0.5)
                data = struct.pack(
                    "<4siII4xQ5dBB", b"\0\1\0\0", cycle * 100 + k, 0, 1, cycle, *values, 0, 1
                )
                writer.write(TOPIC, data, log_ns=(cycle * 100 + k) * SECOND)
    return tmp_path / "bag"


def test_the_samples_of_a_cycle_are_those_between_its_stamps(bag):
    found = Samples([str(bag)]).cycle("/v", record(2))
    assert found.cycle == 2
    assert len(found.stamp_ns) == 10
    assert found.measured == pytest.approx(0.1 * np.arange(10))
    assert found.predicted == pytest.approx(0.1 * np.arange(10) + 2.0)
    assert (found.residual == -2.0).all()
    assert found.residual_sigma == 0.5
    assert (found.validity == 0).all()


def test_what_is_not_there_says_why(bag, tmp_path, monkeypatch):
    with pytest.raises(NoSamplesError, match="a history keeps no samples: name the bag"):
        Samples([]).cycle("/v", record(1))
    samples = Samples([str(bag)])
    with pytest.raises(NoSamplesError, match="holds no sample of cycle 3 of /v"):
        samples.cycle("/v", record(3))
    with pytest.raises(NoSamplesError, match="/other/twin/prediction"):
        samples.cycle("/other", record(1))
    with pytest.raises(NoSamplesError, match="none"):
        Samples([str(tmp_path / "none")]).cycle("/v", record(1))
    monkeypatch.setattr(module, "MOST_BYTES", 10)
    with pytest.raises(NoSamplesError, match="cut the time wanted"):
        Samples([str(bag)]).cycle("/v", record(1))
