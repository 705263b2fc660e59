# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bags into columns: ours against rosbags' AnyReader and against a compiled reader."""

from __future__ import annotations

import statistics
import tempfile
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.bench.measure import Ratio, Scale, median, require_equal
from valve_twin.core.simulation import SimulatedValve
from valve_twin.core.valves.registry import get_simulation
from valve_twin.io.bags.read import BagWriter, read_columns
from valve_twin.io.cdr.codec import encode_series, encode_stamped
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE, SignalSource

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from valve_twin.core.types import FloatArray, IntArray

TOPICS = ("/command/v_in", "/command/v_out", "/position")
_JOINTS = "sensor_msgs/msg/JointState"
_START_NS = 1_600_000_000_000_000_000
_FRAMES = ("", "valve_1", "press/valve_12", "a frame with a long name", "v")
_COMPILED_READER = "baglab_mcap_backend"


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    messages = 240_000 if scale.quick else 1_000_000
    with tempfile.TemporaryDirectory() as folder:
        columns = press_columns(messages)
        for name, goal in (("zstd", 65.0), ("none", 100.0)):
            path = Path(folder) / name
            with BagWriter(
                path, compressed=name == "zstd", flush_s=1e9, sync=leave_to_the_kernel
            ) as bag:
                bag.write_samples(columns)
            yield _against_rosbags(f"stamped scalars ({name})", path, _scalars(), scale, goal)
            if find_spec(_COMPILED_READER) is not None:
                yield _against_compiled(f"stamped scalars ({name})", path, scale)
        few = messages // 4
        for kind, write in _VARYING.items():
            path = Path(folder) / write.__name__
            sources = write(path, few)
            yield _against_rosbags(kind, path, sources, scale, 40.0)


def leave_to_the_kernel(_: int) -> None:
    """Leave a file to the kernel: the disk is not what is measured."""


def press_columns(messages: int) -> list[tuple[str, IntArray, FloatArray]]:
    """Return topics, stamps and values of what a press valve shows in production.

    Parameters
    ----------
    messages : int
        Samples of all three topics together [1].
    """
    samples = messages // len(TOPICS)
    config = get_simulation("press_cartridge")
    valve = SimulatedValve(config, seed=1)
    block = valve.advance(samples)
    stamps = _START_NS + round(config.period_s * 1e9) * np.arange(samples)
    values = (block.inputs[:, 0], block.inputs[:, 1], block.position)
    return [(topic, stamps, column) for topic, column in zip(TOPICS, values, strict=True)]


def _scalars() -> list[SignalSource]:
    return [SignalSource(topic.strip("/").replace("/", "_"), topic) for topic in TOPICS]


def _frames_of_varying_length(path: Path, messages: int) -> list[SignalSource]:
    frames = np.random.default_rng(1).integers(0, len(_FRAMES), messages).tolist()
    with BagWriter(path, flush_s=1e9, sync=leave_to_the_kernel) as bag:
        bag.add_topic(TOPICS[-1], STAMPED_TYPE)
        for n, frame in enumerate(frames):
            stamp = _START_NS + n * 30_000_000
            data = encode_stamped(stamp, 1e-3 * n, _FRAMES[frame])
            bag.write(TOPICS[-1], data, log_ns=stamp)
    return _scalars()[-1:]


def _batches_of_varying_length(path: Path, messages: int) -> list[SignalSource]:
    rng = np.random.default_rng(1)
    counts, values = rng.integers(1, 11, messages).tolist(), rng.normal(size=64)
    with BagWriter(path, flush_s=1e9, sync=leave_to_the_kernel) as bag:
        bag.add_topic(TOPICS[-1], SERIES_TYPE)
        for n, count in enumerate(counts):
            stamp = _START_NS + n * 1_000_000_000
            data = encode_series(stamp, 0.03, values[:count])
            bag.write(TOPICS[-1], data, log_ns=stamp)
    return [SignalSource("position", TOPICS[-1], SERIES_TYPE, "values[]")]


