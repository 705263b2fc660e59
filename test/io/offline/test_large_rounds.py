# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Large rounds give what the short rounds of a live stream give, or are not used."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from test.bag_samples import write_sample
from valve_twin.core.simulation import SimulatedValve
from valve_twin.core.types import Cycle, Prediction
from valve_twin.core.valves.registry import get_model, get_simulation
from valve_twin.io.bags.read import SLICE_S, BagWriter, read_signals
from valve_twin.io.cdr.signals import SignalBlock
from valve_twin.io.config.valve import load_config
from valve_twin.io.offline import large_rounds
from valve_twin.io.offline.make_twin import make_twin
from valve_twin.io.offline.run import drive, estimate_bag, join_predictions

CYCLES = 4
START_NS = 10**18
PREFIX = "/sim/press/valve_1"
TOPICS = ("command/v_in", "command/v_out", "spool_position")


@pytest.fixture(scope="module")
def config(root):
    (loaded,) = load_config(root / "config" / "simulated_press.yaml")
    options = dataclasses.replace(
        loaded.options, output_error=False, estimators=("equation_error_qp4",)
    )
    return dataclasses.replace(loaded, options=options)


@pytest.fixture(scope="module")
def record():
    """Return rows of (log, topic, stamp, value) of a simulated press valve."""
    simulation = get_simulation("press_cartridge")
    block = SimulatedValve(simulation, 5).advance(CYCLES * simulation.cycle_samples)
    columns = (block.inputs[:, 0], block.inputs[:, 1], block.position)
    return [
        (stamp + 1000 * k, TOPICS[k], stamp, float(column[n]))
        for n, stamp in enumerate((block.stamp_ns + START_NS).tolist())
        for k, column in enumerate(columns)
    ]


def clean(rows):
    return rows


def delayed(rows):
    """Record a stretch of the commands three seconds late: beyond hold_back_s."""
    return sorted(
        (log + (3_000_000_000 if 900 <= i < 1500 and topic != TOPICS[2] else 0), topic, stamp, v)
        for i, (log, topic, stamp, v) in enumerate(rows)
    )


def routed(rows):
    """Deliver each topic by a way of its own: up to 0.7 s apart."""
    way = dict(zip(TOPICS, (700_000_000, 0, 200_000_000), strict=True))
    return sorted((log + way[topic], topic, *rest) for log, topic, *rest in rows)


def shuffled(rows):
    """Record within 0.4 s in any order."""
    rng = np.random.default_rng(2)
    late = rng.integers(0, 400_000_000, len(rows)).tolist()
    return sorted((log + d, *rest) for d, (log, *rest) in zip(late, rows, strict=True))


def doubled(rows):
    return [row for i, row in enumerate(rows) for _ in range(2 if i % 97 == 0 else 1)]


def set_back(rows):
    """Set the data's clock back by two minutes in the middle."""
    back, half = 120_000_000_000, len(rows) // 2
    return [*rows[:half], *((log, t, s - back, v) for log, t, s, v in rows[half:])]


def silent(rows):
    """Leave one command out for half a minute."""
    return [r for i, r in enumerate(rows) if r[1] != TOPICS[1] or not 3000 < i < 6000]


def on_change(rows):
    """Publish a command only where it changes."""
    kept: list[tuple[int, str, int, float]] = []
    last: dict[str, float] = {}
    for row in rows:
        if row[1] == TOPICS[2] or last.get(row[1]) != row[3]:
            kept.append(row)
        last[row[1]] = row[3]
    return kept


def bag_of(rows, path):
    with BagWriter(path, chunk_size=16_384) as bag:
        for log_ns, topic, stamp_ns, value in rows:
            write_sample(bag, f"{PREFIX}/{topic}", stamp_ns, value, log_ns=log_ns)
    return path


