# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Samples of a stored cycle come out of the bag that recorded the predictions."""

from __future__ import annotations

import struct
from types import SimpleNamespace

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


class Recording:
    """A bag that grows, and how often it was read."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.cycles, self.reads, self.looks, self.size, self.now = 1, 0, 0, 100, 0.0
        monkeypatch.setattr(module, "bag_info", self.info)
        monkeypatch.setattr(module, "_read", self.read)

    def grow(self, cycles: int) -> None:
        self.cycles, self.size = self.cycles + cycles, self.size + 100 * cycles

    def info(self, _: str) -> SimpleNamespace:
        self.looks += 1
        return SimpleNamespace(start_ns=1, size=self.size, topics=())

    def read(self, *_: object) -> module._Read:
        self.reads += 1
        starts = 100 * np.arange(1, self.cycles + 1)[:, None]
        t = (starts + np.arange(10)).ravel() * SECOND
        names = ("measured", "predicted", "simulated", "residual", "sigma", "validity")
        return module._Read(t, {n: np.zeros(len(t)) for n in names})


def test_a_bag_that_is_still_recorded_is_read_anew_only_for_what_is_new(monkeypatch):
    bag = Recording(monkeypatch)
    bag.grow(9)
    samples = Samples(["/bag"], lambda: bag.now)
    for _ in range(20):
        bag.grow(1)
        bag.now += 0.5 * module.REFRESH_S
        assert len(samples.cycle("/v", record(5)).stamp_ns) == 10
    assert bag.reads == 1
    assert bag.looks <= 11
    assert len(samples.cycle("/v", record(5)).stamp_ns) == 10
    bag.now += 2.0 * module.REFRESH_S
    assert len(samples.cycle("/v", record(25)).stamp_ns) == 10
    for _ in range(50):  # what is not recorded yet does not make it read at every view
        bag.grow(1)
        bag.now += 0.1
        with pytest.raises(NoSamplesError, match="holds no sample of cycle 500"):
            samples.cycle("/v", record(500))
    assert bag.reads <= 4


def test_another_bag_in_its_place_is_read(monkeypatch):
    bag = Recording(monkeypatch)
    bag.grow(9)
    samples = Samples(["/bag"], lambda: bag.now)
    samples.cycle("/v", record(2))
    bag.cycles, bag.size = 2, 50
    bag.now += 2.0 * module.REFRESH_S
    samples.cycle("/v", record(2))
    assert bag.reads == 2


def test_who_waits_for_a_bag_that_others_have_read_is_told_so(bag, monkeypatch):
    monkeypatch.setattr(module, "WAIT_S", 0.01)
    samples = Samples([str(bag)])
    with samples._lock, pytest.raises(NoSamplesError, match="being read for others: load"):
        samples.cycle("/v", record(1))
    assert samples.cycle("/v", record(1)).cycle == 1
