# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Kill recorders at random times while they record, and hold the file against what was sent.

A publisher process notes when it sent what, and every recorder when it received what. Recorders
are forked from a process that has the imports behind it, so that a thousand of them are started in
minutes; each is a process of its own with its own middleware, as `ros2 run` starts it.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import struct
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from test.nodes import recorder_witness
from test.nodes.recorder_witness import RATE_HZ, TOPICS
from valve_twin.io.offline.recover import recover

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

LONGEST_S = 3600
PROMISE_NS = 1_000_000_000
START_S = 40.0
SPLIT_S = 0.3


@dataclass(frozen=True)
class Kill:
    """One killed recorder.

    Attributes
    ----------
    expected : int
        Messages sent more than a second before the kill, behind the first recorded one.
    missing : int
        Those of them that the file does not yield.
    received : int
        Messages that the recorder's middleware had more than a second before the kill.
    received_missing : int
        Those of them that the file does not yield.
    found : int
        Messages that the file yields.
    lost_s, received_lost_s : float
        Age at the kill of the oldest message that is lost, since it was sent, and of the oldest
        received one that is lost, since it was received [s].
    stood_s : float
        Time for which the recorder's loop had not turned at the kill [s].
    delivery_s, wait_s : (N,) array
        From sending to the recorder's middleware, and from there to the recorder [s].
    """

    expected: int
    missing: int
    received: int
    received_missing: int
    found: int
    lost_s: float
    received_lost_s: float
    stood_s: float
    delivery_s: NDArray[np.float64]
    wait_s: NDArray[np.float64]


