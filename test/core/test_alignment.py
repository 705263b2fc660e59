# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Merging signals by stamp: independent of the order of delivery, honest about what is late."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from valve_twin.core.alignment import Aligner, SignalRange
from valve_twin.core.types import Frames, join_frames

SIGNALS = (
    SignalRange("position", -0.1, 1.1),
    SignalRange("v_in", 0.0, 1.0),
    SignalRange("v_out", 0.0, 1.0),
)
MS = 10**6


def make_aligner(**kwargs):
    return Aligner(SIGNALS, **kwargs)


def stream(n=60):
    """Position every 30 ms, commands every 10 ms, with values that tell their stamp."""
    position = (np.arange(n, dtype=np.int64) * 30 * MS, np.linspace(0.0, 1.0, n))
    fast = np.arange(3 * n, dtype=np.int64) * 10 * MS
    return {
        "position": position,
        "v_in": (fast, fast / fast[-1]),
        "v_out": (fast + 2 * MS, 1.0 - fast / fast[-1]),
    }


def deliver(aligner, messages):
    frames = [f for name, t, v in messages if (f := aligner.push(name, t, v)) is not None]
    last = aligner.flush()
    return join_frames([*frames, *([last] if last is not None else [])])


def whole(data):
    return deliver(make_aligner(), [(k, t, v) for k, (t, v) in data.items()])


def same(a, b):
    return all(
        np.array_equal(getattr(a, k), getattr(b, k), equal_nan=True)
        for k in Frames.__slots__
        if k != "conditions"
    )


def test_a_frame_holds_the_last_command_at_or_before_its_stamp():
    data = stream()
    frames = whole(data)
    t, v = data["v_out"]
    expected = [np.nan if s < t[0] else v[t <= s][-1] for s in data["position"][0]]
    assert np.array_equal(frames.inputs[:, 1], expected, equal_nan=True)
    assert np.array_equal(frames.inputs[:, 0], data["v_in"][1][::3])
    assert not frames.valid[0]
    assert frames.valid[1:].all()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_the_order_of_delivery_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    data = stream()
    queues = {}
    for name, (t, v) in data.items():
        edges = np.unique(np.concatenate(([0, len(t)], rng.integers(0, len(t), 20))))
        pairs = itertools.pairwise(edges)
        queues[name] = [(name, t[a:b], v[a:b]) for a, b in pairs]
    messages = []
    while any(queues.values()):
        name = rng.choice([k for k, q in queues.items() if q])
        messages.append(queues[name].pop(0))
    assert same(deliver(make_aligner(hold_back_s=1e3), messages), whole(data))


def test_a_silent_command_holds_the_position_back_no_longer_than_told():
    aligner = make_aligner(hold_back_s=0.1)
    zero = np.zeros(1, dtype=np.int64)
    aligner.push("v_in", zero, np.array([0.5]))
    aligner.push("v_out", zero, np.array([0.0]))
    stamps = np.arange(20, dtype=np.int64) * 30 * MS
    frames = aligner.push("position", stamps, np.full(20, 0.3))
    assert frames is not None
    assert stamps[-1] - frames.stamp_ns[-1] == pytest.approx(0.1e9, abs=30 * MS)
    assert (frames.inputs[:, 0] == 0.5).all()


def test_a_command_that_comes_after_its_frame_is_counted():
    aligner = make_aligner(hold_back_s=0.1)
    stamps = np.arange(20, dtype=np.int64) * 30 * MS
    for name in ("v_in", "v_out"):
        aligner.push(name, stamps[:1], np.array([0.0]))
    aligner.push("position", stamps, np.full(20, 0.3))
    assert not aligner.late
    aligner.push("v_in", stamps[5:7], np.array([0.1, 0.2]))
    assert aligner.late == {"v_in"}
    assert aligner.counts()["v_in"].late == 2


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1.5])
def test_a_value_that_cannot_be_believed_marks_its_frame(bad):
    data = stream()
    data["position"][1][7] = bad
    aligner = make_aligner()
    frames = deliver(aligner, [(k, t, v) for k, (t, v) in data.items()])
    assert np.flatnonzero(~frames.valid).tolist() == [0, 7]
    assert np.isfinite(frames.position[7]) == np.isfinite(bad)
    assert aligner.counts()["position"].bad == 1


