# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Columns into bags: ours against rosbags' Writer, with the same compression."""

from __future__ import annotations

import tempfile
from pathlib import Path
from shutil import rmtree
from time import process_time
from typing import TYPE_CHECKING, Any

from valve_twin.bench.data.reading import TOPICS, leave_to_the_kernel, press_columns
from valve_twin.bench.measure import Ratio, Scale, median, require_equal
from valve_twin.io.bags.definitions import definition
from valve_twin.io.bags.read import BagWriter, read_columns
from valve_twin.io.cdr.signals import STAMPED_TYPE, SignalSource

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.types import FloatArray, IntArray

    Rows = list[tuple[str, IntArray, FloatArray]]


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    columns = press_columns(150_000 if scale.quick else 1_000_000)
    with tempfile.TemporaryDirectory() as folder:
        for name in ("zstd", "none"):
            yield _against_rosbags(name, Path(folder), columns, scale)


def _against_rosbags(name: str, folder: Path, columns: Rows, scale: Scale) -> Ratio:
    """Make the messages of columns, serialize and write them; both files hold the same."""
    ours, peer, compressed = folder / f"ours_{name}", folder / f"peer_{name}", name == "zstd"
    begin = process_time()
    _write_rosbags(peer, columns, compressed=compressed)
    peer_s = process_time() - begin
    ours_s = median(lambda: _write_ours(ours, columns, compressed=compressed), scale.repeats)
    sources = [SignalSource(topic, topic) for topic in TOPICS]
    for a, b in zip(read_columns(ours, sources), read_columns(peer, sources), strict=True):
        require_equal(a.values, b.values, "values written", "rosbags")
        require_equal(a.stamp_ns, b.stamp_ns, "stamps written", "rosbags")
    return Ratio(f"writing stamped scalars ({name})", "rosbags", ours_s, peer_s, 15.0)


def _write_ours(path: Path, columns: Rows, *, compressed: bool) -> None:
    rmtree(path, ignore_errors=True)
    with BagWriter(path, compressed=compressed, sync=leave_to_the_kernel) as bag:
        bag.write_samples(columns)


def _write_rosbags(path: Path, columns: Rows, *, compressed: bool) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(definition(STAMPED_TYPE).split("=" * 80)[0], STAMPED_TYPE))
    kinds: Any = store.types
    time, header = kinds["builtin_interfaces/msg/Time"], kinds["std_msgs/msg/Header"]
    stamped = kinds[STAMPED_TYPE]
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    if compressed:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    rows = [column.tolist() for _, _, column in columns]
    with writer:
        topics = [writer.add_connection(t, STAMPED_TYPE, typestore=store) for t in TOPICS]
        for n, stamp in enumerate(columns[0][1].tolist()):
            sec, nanosec = divmod(stamp, 1_000_000_000)
            head = header(time(sec, nanosec), "")
            for topic, values in zip(topics, rows, strict=True):
                data = store.serialize_cdr(stamped(head, values[n]), STAMPED_TYPE)
                writer.write(topic, stamp, data)