def _joints_of_varying_number(path: Path, messages: int) -> list[SignalSource]:
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    time, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    text, _ = store.generate_msgdef(_JOINTS, ros_version=2)
    names = [f"joint_{n}" for n in range(8)]
    counts = np.random.default_rng(1).integers(3, 9, messages).tolist()
    with BagWriter(path, flush_s=1e9, sync=leave_to_the_kernel) as bag:
        bag.add_topic("/joints", _JOINTS, message_definition=text, definition_hash="")
        for n, count in enumerate(counts):
            sec, nanosec = divmod(_START_NS + n * 1_000_000, 1_000_000_000)
            values = 1e-3 * n + np.arange(float(count))
            state = store.types[_JOINTS](
                header(time(sec, nanosec), "base"), names[:count], values, values, values
            )
            data = bytes(store.serialize_cdr(state, _JOINTS))
            bag.write("/joints", data, log_ns=_START_NS + n * 1_000_000)
    return [SignalSource("position", "/joints", _JOINTS, "position[2]")]


_VARYING: dict[str, Callable[[Path, int], list[SignalSource]]] = {
    "scalars with frames of varying length": _frames_of_varying_length,
    "batches of 1 to 10 samples": _batches_of_varying_length,
    "3 to 8 joints": _joints_of_varying_number,
}


def _against_rosbags(
    what: str, path: Path, sources: list[SignalSource], scale: Scale, goal: float
) -> Ratio:
    """Read with AnyReader, deserialize and take stamp and value of each message."""
    ours = read_columns(path, sources)
    times = []
    for _ in range(1 if scale.quick else 3):
        begin = process_time()
        peer = _read_rosbags(path, sources)
        times.append(process_time() - begin)
    for source, column in zip(sources, ours, strict=True):
        stamps, values = peer[source.topic]
        require_equal(column.values, values, "values", "rosbags")
        begins = np.unique(column.log_ns) if source.batched else column.stamp_ns
        require_equal(begins - _START_NS, stamps - _START_NS, "stamps", "rosbags")
    ours_s = median(lambda: read_columns(path, sources), scale.repeats)
    return Ratio(f"reading {what}", "rosbags", ours_s, statistics.median(times), goal)


def _read_rosbags(
    path: Path, sources: list[SignalSource]
) -> dict[str, tuple[IntArray, FloatArray]]:
    from rosbags.highlevel import AnyReader

    found: dict[str, tuple[list[int], list[Any]]] = {s.topic: ([], []) for s in sources}
    kind = sources[0].type
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            stamps, values = found[connection.topic]
            stamp = message.header.stamp
            stamps.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
            if kind == STAMPED_TYPE:
                values.append(message.value)
            elif kind == SERIES_TYPE:
                values.append(message.values)
            else:
                values.append(message.position[2])
    join: Callable[[Any], FloatArray] = np.concatenate if kind == SERIES_TYPE else np.array
    return {topic: (np.array(s), join(v)) for topic, (s, v) in found.items()}


def _against_compiled(what: str, path: Path, scale: Scale) -> Ratio:
    """Read with baglab's C++ reader, all topics in one pass, only the fields that we read."""
    sources = _scalars()
    ours, peer = read_columns(path, sources), _read_compiled(path)
    for source, column in zip(sources, ours, strict=True):
        found = peer[source.topic]
        require_equal(column.values, found["value"], "values", "baglab")
        stamps = found["header.stamp.sec"].astype(np.int64) * 1_000_000_000
        stamps += found["header.stamp.nanosec"]
        require_equal(column.stamp_ns - _START_NS, stamps - _START_NS, "stamps", "baglab")
    return Ratio(
        f"columns of {what}",
        "baglab (C++)",
        median(lambda: read_columns(path, sources), scale.repeats),
        median(lambda: _read_compiled(path), scale.repeats),
        5.0,
    )


def _read_compiled(path: Path) -> dict[str, dict[str, Any]]:
    reader = import_module(_COMPILED_READER).BagReader(str(next(path.glob("*.mcap"))))
    fields = ["header.stamp.sec", "header.stamp.nanosec", "value"]
    found: dict[str, dict[str, Any]] = reader.read_topics(
        list(TOPICS), dict.fromkeys(TOPICS, fields)
    )
    reader.close()
    return found