class KillingField:
    """Publisher and mother of recorders in one domain."""

    def __init__(self, folder: Path, domain: int, *, heartbeat_s: float = 0.0) -> None:
        self._folder = folder
        self._count = 0
        self._seen = 0
        self._recorders: list[Recorder] = []
        environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
        }
        sent = folder / "sent"
        np.zeros(int(LONGEST_S * RATE_HZ), dtype="<i8").tofile(sent)
        self._sent = np.memmap(sent, dtype="<i8", mode="r")
        command = [sys.executable, recorder_witness.__file__]
        self._publisher = subprocess.Popen(
            [*command, "publish", str(sent), str(heartbeat_s)], env=environment
        )
        self._mother = subprocess.Popen(
            [*command, "fork"],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._line() == "ready"

    def _line(self) -> str:
        assert self._mother.stdout is not None
        return self._mother.stdout.readline().strip()

    def start(self) -> Recorder:
        """Start a recorder of all topics; every third begins a new file all the time."""
        assert self._mother.stdin is not None
        self._count += 1
        bag, log = self._folder / f"bag{self._count}", self._folder / f"log{self._count}"
        topics = ",".join(TOPICS)
        arguments = ["--ros-args", "-r", f"__ns:=/r{self._count}", "-p", f"bag:={bag}"]
        arguments += ["-p", f"topics:=[{topics}]"]
        if self._count % 3 == 0:
            arguments += ["-p", f"max_bag_duration:={SPLIT_S}"]
        arguments += ["-p", "start_type_description_service:=false"]
        notes = self._folder / f"notes{self._count}"
        self._mother.stdin.write("\t".join([str(log), str(notes), *arguments]) + "\n")
        self._mother.stdin.flush()
        made = Recorder(int(self._line()), bag, log, notes, time.monotonic() + START_S)
        self._recorders.append(made)
        return made

    def flows(self) -> bool:
        """Whether the publisher kept its pace in the last second, as on a machine that runs."""
        while self._sent[self._seen] > 0:
            self._seen += 1
        now, pace = time.time_ns(), int(0.8 * RATE_HZ)
        last = self._sent[max(self._seen - pace, 0) : self._seen]
        return bool(last.size == pace and now - last[0] <= PROMISE_NS)

    def judge(self, recorder: Recorder) -> Kill:
        """Read what a killed recorder left and hold it against what was sent."""
        whole = recorder.bag.with_name(f"{recorder.bag.name}_recovered")
        recover(recorder.bag, whole)
        found, plain = read_cut(whole), read_cut(recorder.bag)
        assert all(set(found.get(t, ())) >= set(numbers) for t, numbers in plain.items())
        shutil.rmtree(whole)
        sent = self._sent[: int(np.argmax(self._sent == 0))]
        notes = recorder_witness.read(recorder.notes)
        killed_ns, old_ns = recorder.killed_ns, recorder.killed_ns - PROMISE_NS
        ages, received_ages = [0], [0]
        expected = missing = received = received_missing = total = 0
        for number, topic in enumerate(TOPICS):
            counts = np.unique(np.array(found.get(topic, []), dtype=np.int64))
            assert counts.size, f"{topic}: nothing recorded\n{recorder.log.read_text()}"
            assert counts.size == len(found[topic]), f"{topic}: a message is there twice"
            given = notes.count[notes.topic == number]
            given_ns = notes.received_ns[notes.topic == number]
            assert np.isin(counts, given).all(), f"{topic}: recorded and never received"
            kept = np.isin(given, counts)
            wanted = np.arange(given.min(), sent.size)
            wanted = wanted[sent[wanted] <= killed_ns]
            lost = sent[np.setdiff1d(wanted, counts)]
            expected += int((sent[wanted] <= old_ns).sum())
            missing += int((lost <= old_ns).sum())
            received += int((given_ns <= old_ns).sum())
            received_missing += int((given_ns[~kept] <= old_ns).sum())
            total += counts.size
            ages.extend((killed_ns - lost).tolist())
            received_ages.extend((killed_ns - given_ns[~kept]).tolist())
        there = notes.count < sent.size
        return Kill(
            expected,
            missing,
            received,
            received_missing,
            total,
            max(ages) * 1e-9,
            max(received_ages) * 1e-9,
            (killed_ns - notes.turned_ns) * 1e-9,
            1e-9 * (notes.received_ns[there] - sent[notes.count[there]]).astype(np.float64),
            1e-9 * (notes.taken_ns - notes.received_ns).astype(np.float64),
        )

    def examine(self, recorder: Recorder) -> str:
        """Say what a recorder does that was given nothing; that it was is checked."""
        with suppress(ProcessLookupError):
            os.kill(recorder.pid, signal.SIGUSR1)
        deadline = time.monotonic() + 2.0
        while "Thread" not in recorder.log.read_text() and time.monotonic() < deadline:
            time.sleep(0.05)
        notes = recorder_witness.read(recorder.notes)
        files = [(f.name, f.stat().st_size) for f in recorder.bag.glob("*")]
        turned_s = (time.time_ns() - notes.turned_ns) * 1e-9
        old = notes.topic[notes.received_ns <= time.time_ns() - PROMISE_NS]
        told = (
            f"recorder {recorder.pid}: {notes.count.size} messages received, loop turned "
            f"{turned_s:.1f} s ago, {files}\n{recorder.log.read_text()}"
        )
        assert set(old.tolist()) < set(range(len(TOPICS))), told
        return told

    def close(self) -> None:
        """End all processes."""
        for process in (self._publisher, self._mother):
            process.kill()
            process.wait(10)
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()
        for recorder in self._recorders:
            if not recorder.killed_ns:
                recorder.kill()


@dataclass
class Recorder:
    """A recorder process with its bag, and when it has to have begun [s]."""

    pid: int
    bag: Path
    log: Path
    notes: Path
    begin_by: float
    kill_at: float = 0.0
    killed_ns: int = 0
    seen: int = 0

    def records(self) -> bool:
        """Whether messages of every topic stand in the file."""
        size = sum(f.stat().st_size for f in self.bag.glob("*.mcap"))
        if size == self.seen:
            return False
        self.seen = size
        return set(read_cut(self.bag)) == set(TOPICS)

    def kill(self) -> None:
        """Kill it, and note when."""
        self.killed_ns = time.time_ns()
        os.kill(self.pid, signal.SIGKILL)

    def is_gone(self) -> bool:
        """Whether the process is no more."""
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return True
        return False


def read_cut(bag: Path) -> dict[str, list[int]]:
    """Read the counts of every topic out of files that end anywhere, with another reader."""
    found: dict[str, list[int]] = {}
    for path in bag.glob("*.mcap"):
        names: dict[int, str] = {}
        with path.open("rb") as stream, suppress(McapError, EOFError, struct.error):
            for record in StreamReader(stream, validate_crcs=True).records:
                if isinstance(record, Channel):
                    names[record.id] = record.topic
                elif isinstance(record, Message):
                    value = np.frombuffer(record.data[-8:], dtype="<f8")[0]
                    found.setdefault(names[record.channel_id], []).append(int(value))
    return found


def kill_many(
    field: KillingField, kills: int, at_once: int, seed: int
) -> tuple[list[Kill], list[str]]:
    """Start and kill recorders, some at once, each at a random time after it began.

    A kill is put off while the publisher itself does not keep its pace: where the whole machine
    stands still, the age of a message says nothing about the recorder.

    Returns
    -------
    list of Kill
        What every killed recorder left.
    list of str
        What those did to which the middleware gave nothing of one topic at least in `START_S`; a
        recorder that was given messages of all and wrote none fails the campaign.
    """
    choose = random.Random(seed)
    running: list[Recorder] = []
    dying: list[Recorder] = []
    deaf: list[str] = []
    results: list[Kill] = []
    started = 0
    while len(results) + len(deaf) < kills:
        while len(running) < at_once and started < kills:
            running.append(field.start())
            started += 1
        for recorder in list(running):
            if not recorder.kill_at:
                if recorder.records():
                    recorder.kill_at = time.monotonic() + choose.uniform(1.0, 3.0)
                elif time.monotonic() > recorder.begin_by:
                    deaf.append(field.examine(recorder))
                    recorder.kill()
                    running.remove(recorder)
            elif time.monotonic() >= recorder.kill_at and field.flows():
                recorder.kill()
                running.remove(recorder)
                dying.append(recorder)
        for recorder in [r for r in dying if r.is_gone()]:
            dying.remove(recorder)
            results.append(field.judge(recorder))
            for path in (*recorder.bag.iterdir(), recorder.log, recorder.notes):
                path.unlink()
        time.sleep(0.01)
    return results, deaf