def test_a_frame_before_the_first_value_of_a_command_is_no_bad_value_of_it():
    data = stream()
    stamps, values = data["v_in"]
    data["v_in"] = (stamps[30:], np.zeros(len(values) - 30))
    aligner = make_aligner()
    frames = deliver(aligner, [(k, t, v) for k, (t, v) in data.items()])
    assert np.count_nonzero(~frames.valid) == 10
    assert [c.bad for c in aligner.counts().values()] == [0, 0, 0]


def test_a_value_that_is_none_stays_bad_until_the_next():
    data = stream()
    data["v_in"] = (data["v_in"][0][[0, 30]], np.array([np.nan, 0.0]))
    aligner = make_aligner()
    deliver(aligner, [(k, t, v) for k, (t, v) in data.items()])
    assert aligner.counts()["v_in"].bad == 10


def test_duplicate_and_late_samples_are_dropped_and_counted():
    data = stream()
    t, v = data["position"]
    order = np.concatenate([np.arange(10), [9, 4], np.arange(10, len(t))])
    aligner = make_aligner()
    messages = [
        ("position", t[order], v[order]),
        ("v_in", *data["v_in"]),
        ("v_out", *data["v_out"]),
    ]
    assert same(deliver(aligner, messages), whole(data))
    counts = aligner.counts()["position"]
    assert (counts.received, counts.duplicate, counts.late) == (62, 1, 1)


def test_one_old_sample_is_no_clock_jump_three_are():
    aligner = make_aligner()
    late = np.array([10**12], dtype=np.int64)
    aligner.push("position", late, np.zeros(1))
    for k in range(2):
        aligner.push("position", np.array([k * 30 * MS], dtype=np.int64), np.zeros(1))
    assert aligner.jumps == 0
    aligner.push("position", np.array([60 * MS], dtype=np.int64), np.zeros(1))
    assert aligner.jumps == 1
    stamps = np.arange(3, 6, dtype=np.int64) * 30 * MS
    messages = [(name, stamps, np.zeros(3)) for name in ("v_in", "v_out", "position")]
    assert deliver(aligner, messages).stamp_ns.tolist() == [60 * MS, *stamps.tolist()]


def test_counter_and_reference_ride_along():
    aligner = make_aligner(
        counter=SignalRange("cycle_counter"), reference=SignalRange("reference")
    )
    stamps = np.arange(4, dtype=np.int64) * 30 * MS
    for name in ("v_in", "v_out", "reference"):
        aligner.push(name, stamps, np.full(4, 0.25))
    aligner.push("cycle_counter", stamps[:4:3], np.array([3.0, 4.0]))
    frames = aligner.push("position", stamps, np.zeros(4))
    assert frames is not None
    assert frames.counter.tolist() == [3.0, 3.0, 3.0, 4.0]
    assert frames.reference.tolist() == [0.25] * 4


def test_conditions_are_held_and_spoil_no_frame():
    aligner = make_aligner(
        conditions=(SignalRange("temperature", 0.0, 100.0), SignalRange("supply_pressure"))
    )
    stamps = np.arange(4, dtype=np.int64) * 30 * MS
    for name in ("v_in", "v_out"):
        aligner.push(name, stamps, np.full(4, 0.25))
    aligner.push("temperature", stamps, np.array([20.0, 21.0, np.nan, 900.0]))
    aligner.push("supply_pressure", stamps[1:], np.array([2e7, 2.1e7, 2.2e7]))
    frames = aligner.push("position", stamps, np.zeros(4))
    assert frames is not None
    assert frames.valid.all()
    assert frames.conditions is not None
    pressure, load, temperature = frames.conditions.T
    np.testing.assert_array_equal(pressure, [np.nan, 2e7, 2.1e7, 2.2e7])
    assert np.isnan(load).all()
    np.testing.assert_array_equal(temperature, [20.0, 21.0, np.nan, np.nan])
    joined = join_frames([frames[:1], replace(frames[1:3], conditions=None), frames[3:]])
    assert joined.conditions is not None
    np.testing.assert_array_equal(joined.conditions[:, 0], [np.nan, np.nan, np.nan, 2.2e7])


def test_without_conditions_there_is_no_column_for_them():
    aligner = make_aligner()
    stamps = np.arange(3, dtype=np.int64) * 30 * MS
    for name in ("v_in", "v_out"):
        aligner.push(name, stamps, np.zeros(3))
    frames = aligner.push("position", stamps, np.zeros(3))
    assert frames is not None
    assert frames.conditions is None
    assert join_frames([frames[:1], frames[1:]]).conditions is None
