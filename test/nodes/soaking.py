# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A soak: one twin process hosts many valves, fed faster than real time, its memory is watched.

Run as a program it is one of the two processes that a test starts: the plant, or the twin that
also writes down how much Python holds when it gets SIGUSR1.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import sqlalchemy as sa
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from scipy.stats import theilslopes

from valve_twin.core.simulation import simulate_cycles
from valve_twin.core.valves.registry import get_simulation
from valve_twin.io.history import tables as history_tables
from valve_twin.io.history.check_sums import sealed
from valve_twin.io.history.store import History, cycle_record
from valve_twin.nodes.player.outbox import SubscriberGate

if TYPE_CHECKING:
    from collections.abc import Callable

REARM = {"cycles.rearm_signal": "v_out"}
TOPICS = ("command/v_in", "command/v_out", "spool_position")
PERIOD_S = 0.03
CYCLE = 850
HELD = 52
"""Cycles of every valve in the history at the start: what a twin remembers is then full."""

NS = "/plant"


def valve_names(count: int) -> list[str]:
    return [f"valve_{i + 1:02d}" for i in range(count)]


@dataclasses.dataclass
class Round:
    """What was seen when one more cycle of every valve was done."""

    stored: int
    lost: int
    rss_mb: float
    blocks: float


@dataclasses.dataclass
class Result:
    """What was seen after the warm-up."""

    valves: int
    rate: float
    batch: int
    seconds: float
    sent: int
    predicted: int
    stored: int
    expected: int
    lost: int
    pending: int
    rss_mb: list[tuple[float, float]]
    worker_mb: list[tuple[float, float]]
    blocks: list[tuple[float, float]]
    cpu: float
    most_waiting: int
    """Most estimations that waited at a time: 110 kB each, so that a growth can be told apart."""
    most_on_disk: int
    """Most of them that waited on disk at a time."""
    longest_ms: float
    """Longest way of a sample that the diagnostics looked at told of [ms]."""
    dropped: int
    """Cycles that were dropped before their estimation."""
    caught_up_s: float
    """From the last sample until all was estimated and stored [s]."""

    def slope(self, series: str, after_s: float) -> tuple[float, float, float]:
        """Return Theil-Sen slope and its 95 % limits, in units in 10 min."""
        points = np.array([p for p in getattr(self, series) if p[0] >= after_s])
        slope, _, low, high = theilslopes(points[:, 1], points[:, 0])
        return 600.0 * slope, 600.0 * low, 600.0 * high


