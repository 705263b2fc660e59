# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Speak to the user and run commands into a log."""

import os
import shlex
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DISTROS = ("jazzy", "kilted")
WHEELS = os.environ.get("VALVE_TWIN_ROS") or DISTROS[0]
"""Whose wheels are used where no ROS 2 is sourced; each has an environment of its own."""
SUFFIX = "" if DISTROS[0] == WHEELS else f"-{WHEELS}"
LOG = ROOT / "log" / "setup.log"
HEARTBEAT_S = 15.0
SHOWN_LINES = 40


class SetupError(Exception):
    """One line for the user: what is wrong and what to do."""


def say(text: str) -> None:
    """Tell the user what is being done."""
    print(f"setup: {text}", flush=True)


def run(
    command: Sequence[str], what: str, environment: Mapping[str, str], log_name: str = ""
) -> None:
    """Run a command into the log, with a sign of life now and then.

    Parameters
    ----------
    command : sequence of str
        Command and arguments; run at the root of the repository.
    what : str
        What it does, for the user.
    environment : mapping
        Its whole environment.
    log_name : str
        Name of a log of its own, for a command that runs beside another one.

    Raises
    ------
    SetupError
        The command failed; the end of its output is on stderr.
    """
    start = time.monotonic()
    path = LOG.with_name(log_name) if log_name else LOG
    with path.open("ab") as log:
        log.write(f"\n$ {shlex.join(command)}\n".encode())
        log.flush()
        begin = log.tell()
        process = subprocess.Popen(
            command,
            cwd=ROOT,
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        while (code := _wait(process)) is None:
            say(f"  ... {what}, {time.monotonic() - start:.0f} s so far")
    if code != 0:
        lines = path.read_bytes()[begin:].decode(errors="replace").splitlines()
        print("\n".join(lines[-SHOWN_LINES:]), file=sys.stderr)
        where = path.relative_to(ROOT)
        raise SetupError(f"{what} failed (exit code {code}); the whole output is in {where}")
    say(f"  done in {time.monotonic() - start:.0f} s: {what}")


def _wait(process: subprocess.Popen[bytes]) -> int | None:
    try:
        return process.wait(timeout=HEARTBEAT_S)
    except subprocess.TimeoutExpired:
        return None