def run(config, stream):
    """Return cycles, estimates, joined predictions and counts of a run."""
    twin = make_twin(config)
    cycles, estimates = [], []
    predictions: dict[int, list[Prediction]] = {}
    for event in stream(twin):
        if isinstance(event, Prediction):
            predictions.setdefault(event.cycle, []).append(event)
        elif isinstance(event, Cycle):
            frames = event.frames
            data = (frames.stamp_ns.tobytes(), frames.position.tobytes(), frames.inputs.tobytes())
            cycles.append((event.number, event.reason, event.lost, event.reproducible, data))
        else:
            estimates.append(repr(event.estimates) if hasattr(event, "estimates") else repr(event))
    joined = {n: join_predictions(parts) for n, parts in predictions.items()}
    return cycles, estimates, joined, twin.counts()


def streamed(config, bag):
    position = get_model(config.model).output
    sources = sorted(config.signals.values(), key=lambda s: s.signal == position)
    blocks = read_signals(bag, sources, slice_s=SLICE_S)
    return run(config, lambda twin: drive(twin, config, ([b] for b in blocks)))


@pytest.mark.parametrize(
    "change", [clean, delayed, routed, shuffled, doubled, set_back, silent, on_change]
)
@pytest.mark.parametrize("samples", [2000, 50_000])
def test_the_events_are_those_of_the_stream(
    config, record, change, samples, tmp_path, monkeypatch
):
    monkeypatch.setattr(large_rounds, "LARGE_SAMPLES", samples)
    bag = bag_of(change(record), tmp_path / "bag")
    cycles, estimates, predictions, counts = run(
        config, lambda twin: estimate_bag(config, bag, twin=twin)
    )
    expected = streamed(config, bag)
    assert cycles == expected[0]
    assert len(cycles) >= 2
    assert estimates == expected[1]
    assert counts == expected[3]
    assert predictions.keys() == expected[2].keys()
    for number, joined in predictions.items():
        for name in ("stamp_ns", "measured", "predicted", "simulated", "residual", "validity"):
            ours, theirs = getattr(joined, name), getattr(expected[2][number], name)
            assert np.array_equal(ours, theirs, equal_nan=name not in ("stamp_ns", "validity"))


def blocks_of(rows, *, header=True):
    """Return one round of the rows."""
    found = []
    for topic in TOPICS:
        mine = [row for row in rows if row[1] == topic]
        log, stamp = (np.array([row[k] for row in mine], dtype=np.int64) for k in (0, 2))
        found.append(SignalBlock(topic, stamp, np.array([r[3] for r in mine]), header, log))
    return found


def sizes(rows, **kind):
    stream = large_rounds.in_large_rounds(
        blocks_of(rows, **kind), TOPICS, hold_back_s=2.0, slice_s=SLICE_S
    )
    return [len(parts) for parts in stream]


@pytest.mark.parametrize("change", [clean, routed, silent, on_change])
def test_an_orderly_record_goes_on_in_one_round(record, change):
    assert sizes(change(record)) == [3]


@pytest.mark.parametrize("change", [delayed, shuffled, doubled, set_back])
def test_a_disorderly_record_goes_on_in_short_rounds(record, change):
    found = sizes(change(record))
    assert set(found) == {1}
    assert len(found) > 100


def test_stamps_that_are_receive_times_go_on_in_short_rounds(record):
    assert set(sizes(record, header=False)) == {1}


def test_no_sample_is_lost_or_moved_by_cutting(record):
    rows = delayed(record)
    stream = large_rounds.in_large_rounds(blocks_of(rows), TOPICS, hold_back_s=2.0, slice_s=0.7)
    parts = [block for blocks in stream for block in blocks]
    for whole in blocks_of(rows):
        mine = [p for p in parts if p.signal == whole.signal]
        assert np.array_equal(np.concatenate([p.stamp_ns for p in mine]), whole.stamp_ns)
        assert np.array_equal(np.concatenate([p.values for p in mine]), whole.values)