class Soak:
    """Twin and plant in processes of their own, in the graph of a test."""

    def __init__(
        self,
        graph,
        folder: Path,
        *,
        valves: int,
        rate: float,
        batch: int,
        model: str = "press_cartridge",
    ) -> None:
        self.graph, self.valves, self.rate, self.batch = graph, valves, rate, batch
        self.counts = folder / "counts.jsonl"
        self.database = folder / "history.sqlite"
        fill(self.database, valves)
        self.diagnostics = graph.record("/diagnostics", DiagnosticArray)
        self._newest: dict[str, dict[str, str]] = {}
        parameters = {
            "valves": valve_names(valves),
            "model": model,
            "history_url": f"sqlite:///{self.database}",
            **REARM,
        }
        if batch > 1:
            parameters |= {
                f"signals.{name}.type": "valve_twin_msgs/msg/Float64Series"
                for name in ("v_in", "v_out", "spool_position")
            }
        content = {"/**": {"ros__parameters": parameters}}
        (folder / "twin.yaml").write_text(yaml.safe_dump(content))
        self.environment = {**os.environ, "ROS_DOMAIN_ID": str(graph.domain)}
        ros = ["--ros-args", "-r", f"__ns:={NS}", "--params-file", str(folder / "twin.yaml")]
        self.log = folder / "twin.log"
        self.twin = self._start("twin", [str(self.counts), *ros], self.log)
        self.plant: subprocess.Popen[str] | None = None
        graph.spin_until(lambda: len(self.figures()) == valves, 120.0, "the twin's diagnostics")

    def _start(self, what: str, arguments: list[str], log: Path) -> subprocess.Popen[str]:
        command = [sys.executable, __file__, what, *arguments]
        with log.open("wb") as out:
            return subprocess.Popen(
                command,
                env=self.environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE if what == "plant" else out,
                stderr=out,
                text=True,
            )

    def run(
        self,
        seconds: float,
        every_s: float = 0.5,
        folder: Path = Path(),
        *,
        left_s: float = 300.0,
        look: Callable[[float], object] = lambda _: None,
        over: Callable[[], object] = lambda: None,
    ) -> Result:
        """Let the plant run and watch the twin; call `look` meanwhile, `over` at its end."""
        arguments = [str(x) for x in (self.valves, self.rate, self.batch, seconds)]
        self.plant = self._start("plant", arguments, folder / "plant.log")
        series: dict[str, list[tuple[float, float]]] = {"rss": [], "worker": [], "blocks": []}
        cpu, begin, longest = cpu_s(self.twin.pid), time.monotonic(), 0.0
        waiting = on_disk = 0
        while self.plant.poll() is None:
            self.graph.spin(every_s)
            figures = self.figures()
            waiting = max(waiting, sum(int(f["estimations pending"]) for f in figures))
            on_disk = max(on_disk, sum(int(f["cycles waiting on disk"]) for f in figures))
            longest = max([longest, *(float(f["worst latency [ms]"]) for f in figures)])
            if self.twin.poll() is not None:
                raise AssertionError(self.log.read_text()[-3000:])
            now = time.monotonic() - begin
            look(now)
            series["rss"].append((now, rss_mb(self.twin.pid)))
            series["worker"] += [(now, rss_mb(p)) for p in children(self.twin.pid)[:1]]
            os.kill(self.twin.pid, signal.SIGUSR1)
            series["blocks"] += [(now, b) for b in self._blocks()[-1:]]
        cpu = (cpu_s(self.twin.pid) - cpu) / (time.monotonic() - begin)
        assert self.plant.stdout is not None
        said = self.plant.stdout.read()
        assert self.plant.returncode == 0, (folder / "plant.log").read_text()[-3000:]
        sent = int(json.loads(said)["samples"])
        expected = self.valves * max(sent // CYCLE - 2, 0)  # the first is not seen as a whole
        over()
        begin = time.monotonic()
        self._wait(sent * self.valves, expected, left_s)
        figures = self.figures()
        return Result(
            self.valves, self.rate, self.batch, seconds, sent * self.valves,
            sum(int(f["samples predicted"]) for f in figures),
            sum(int(f["cycles stored"]) for f in figures), expected,
            sum(int(v.split("/")[1]) for f in figures for k, v in f.items() if "/lost" in k),
            sum(int(f["estimations pending"]) for f in figures),
            series["rss"], series["worker"], series["blocks"], cpu, waiting, on_disk, longest,
            sum(int(f["cycles dropped before estimation"]) for f in figures),
            time.monotonic() - begin,
        )  # fmt: skip

    def rounds(self, count: int, folder: Path) -> list[Round]:
        """Let the plant make one cycle at a time and look at the twin when all is done."""
        arguments = [str(x) for x in (self.valves, self.rate, self.batch, 0)]
        self.plant = plant = self._start("plant", arguments, folder / "plant.log")
        assert plant.stdin is not None
        assert plant.stdout is not None
        found: list[Round] = []
        for _ in range(count):
            assert plant.stdout.readline(), (folder / "plant.log").read_text()[-3000:]
            plant.stdin.write("go\n")
            plant.stdin.flush()
            sent = (len(found) + 1) * CYCLE * self.valves
            self.graph.spin_until(lambda n=sent: self.is_quiet(n), 240.0, "a quiet twin")
            figures = self.figures()
            lines = len(self._blocks())
            os.kill(self.twin.pid, signal.SIGUSR1)
            self.graph.spin_until(lambda n=lines: len(self._blocks()) > n, 120.0, "its blocks")
            lost = (v for f in figures for k, v in f.items() if "/lost" in k)
            found.append(
                Round(
                    sum(int(f["cycles stored"]) for f in figures),
                    sum(int(v.split("/")[1]) for v in lost),
                    rss_mb(self.twin.pid),
                    self._blocks()[-1],
                )
            )
        return found

    def send(self, cycles: int) -> None:
        """Let the plant that `rounds` started publish so many cycles more, without a look."""
        plant = self.plant
        assert plant is not None
        assert plant.stdin is not None
        assert plant.stdout is not None
        for _ in range(cycles):
            plant.stdin.write("go\n")
            plant.stdin.flush()
            assert plant.stdout.readline()

    def is_quiet(self, sent: int) -> bool:
        """Return whether all that was sent is predicted, estimated and stored."""
        figures = self.figures()
        waiting = ("estimations pending", "cycles unsaved")
        if len(figures) < self.valves or any(int(f[k]) for f in figures for k in waiting):
            return False
        return sum(int(f["samples predicted"]) for f in figures) == sent

    def _wait(self, sent: int, cycles: int, left_s: float) -> None:
        def done() -> bool:
            figures = self.figures()
            stored = sum(int(f["cycles stored"]) for f in figures)
            if any(int(f["estimations pending"]) for f in figures):
                return False
            return stored >= cycles and sum(int(f["samples predicted"]) for f in figures) >= sent

        end = time.monotonic() + left_s
        while not done() and time.monotonic() < end:
            self.graph.spin(0.2)

    def figures(self) -> list[dict[str, str]]:
        """Return the newest figures of every valve; each message is read once."""
        while self.diagnostics:
            for s in self.diagnostics.pop(0).status:
                if s.hardware_id.startswith(NS):
                    self._newest[s.hardware_id] = {v.key: v.value for v in s.values}
        return list(self._newest.values())

    def _blocks(self) -> list[float]:
        if not self.counts.exists():
            return []
        return [float(line) for line in self.counts.read_text().splitlines()]

    def end(self) -> int:
        """End both processes; the exit code of the twin."""
        if self.plant is not None:
            if self.plant.poll() is None:
                self.plant.kill()
            self._leave(self.plant)
        if self.twin.poll() is None:
            self.twin.send_signal(signal.SIGTERM)
        self._leave(self.twin)
        return int(self.twin.returncode)

    def _leave(self, process: subprocess.Popen[str]) -> None:
        process.wait(120)
        for pipe in (process.stdin, process.stdout):
            if pipe is not None and not pipe.closed:
                pipe.close()


def rss_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def children(pid: int) -> list[int]:
    text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    others = (t for t in Path(f"/proc/{pid}/task").iterdir() if t.name != str(pid))
    found = text.split() + [c for t in others for c in _read(t / "children").split()]
    return [int(c) for c in found if "spawn_main" in _read(Path(f"/proc/{c}/cmdline"))]


def _read(path: Path) -> str:
    """Return what /proc says of a thread or process; nothing of one that has just ended."""
    try:
        return path.read_text()
    except OSError:
        return ""


def fill(database: Path, valves: int) -> None:
    """Store what a twin remembers, so that its memory is full from the first cycle on."""
    from valve_twin.core.estimation.cycle.memory import Memory
    from valve_twin.core.estimation.cycle.sequence import estimate_cycle
    from valve_twin.core.types import Cycle, Frames
    from valve_twin.core.valves.registry import complete_options, get_model

    model, memory = get_model("press_cartridge"), Memory.empty()
    options = complete_options(model, {})
    with History(database) as history:
        blocks = list(simulate_cycles(get_simulation("press_cartridge"), HELD, seed=1))
        for k, block in enumerate(blocks):
            n = len(block.position)
            stamps = (np.arange(n, dtype=np.int64) + k * n) * round(PERIOD_S * 1e9)
            nothing = np.full(n, np.nan)
            inputs = np.ascontiguousarray(block.inputs)
            frames = Frames(stamps, block.position, inputs, nothing, nothing, np.ones(n, bool))
            cycle = Cycle(number=k + 1, period_s=PERIOD_S, frames=frames)
            estimates, memory = estimate_cycle(model, options, cycle, memory)
            history.store(f"{NS}/{valve_names(1)[0]}", cycle_record(cycle), estimates)
    with closing(sqlite3.connect(database)) as copy, copy:
        for i, name in enumerate(valve_names(valves)[1:], start=2):
            copy.execute("INSERT INTO valve (id, name) VALUES (?, ?)", (i, f"{NS}/{name}"))
    engine = sa.create_engine(f"sqlite:///{database}")
    with engine.begin() as copies:
        for table in (history_tables.CYCLE, history_tables.ESTIMATE):
            rows = [dict(row) for row in copies.execute(sa.select(table)).mappings()]
            for row in rows:
                row.pop("id", None)
            for i in range(2, valves + 1):
                copies.execute(table.insert(), [sealed(table, {**r, "valve_id": i}) for r in rows])
    engine.dispose()


def plant(valves: int, rate: float, batch: int, seconds: float) -> None:
    """Publish the signals of all valves, `rate` times as fast as real time.

    With no `seconds` a production cycle is published for every line of stdin.
    """
    import rclpy
    from rclpy.duration import Duration
    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from valve_twin_msgs import msg

    from valve_twin.io.cdr.codec import encode_series, encode_stamped
    from valve_twin.nodes.runtime.transport.profile import use_fast_heartbeat

    use_fast_heartbeat()  # else every acknowledgement takes up to 3 s
    rclpy.init(args=[])
    node = Node("plant", start_parameter_services=False)
    kind = msg.Float64Stamped if batch == 1 else msg.Float64Series
    deep = QoSProfile(depth=20000 // batch)
    publishers = [
        [node.create_publisher(kind, f"{NS}/{v}/{t}", deep) for t in TOPICS]
        for v in valve_names(valves)
    ]
    everyone = [p for group in publishers for p in group]
    gate = SubscriberGate(node)
    while not gate.is_open(everyone, 1, time.monotonic()):
        rclpy.spin_once(node, timeout_sec=0.05)
    blocks = list(simulate_cycles(get_simulation("press_cartridge"), 60, seed=2))
    inputs = np.concatenate([b.inputs for b in blocks])
    columns = np.column_stack([inputs, np.concatenate([b.position for b in blocks])])
    start_ns = 10**15
    step_ns = round(PERIOD_S * 1e9)
    second = max(round(1.0 / PERIOD_S / batch), 1) * batch
    sent, begin = 0, time.monotonic()
    while time.monotonic() - begin < seconds if seconds else True:
        if not seconds and sent % CYCLE == 0:
            sys.stdout.write(f"{sent}\n")
            sys.stdout.flush()
            if not sys.stdin.readline().strip():
                return
            begin = time.monotonic() - sent * PERIOD_S / rate
        stamp = start_ns + sent * step_ns
        for i, group in enumerate(publishers):
            at = (sent + i * CYCLE // len(publishers) + np.arange(batch)) % len(columns)
            if batch == 1:
                row = columns[at[0]].tolist()
                data = [encode_stamped(stamp, value) for value in row]
            else:
                data = [encode_series(stamp, PERIOD_S, c) for c in columns[at].T]
            for publisher, content in zip(group, data, strict=True):
                publisher.publish(content)
        sent += batch
        if sent % second == 0:  # never more than the queues hold, however busy the machine
            for publisher in everyone:
                publisher.wait_for_all_acked(Duration(seconds=60))
        due = begin + sent * PERIOD_S / rate
        time.sleep(max(due - time.monotonic(), 0.0))
    for publisher in everyone:
        publisher.wait_for_all_acked(Duration(seconds=60))
    sys.stdout.write(json.dumps({"samples": sent, "seconds": time.monotonic() - begin}) + "\n")
    sys.stdout.flush()
    node.destroy_node()
    rclpy.try_shutdown()


def twin(counts: str, arguments: list[str]) -> None:
    """Run the twin; on SIGUSR1 it writes how many blocks Python has allocated."""

    def write(*_: object) -> None:
        with open(counts, "a", encoding="utf-8") as file:
            file.write(f"{sys.getallocatedblocks()}\n")

    signal.signal(signal.SIGUSR1, write)
    from valve_twin.nodes.runtime import executables

    sys.argv[1:] = arguments
    executables.run("twin")


if __name__ == "__main__":
    if sys.argv[1] == "twin":
        twin(sys.argv[2], sys.argv[3:])
    else:
        parser = argparse.ArgumentParser()
        parser.add_argument("valves", type=int)
        parser.add_argument("rate", type=float)
        parser.add_argument("batch", type=int)
        parser.add_argument("seconds", type=float)
        plant(**vars(parser.parse_args(sys.argv[2:])))
