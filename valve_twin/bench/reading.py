# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bags into columns against rosbags."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.bench.measure import Ratio, Scale, median, require_equal
from valve_twin.io.bags import BagWriter, read_signals
from valve_twin.io.mapping import SignalSource

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.types import FloatArray


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    yield _bag_reading(100_000 if scale.quick else 1_000_000, scale.repeats)


def _bag_reading(messages: int, repeats: int) -> Ratio:
    """Read a bag of stamped scalars into columns: ours against rosbags' AnyReader."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        values = np.random.default_rng(1).normal(size=messages)
        with BagWriter(path) as bag:
            for n, value in enumerate(values.tolist()):
                bag.write_sample("/position", 10**18 + n * 30_000_000, value)
        require_equal(_read_ours(path), _read_rosbags(path), "values", "rosbags")
        return Ratio(
            f"reading {messages} messages into columns",
            "rosbags",
            median(lambda: _read_ours(path), repeats),
            median(lambda: _read_rosbags(path), max(3, repeats // 5)),
            20.0,
        )


def _read_ours(path: Path) -> FloatArray:
    blocks = read_signals(path, [SignalSource("position", "/position")])
    return np.concatenate([b.values for b in blocks])


def _read_rosbags(path: Path) -> FloatArray:
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        found = [
            reader.deserialize(raw, connection.msgtype).value  # type: ignore[attr-defined]
            for connection, _, raw in reader.messages()
        ]
    return np.array(found)
