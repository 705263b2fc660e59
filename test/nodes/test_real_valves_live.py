# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Two valves that were really measured, replayed through the live twin."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rclpy
import yaml
from rclpy.qos import QoSProfile
from valve_twin_msgs.msg import Prediction, PredictionSeries

from test.nodes.conftest import own_domain
from valve_twin.core.twin import Estimated
from valve_twin.demo import Processes
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import History
from valve_twin.io.offline.run import estimate_bag
from valve_twin.io.tables.csv_import import import_csv

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.core.types import Estimate

LIMIT_S = 90.0
DEEP = QoSProfile(depth=100_000)


@pytest.fixture
def domain(monkeypatch):
    """Use a ROS domain of this test alone."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own_domain()))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


def measured(root: Path, name: str) -> Path:
    folder = root.parent / "shared" / "data" / name
    if not folder.is_dir():
        pytest.skip(f"no measured data at {folder}")
    return folder


def stored(url: str, valve: str) -> list[Estimate]:
    """Read what is there; nothing while the database is being made."""
    try:
        with History(url, read_only=True) as history:
            return history.estimates(valve)
    except StoreError:
        return []


def drain(node: Any, taken: list[Any]) -> None:
    """Take messages until none has come for a while."""
    before = -1
    while len(taken) > before:
        before = len(taken)
        for _ in range(200):
            rclpy.spin_once(node, timeout_sec=0.005)


def replay(root: Path, tmp_path: Path, name: str, files: list[Path], cycles: int) -> Any:
    """Import, replay through the live twin; return its estimates and predictions, and offline."""
    config_file = root / "config" / f"{name}.yaml"
    (config,) = load_config(config_file)
    bag = tmp_path / "bag"
    import_csv(files, config, bag)
    url = f"sqlite:///{tmp_path / 'history.sqlite'}"
    signals = sorted({s.topic for s in config.signals.values()})
    overrides = {
        "topic_prefix": "/replay",
        "history_url": url,
        "bag": str(bag),
        "rate": 0.0,
        "wait_for_subscribers": 1,
        "topics": signals,
    }
    more = tmp_path / "more.yaml"
    more.write_text(yaml.safe_dump({"/**": {"ros__parameters": overrides}}), encoding="utf-8")
    batched = config.signals["position"].batched
    kind = PredictionSeries if batched else Prediction
    rclpy.init()
    node = rclpy.create_node("listener")
    taken: list[Any] = []
    topic = f"{config.name}/twin/prediction"
    node.create_subscription(kind, topic, taken.append, DEEP)
    end = time.monotonic() + LIMIT_S
    try:
        with Processes(tmp_path) as processes:
            processes.start("twin", "/", [config_file, more])
            while node.count_publishers(topic) == 0 and time.monotonic() < end:
                rclpy.spin_once(node, timeout_sec=0.1)
            processes.start("bag_player", "/", [config_file, more])
            lived: list[Estimate] = []
            while len({e.cycle for e in lived}) < cycles and time.monotonic() < end:
                drain(node, taken)
                lived = stored(url, config.name)
            drain(node, taken)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    offline = [
        e
        for event in estimate_bag(config, bag, close_last=False)
        if isinstance(event, Estimated)
        for e in event.estimates
    ]
    return lived, taken, offline


def test_the_boiler_valve_is_followed_live(root, tmp_path, domain):
    data = measured(root, "damadics_boiler_valve")
    lived, taken, offline = replay(root, tmp_path, "boiler_valve", [data], 5)
    assert [e.cycle for e in lived] == [1, 2, 3, 4, 5]
    assert repr(lived) == repr(offline)
    residuals = np.array([m.residual for m in taken if m.validity == Prediction.VALID])
    assert len(residuals) > 800
    assert np.std(residuals) < 0.03


def test_the_cylinder_is_followed_live_in_batches(root, tmp_path, domain):
    data = measured(root, "eha_cylinder")
    files = [data / f"exp_data_{load}_4.csv.gz" for load in (1, 3)]
    lived, taken, offline = replay(root, tmp_path, "eha_cylinder", files, 3)
    assert [e.cycle for e in lived] == [e.cycle for e in offline] == [1, 2, 3]
    assert repr(lived) == repr(offline)
    assert min(e.fit_train for e in lived) > 90.0
    residuals = np.concatenate([np.asarray(m.residual) for m in taken])
    validity = np.concatenate([np.asarray(m.validity, dtype=np.uint8) for m in taken])
    assert np.std(residuals[validity == Prediction.VALID]) < 1e-3
