# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Real nodes on real DDS: each test has its own domain and leaves no process behind."""

from __future__ import annotations

import fcntl
import itertools
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from test.nodes.forked import MODULE, Forked, can_fork, mother, warm_worker
from valve_twin.nodes.runtime.transport.dead_ports import remove_unborn
from valve_twin.nodes.runtime.transport.profile import remove_profile_file, use_fast_heartbeat
from valve_twin.nodes.twin.node import TwinNode

_domains = itertools.cycle(range(1, 100))
for _ in range(os.getpid() * 7 % 99):
    next(_domains)
_held: dict[int, int] = {}


def own_domain() -> int:
    """Return a ROS domain that no other test of this machine uses, kept until it is released."""
    for domain in itertools.islice(_domains, 99):
        path = Path(tempfile.gettempdir(), f"valve_twin_test_domain_{domain}")
        lock = os.open(path, os.O_CREAT | os.O_RDWR, 0o666)
        with suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _held[domain] = lock
            return domain
        os.close(lock)
    msg = "all ROS domains are in use by tests"
    raise RuntimeError(msg)


def release_domain(domain: int) -> None:
    """Let other tests use it."""
    os.close(_held.pop(domain))


NS = "/press/v1"
QUIET = {"start_type_description_service": False}
DEEP = QoSProfile(depth=100000)
ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def ready_s(pid: int) -> float:
    """Return how long the first thread of a process was ready and no core was free so far [s].

    It can be asked of a process that has ended until it is waited for; 0 where the kernel does
    not count it.
    """
    path = Path(f"/proc/{pid}/schedstat")
    return int(path.read_text().split()[1]) * 1e-9 if path.exists() else 0.0


class CoreWait:
    """How long all threads of processes were ready from now on and no core was free.

    What is counted with a thread goes when it ends: what was seen last is kept of it.
    """

    def __init__(self, *pids: int) -> None:
        self._pids = pids
        self._begun = self._counted()
        self._seen = dict(self._begun)

    def so_far_s(self) -> float:
        """Return it [s]: of those that waited at a time the sum; never less than before."""
        self._seen |= self._counted()
        return sum(ns - self._begun.get(task, 0) for task, ns in self._seen.items()) * 1e-9

    def _counted(self) -> dict[Path, int]:
        """Return what the kernel has counted for each living thread [ns]."""
        counted = {}
        folders = (Path(f"/proc/{pid}/task") for pid in self._pids)
        for task in itertools.chain.from_iterable(folder.iterdir() for folder in folders):
            with suppress(OSError):  # it has just ended, or nothing counts it
                counted[task] = int((task / "schedstat").read_text().split()[1])
        return counted


def has_ended(pid: int) -> bool:
    """Whether a child has ended; it is left to be waited for."""
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


