# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The same record gives bit-identical estimates live, replayed and offline."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import pytest
import yaml

from test.nodes.conftest import own_domain
from valve_twin.core.twin import Estimated
from valve_twin.demo import Processes
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import BagError, StoreError
from valve_twin.io.history.store import History
from valve_twin.io.offline.run import estimate_bag

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.core.types import Estimate

CYCLES = 5
LIMIT_S = 120.0
TOPICS = ("spool_position", "command/v_in", "command/v_out", "cycle", "reference")
SOURCE = {
    "model": "press_cartridge",
    "period_s": 0.03,
    "hold_back_s": 120.0,  # as fast as possible one topic may be a window ahead of the others
    "topic_prefix": "/sim",
    "signals": {"cycle_counter": {"topic": "cycle"}, "reference": {"topic": "reference"}},
    "cycles": {"start_signal": "v_in", "rearm_signal": "v_out", "min_cycle_s": 5.0},
}


@pytest.fixture
def domain(monkeypatch):
    """Use a ROS domain of this test alone."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own_domain()))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


def write(path: Path, parameters) -> Path:
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}), encoding="utf-8")
    return path


def stored(url: str) -> list[Estimate]:
    """Read what is there; nothing while the database is being made."""
    try:
        with History(url, read_only=True) as history:
            return history.estimates("/valve_1")
    except StoreError:
        return []


def wait_for_cycles(url: str, processes: Processes) -> list[str]:
    """Wait until the history holds the cycles; return every estimate to the last bit."""
    end = time.monotonic() + LIMIT_S
    while time.monotonic() < end:
        found = stored(url)
        if len({e.cycle for e in found}) >= CYCLES:
            return sorted(repr(e) for e in found if e.cycle <= CYCLES)
        time.sleep(0.2)  # polls another process's file; nothing depends on the length
    have = len({e.cycle for e in stored(url)})
    pytest.fail(f"{have} of {CYCLES} cycles in {url} after {LIMIT_S} s\n{processes.told()}")


def estimated(tmp_path: Path, bag: Path) -> list[str]:
    """Estimate a bag offline; return every estimate to the last bit."""
    file = tmp_path / "offline.yaml"
    text = {"/valve_1/twin": {"ros__parameters": SOURCE}}
    file.write_text(yaml.safe_dump(text), encoding="utf-8")
    (config,) = load_config(file)
    events = estimate_bag(config, bag, close_last=False)
    found = [e for event in events if isinstance(event, Estimated) for e in event.estimates]
    return sorted(repr(e) for e in found if e.cycle <= CYCLES)


def wait_for_record(tmp_path: Path, bag: Path, processes: Processes) -> None:
    """Wait until the recording, still running, holds the cycles: the twin may be ahead of it."""
    end, found = time.monotonic() + LIMIT_S, 0
    while time.monotonic() < end:
        try:
            found = len(estimated(tmp_path, bag / "bag_0.mcap"))
        except BagError:
            found = 0
        if found == 3 * CYCLES:
            return
        time.sleep(0.5)  # polls another process's file; nothing depends on the length
    pytest.fail(
        f"{found} of {3 * CYCLES} estimates in {bag} after {LIMIT_S} s\n{processes.told()}"
    )


def test_live_replayed_and_offline_give_the_same_bits(tmp_path, domain):
    bag = tmp_path / "bag"
    live_url, replay_url = (f"sqlite:///{tmp_path / n}.sqlite" for n in ("live", "replay"))
    live = write(
        tmp_path / "live.yaml",
        SOURCE
        | {
            "history_url": live_url,
            "estimate_wait_s": 0.0,  # as fast as possible is no live input
            "rate": 0.0,
            "stop_after_cycles": CYCLES + 1,
            "wait_for_subscribers": 2,
        },
    )
    with Processes(tmp_path) as processes:
        processes.start("twin", "/valve_1", [live])
        recorder = write(tmp_path / "recorder.yaml", {"bag": str(bag), "all": True})
        processes.start("bag_recorder", "/valve_1", [recorder])
        processes.start("simulated_valve", "/valve_1", [live])
        lived = wait_for_cycles(live_url, processes)
        wait_for_record(tmp_path, bag, processes)

    replay = write(
        tmp_path / "replay.yaml",
        SOURCE
        | {
            "history_url": replay_url,
            "topic_prefix": "/replay",
            "bag": str(bag),
            "rate": 0.0,
            "wait_for_subscribers": 1,
            "topics": [f"/sim/valve_1/{topic}" for topic in TOPICS],
        },
    )
    with Processes(tmp_path) as processes:
        processes.start("twin", "/valve_1", [replay])
        processes.start("bag_player", "/valve_1", [replay])
        replayed = wait_for_cycles(replay_url, processes)

    offline = estimated(tmp_path, bag)
    assert len(offline) == 3 * CYCLES  # estimators
    assert lived == offline
    assert replayed == offline
