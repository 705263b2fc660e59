# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Nodes as processes of a domain of their own, and files for their parameters."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

if TYPE_CHECKING:
    from collections.abc import Sequence


class Processes:
    """Nodes as the installed executables, ended by their id whatever happens.

    Parameters
    ----------
    logs : Path
        Folder for their output.
    """

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._running: list[tuple[str, subprocess.Popen[bytes]]] = []
        self._beside: set[str] = set()

    def __enter__(self) -> Processes:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End all, newest first: SIGINT, and SIGKILL where that is not enough."""
        for _name, process in reversed(self._running):
            process.send_signal(signal.SIGINT)
        for name, process in reversed(self._running):
            try:
                process.wait(timeout=10.0)
            except subprocess.TimeoutExpired:
                say(f"{name} did not end by itself")
                process.kill()
                process.wait()

    def start(
        self,
        name: str,
        namespace: str,
        files: Sequence[Path],
        more: Sequence[str] = (),
        *,
        beside: bool = False,
    ) -> None:
        """Start one node with parameter files, later ones first in rank.

        Parameters
        ----------
        name : str
            Executable.
        namespace : str
            Namespace of the node.
        files : sequence of Path
            Parameter files, later ones first in rank.
        more : sequence of str
            Further arguments.
        beside : bool
            Whether the rest goes on without it.
        """
        if beside:
            self._beside.add(name)
        command = [str(_executable(name)), "--ros-args", "-r", f"__ns:={namespace}"]
        for file in files:
            command += ["--params-file", str(file)]
        log = (self._logs / f"{name}.log").open("ab")
        process = subprocess.Popen([*command, *more], stdout=log, stderr=subprocess.STDOUT)
        log.close()
        self._running.append((name, process))

    def told(self) -> str:
        """Return what they have said so far, one log after the other."""
        logs = sorted({self._logs / f"{name}.log" for name, _ in self._running})
        return "\n".join(f"{p.name}:\n{p.read_text('utf-8', 'replace')}" for p in logs)

    def alive(self) -> bool:
        """Return whether all nodes still run that the rest needs."""
        needed = [p for name, p in self._running if name not in self._beside]
        return all(process.poll() is None for process in needed)

    def found(self, name: str, pattern: str, limit_s: float) -> list[str]:
        """Return what a node has said of a pattern as soon as it has; empty where it does not.

        Parameters
        ----------
        name, pattern : str
            Executable, and a regular expression.
        limit_s : float
            Longest wait [s].
        """
        log = self._logs / f"{name}.log"
        end_s = time.monotonic() + limit_s
        process = next(p for n, p in self._running if n == name)
        while time.monotonic() < end_s and process.poll() is None:
            seen = re.findall(pattern, log.read_text("utf-8", "replace"))
            if seen:
                return seen
            time.sleep(0.1)
        return []


def _executable(name: str) -> Path:
    """Return the executable that `ros2 run valve_twin NAME` starts."""
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        path = Path(prefix) / "lib" / "valve_twin" / name
        if path.is_file():
            return path
    msg = f"the executable {name} is not installed: run make setup, and this through tools/run"
    raise FileNotFoundError(msg)


def isolate() -> None:
    """Take a ROS domain of our own that does not leave this machine."""
    os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randrange(1, 102))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


def fresh_folder(base: Path) -> Path:
    """Make and return the next numbered folder below `base`."""
    number = 1
    while (base / str(number)).exists():
        number += 1
    out = base / str(number)
    out.mkdir(parents=True)
    return out.resolve()


def write_parameters(path: Path, parameters: dict[str, object]) -> Path:
    """Write parameters of every node into a file and return it."""
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}), encoding="utf-8")
    return path


def say(text: str) -> None:
    """Print a line with the time of day."""
    sys.stdout.write(f"{time.strftime('%H:%M:%S')}  {text}\n")
    sys.stdout.flush()
