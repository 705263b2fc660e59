# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a running node costs: memory, modules, losses; the peers of the comparison are real."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from valve_twin.bench.nodes import live
from valve_twin.bench.nodes.processes import some_domain, start_node

pytestmark = pytest.mark.alone

TWIN_MB, PLAIN_MB = 220.0, 150.0
"""Resident memory of a node with compiled kernels and of one without [MB]."""


def wait_until_active(node) -> None:
    end = time.monotonic() + 60.0
    while live.ACTIVE not in node.log:
        assert node.alive, node.log
        assert time.monotonic() < end, node.log
        time.sleep(0.01)  # polls another process's output; nothing depends on the length


@pytest.fixture(scope="module")
def run():
    """Run a twin and an echo; some production cycles at 1 kHz are estimated."""
    with live.live(1, 1e-3, peer="echo") as made:
        made.plant.run(3.0, 1000.0)
        made.settle(made.plant.sent, made.plant.sent)
        yield made


def test_every_sample_is_predicted_and_echoed(run):
    assert run.plant.sent > 3000
    assert run.predictions[0].messages == run.returned.messages == run.plant.sent


def test_a_twin_needs_no_cvxpy(run):
    mapped = Path(f"/proc/{run.twin.pid}/maps").read_text(encoding="utf-8")
    for part in ("/cvxpy/", "/scipy/optimize/", "/clarabel", "/osqp"):
        assert part not in mapped, part
    assert "/llvmlite/" in mapped


def test_a_twin_keeps_to_its_memory(run):
    resident, own = run.twin.memory()
    assert own < resident <= TWIN_MB


def test_a_prediction_costs_less_than_the_echo_of_its_three_inputs(run):
    before = run.twin.cpu_s(), run.peer.cpu_s()
    run.plant.run(2.0, 1000.0)
    run.settle(run.plant.sent, run.plant.sent)
    ours, theirs = run.twin.cpu_s() - before[0], run.peer.cpu_s() - before[1]
    assert ours / 3.0 <= theirs


def test_a_relay_sends_as_much_as_the_twin():
    """It stands for what the middleware needs: as many messages of as many bytes."""
    with live.live(2, 1.0 / live.PLANT_HZ, peer="relay", batch=33) as made:
        made.plant.run(2.0, live.PLANT_HZ / 33.0, 1.0 / live.PLANT_HZ)
        made.settle(33 * made.plant.sent, 6 * made.plant.sent)
        pairs = zip(made.predictions, made.relayed, strict=True)
        assert all(ours.samples == theirs.samples for ours, theirs in pairs)
        sizes = {len(taken.last) for taken in (*made.predictions, *made.relayed)}
        assert len(sizes) == 1
        assert sizes.pop() > 33 * 4 * 8


def test_a_recorder_needs_no_compiled_kernel(tmp_path):
    node = start_node(
        "bag_recorder", some_domain(), tmp_path, "/press/v1", {"bag": str(tmp_path / "bag")}
    )
    try:
        wait_until_active(node)
        assert "/llvmlite/" not in Path(f"/proc/{node.pid}/maps").read_text(encoding="utf-8")
        assert node.memory()[0] <= PLAIN_MB
    finally:
        node.end()