class NodeProcess:
    """One node in a process of its own, its output in a file."""

    def __init__(self, command, environment, log: Path, *, fork: bool = False) -> None:
        self._log = log
        self.process: subprocess.Popen[bytes] | Forked
        with log.open("wb") as out:
            if fork:
                self.process = mother().fork(command, environment, log)
            else:
                self.process = subprocess.Popen(
                    command, env=environment, stdout=out, stderr=subprocess.STDOUT
                )

    @property
    def pid(self) -> int:
        return self.process.pid

    @property
    def log(self) -> str:
        return self._log.read_text(errors="replace")

    def takes_signals(self) -> bool:
        """Whether the handlers of both signals stand (kernel's mask of caught signals)."""
        status = Path(f"/proc/{self.pid}/status").read_text()
        caught = int(next(x for x in status.splitlines() if x.startswith("SigCgt")).split()[1], 16)
        return all(caught >> (number - 1) & 1 for number in (signal.SIGINT, signal.SIGTERM))

    def end(self, number: int = signal.SIGTERM, timeout: float = 120.0) -> int:
        """Send a signal and return the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.process.wait(timeout)

    def end_in_s(self, number: int = signal.SIGTERM, timeout: float = 120.0) -> tuple[int, float]:
        """Send a signal; return the exit code and how long the end took with a core free [s]."""
        begin_s = time.monotonic() - ready_s(self.pid)
        self.process.send_signal(number)
        while not has_ended(self.pid) and time.monotonic() - begin_s < timeout:
            time.sleep(0.005)
        took_s = time.monotonic() - ready_s(self.pid) - begin_s
        return self.process.wait(0.0), took_s

    def kill(self) -> None:
        """End it at once; remove the shared memory that Fast DDS leaves of a killed process.

        A segment is its own by the file that the process holds open beside it, and dead by the
        lock on that file.
        """
        if self.process.poll() is not None:
            return
        marks: set[Path] = set()
        with suppress(OSError):  # it has just ended
            marks |= {Path(os.path.realpath(fd)) for fd in Path(f"/proc/{self.pid}/fd").iterdir()}
        self.process.kill()
        self.process.wait()
        for mark in marks:
            if re.fullmatch(r"/dev/shm/fast(rtps|dds)_[0-9a-f]{16}_el", str(mark)):
                with suppress(OSError), mark.open("rb") as file:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    mark.with_name(mark.name.removesuffix("_el")).unlink()
                    mark.unlink()


class Graph:
    """The test's own view of its domain, the processes and nodes it started."""

    def __init__(self, domain: int, folder: Path) -> None:
        self.domain, self.folder = domain, folder
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        arguments = ["--ros-args", "-p", "start_type_description_service:=false"]
        self.node = Node("test", context=self.context, cli_args=arguments, namespace="/test")
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.hosted: list[Any] = []
        self.strangers: list[Node] = []
        self._others: list[SingleThreadedExecutor] = []
        self.processes: list[NodeProcess] = []
        self._count = itertools.count()
        self._records: list[tuple[str, list[Any]]] = []

    def start(
        self, name: str, ns: str = NS, extra=(), *, alone=False, fresh=False, **parameters
    ) -> NodeProcess:
        """Start a node as `ros2 run` does; `alone`: with no parameter file beside those given.

        It is a fork, see `forked`; `fresh`: an interpreter that begins with nothing imported, as
        it is wherever PYTHONPATH was changed.
        """
        number = next(self._count)
        command = [sys.executable, "-m", MODULE, name]
        given = self._arguments(f"{number}_{name}", ns, parameters, extra)
        command += given[:-2] if alone else given
        environment = {**os.environ, "ROS_DOMAIN_ID": str(self.domain), "PYTHONUNBUFFERED": "1"}
        log = self.folder / f"{number}_{name}.log"
        process = NodeProcess(command, environment, log, fork=can_fork(name) and not fresh)
        self.processes.append(process)
        return process

    def host(self, kind, ns: str = NS, extra=(), *, start: bool = True, **parameters):
        """Run a node inside the test's process."""
        if kind is TwinNode:
            warm_worker()
        number = next(self._count)
        arguments = self._arguments(f"{number}_hosted", ns, parameters, extra)
        node = kind(context=self.context, cli_args=arguments, use_global_arguments=False)
        self.hosted.append(node)
        self.executor.add_node(node)
        if start:
            node.start()
        return node

    def stranger(self, name: str) -> Node:
        """Return a node of another participant, as one on another machine is."""
        context = Context()
        rclpy.init(args=[], context=context, domain_id=self.domain)
        node = Node(name, context=context, namespace="/plant", start_parameter_services=False)
        self.strangers.append(node)
        return node

    def executor_of(self, stranger: Node) -> None:
        """Run a stranger's callbacks whenever the test's own run."""
        executor = SingleThreadedExecutor(context=stranger.context)
        executor.add_node(stranger)
        self._others.append(executor)

    def _arguments(self, label: str, ns: str, parameters, extra) -> list[str]:
        path = self.folder / f"{label}.yaml"
        content = {"/**": {"ros__parameters": {**QUIET, **parameters}}}
        path.write_text(yaml.safe_dump(content))
        return ["--ros-args", "-r", f"__ns:={ns}", *extra, "--params-file", str(path)]

    def spin_until(self, condition, timeout: float = 120.0, what: str = ""):
        """Run callbacks until the condition holds; return its value."""
        end = time.monotonic() + timeout
        while True:
            value = condition()
            if value:
                return value
            if time.monotonic() > end:
                logs = "\n".join(p.log[-2000:] for p in self.processes)
                heard = self._still_heard()
                pytest.fail(f"not within {timeout} s: {what or condition}\n{heard}\n{logs}")
            self.executor.spin_once(timeout_sec=0.02)
            for executor in self._others:
                executor.spin_once(timeout_sec=0.0)
            for node in self.hosted:
                node.drain()

    def wait_log(self, process: NodeProcess, *texts: str) -> None:
        """Wait until a process has printed each text: a message may be heard before its line."""
        for text in texts:
            self.spin_until(
                lambda wanted=text: wanted in process.log, 120.0, f"'{text}' in the log"
            )

    def _still_heard(self) -> str:
        """Say of each topic that is recorded how much was heard, and in the next 2 s."""
        before = [len(found) for _, found in self._records]
        end = time.monotonic() + 2.0
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)
        return "\n".join(
            f"{topic}: {count} messages, then {len(found) - count} in 2 s"
            for (topic, found), count in zip(self._records, before, strict=True)
        )

    def spin(self, seconds: float) -> None:
        """Run callbacks for a time; only to see that something does not happen."""
        end = time.monotonic() + seconds
        self.spin_until(lambda: time.monotonic() > end, seconds + 5.0)

    def record(self, topic: str, kind, qos: QoSProfile = DEEP) -> list[Any]:
        """Return a list that fills with the messages of a topic."""
        found: list[Any] = []
        self.node.create_subscription(kind, topic, found.append, qos)
        self._records.append((topic, found))
        return found

    def record_with_info(self, topic: str, kind) -> list[Any]:
        """Return a list that fills with pairs of message and its transport times."""
        found: list[Any] = []

        def take(message, info) -> None:
            found.append((message, info))

        self.node.create_subscription(kind, topic, take, DEEP)  # type: ignore[arg-type]
        self._records.append((topic, found))
        return found

    def connected(self, *topics: str) -> bool:
        """Whether every one of the test's subscriptions of these topics has met a publisher."""
        mine = [s for s in self.node.subscriptions if s.topic_name in topics]
        return len(mine) == len(topics) and all(s.get_publisher_count() for s in mine)

    def be_heard(self, node: str) -> None:
        """Wait until a node knows the test's subscribers: it has met these latest two.

        A subscriber can see a publisher that does not know it yet; what is published until then
        is lost to it. The log of the last 10 s is kept for who comes late: it is there at once.
        """
        heard: list[str] = []
        name = node.strip("/").replace("/", ".")

        def read(message: Log) -> None:
            if (message.name, message.msg) == (name, "is active"):
                heard.append(message.msg)

        def take(message: DiagnosticArray) -> None:
            heard.extend(s.name for s in message.status if s.name.startswith(node))

        latest = (
            self.node.create_subscription(Log, "/rosout", read, ROSOUT),
            self.node.create_subscription(DiagnosticArray, "/diagnostics", take, DEEP),
        )
        self.spin_until(lambda: heard, 120.0, f"log or diagnostics of {node}")
        for subscription in latest:
            self.node.destroy_subscription(subscription)

    def call(self, service, name: str, /, timeout: float = 120.0, **fields):
        """Call a service of any node and return the response."""
        client = self.node.create_client(service, name)
        self.spin_until(client.service_is_ready, timeout, f"service {name}")
        future = client.call_async(service.Request(**fields))
        self.spin_until(future.done, timeout, f"answer of {name}")
        self.node.destroy_client(client)
        return future.result()

    def close(self) -> None:
        """Leave the domain, then kill its processes: no reader here is left with a dead writer.

        Fast DDS reads what others wrote into memory that is theirs; a test's process has crashed
        on leaving after they were killed.
        """
        try:
            self._leave()
        finally:
            for process in self.processes:
                process.kill()
            release_domain(self.domain)

    def _leave(self) -> None:
        for node in self.hosted:
            node.stop()
            self.executor.remove_node(node)
            node.destroy_node()
        for executor in self._others:
            executor.shutdown()
        for node in self.strangers:
            node.destroy_node()
            rclpy.shutdown(context=node.context)
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


def make_graph(folder: Path) -> Graph:
    """Return a domain of its own, in which what the test's own publishers lose comes soon again.

    A test publishes faster than any plant, and what is lost of a burst the middleware sends again
    only after 3 s, time after time. The profile is for the test's process alone.
    """
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["OMP_NUM_THREADS"] = "1"
    use_fast_heartbeat()
    domain = own_domain()
    remove_unborn(domain)
    try:
        return Graph(domain, folder)
    finally:
        remove_profile_file()


@pytest.fixture
def graph(tmp_path):
    made = make_graph(tmp_path)
    yield made
    made.close()
