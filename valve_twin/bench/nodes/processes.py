# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Processes whose CPU time and memory are measured from outside, to the microsecond."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

MB = 1 << 20

QUIET = {"start_type_description_service": False}


def some_domain() -> int:
    """Return a ROS domain that hardly anybody else uses."""
    return 1 + os.getpid() * 13 % 100


def cpu_s(pid: int) -> float:
    """Return the CPU time that a process has used, all its threads, user and system [s]."""
    return time.clock_gettime((~pid << 3) | 2)  # CPUCLOCK_SCHED of clock_getcpuclockid(3)


class NodeProcess:
    """One process in the domain of the comparison; its output goes to a file.

    Parameters
    ----------
    arguments : sequence of str
        What follows the interpreter.
    domain : int
        ROS domain.
    log : Path
        Takes what it prints.
    """

    def __init__(self, arguments: Sequence[str], domain: int, log: Path) -> None:
        environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "OMP_NUM_THREADS": "1",
            "PYTHONUNBUFFERED": "1",
        }
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installation keeps its bytecode
        self._log = log
        with log.open("wb") as out:
            self._process = subprocess.Popen(
                [sys.executable, *arguments], env=environment, stdout=out, stderr=subprocess.STDOUT
            )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def log(self) -> str:
        """What it printed so far."""
        return self._log.read_text(errors="replace")

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._process.poll() is None

    def cpu_s(self) -> float:
        """CPU time of the process itself [s]."""
        return cpu_s(self.pid)

    def memory(self) -> tuple[float, float]:
        """Resident memory and the share that is its own alone (RSS, USS) [MB]."""
        rollup = Path(f"/proc/{self.pid}/smaps_rollup").read_text().splitlines()
        sizes = {x.split(":")[0]: int(x.split()[1]) * 1024 for x in rollup[1:]}
        own = sizes["Private_Clean"] + sizes["Private_Dirty"]
        return sizes["Rss"] / MB, own / MB

    def terminate(self) -> None:
        """Tell it to end; `end` waits for it."""
        self._process.terminate()

    def end(self) -> None:
        """End it: in good order, else at once."""
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def start_node(
    name: str, domain: int, folder: Path, namespace: str, parameters: Mapping[str, object]
) -> NodeProcess:
    """Start one of our nodes as `ros2 run` does."""
    path = folder / f"{name}.yaml"
    content = {"/**": {"ros__parameters": {**QUIET, **parameters}}}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    options = ["--ros-args", "-r", f"__ns:={namespace}", "--params-file", str(path)]
    command = ["-m", "valve_twin.nodes.runtime.executables", name, *options]
    return NodeProcess(command, domain, folder / f"{name}.log")


def start_peer(
    role: str, domain: int, folder: Path, topics: Sequence[str], kind: str = "Float64Stamped"
) -> NodeProcess:
    """Start a bare node: `echo`, `count` or `relay` of `peers`, which imports nothing of ours.

    Parameters
    ----------
    role : str
        'echo', 'count' or 'relay'.
    domain : int
        ROS domain.
    folder : Path
        Where its log is written.
    topics : sequence of str
        What it takes.
    kind : str
        Message type of valve_twin_msgs.
    """
    program = str(Path(__file__).parent / "peers.py")
    return NodeProcess([program, role, kind, *topics], domain, folder / f"{role}.log")
