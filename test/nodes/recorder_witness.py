# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The processes of the kill campaign: a publisher, and recorders that note what they received.

Run as a program it is the publisher, or the mother that forks recorders. The notes of a recorder
are a shared mapping of a file: a store into it is the kernel's at once, also the last one before
SIGKILL. They tell what a recorder was given from what was still on its way to it.
"""

from __future__ import annotations

import faulthandler
import mmap
import os
import signal
import struct
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

TOPICS = ("/fast/a", "/fast/b", "/fast/c")
RATE_HZ = 200.0

ROWS = 200_000
"""Messages that fit [1]; the file has holes where none was noted."""

STATE_S = 2.0
"""Pause between two lines about the state of the recorder in its log [s]."""

_ROW = struct.Struct("<4q")


def publish_until_killed(path: str, heartbeat_s: float) -> None:
    """Publish a count on every topic and note when each was sent (publisher process).

    Lost messages are asked for with every heartbeat; 0 leaves the middleware its own 3 s.
    """
    import rclpy
    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from valve_twin_msgs.msg import Float64Stamped

    from valve_twin.io.cdr.codec import encode_stamped
    from valve_twin.nodes.runtime.transport import profile

    if heartbeat_s:
        profile.HEARTBEAT_S = heartbeat_s
        profile.use_fast_heartbeat()
    sent = np.memmap(path, dtype="<i8", mode="r+")
    rclpy.init()
    node = Node("publisher", start_parameter_services=False)
    publishers = [node.create_publisher(Float64Stamped, t, QoSProfile(depth=2000)) for t in TOPICS]
    begin = time.monotonic()
    for i in range(len(sent)):
        time.sleep(max(begin + i / RATE_HZ - time.monotonic(), 0.0))
        for publisher in publishers:
            publisher.publish(encode_stamped(time.time_ns(), float(i)))
        sent[i] = time.time_ns()  # all three are with the middleware


def fork_recorders() -> None:
    """Fork a recorder a line of stdin: log and notes, then its arguments (mother process)."""
    import valve_twin.nodes.recorder.node  # noqa: F401
    from valve_twin.nodes.runtime import executables

    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    for line in sys.stdin:
        log, notes, *arguments = line.rstrip("\n").split("\t")
        pid = os.fork()
        if pid == 0:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            number = os.open(log, os.O_WRONLY | os.O_CREAT, 0o644)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.dup2(number, 1)
            os.dup2(number, 2)
            install(Path(notes))
            sys.argv = ["bag_recorder", *arguments]
            executables.run("bag_recorder")
        sys.stdout.write(f"{pid}\n")
        sys.stdout.flush()


def install(path: Path) -> None:
    """Have the recorder of this process note every message and every turn of its loop."""
    from valve_twin.nodes.recorder.node import BagRecorderNode

    size = (ROWS + 1) * _ROW.size
    with path.open("w+b") as stream:
        stream.truncate(size)
        notes = mmap.mmap(stream.fileno(), size)
    numbers = {topic: i for i, topic in enumerate(TOPICS)}
    take, work = BagRecorderNode._on_message, BagRecorderNode.work
    row, told_s = 1, time.monotonic()

    def noted_take(self: Any, message: Any, topic: Any) -> None:
        nonlocal row
        count = int(struct.unpack_from("<d", message.data, len(message.data) - 8)[0])
        if row <= ROWS:
            _ROW.pack_into(
                notes,
                row * _ROW.size,
                numbers[message.topic] + 1,
                count,
                message.log_ns,
                time.time_ns(),
            )
            row += 1
        take(self, message, topic)

    def noted_work(self: Any) -> None:
        nonlocal told_s
        now_s = time.monotonic()
        _ROW.pack_into(notes, 0, time.time_ns(), 0, 0, 0)
        if now_s - told_s >= STATE_S:
            told_s = now_s
            sys.stderr.write(_state(self, row - 1))
            sys.stderr.flush()
        work(self)

    BagRecorderNode._on_message = noted_take  # type: ignore[method-assign]
    BagRecorderNode.work = noted_work  # type: ignore[method-assign]
    faulthandler.register(signal.SIGUSR1, all_threads=True)


def _state(node: Any, received: int) -> str:
    """Say in one line what the recorder sees and does."""
    matched = {
        name: (node.count_publishers(name), topic._subscription.handle.get_publisher_count())
        for name, topic in node._topics.items()
        if topic._subscription is not None
    }
    disk = node._disk
    queue = None if disk is None else (len(disk), disk._busy, disk._thread.waiting)
    recording = node._recording
    counts, trouble = ({}, "") if recording is None else (recording.counts, recording.trouble)
    return (
        f"state {node.state}, received {received}, (publishers, matched) {matched}, "
        f"(queued, busy, orders) {queue}, written {counts}, trouble '{trouble}'\n"
    )


@dataclass(frozen=True)
class Notes:
    """What a recorder noted.

    Attributes
    ----------
    topic, count : (N,) int64 array
        Number of the topic and count in the message.
    received_ns, taken_ns : (N,) int64 array
        When the middleware had the message and when the recorder took it [ns].
    turned_ns : int
        When its loop turned last [ns].
    """

    topic: NDArray[np.int64]
    count: NDArray[np.int64]
    received_ns: NDArray[np.int64]
    taken_ns: NDArray[np.int64]
    turned_ns: int


def read(path: Path) -> Notes:
    """Read the notes of a recorder, also of one that lives."""
    if not path.exists():
        empty = np.empty(0, dtype=np.int64)
        return Notes(empty, empty, empty, empty, 0)
    table = np.memmap(path, dtype="<i8", mode="r").reshape(-1, 4)
    rows = np.array(table[1 : 1 + int(np.argmax(table[1:, 3] == 0))])
    return Notes(rows[:, 0] - 1, rows[:, 1], rows[:, 2], rows[:, 3], int(table[0, 0]))


if __name__ == "__main__":
    if sys.argv[1] == "publish":
        publish_until_killed(sys.argv[2], float(sys.argv[3]))
    else:
        fork_recorders()
