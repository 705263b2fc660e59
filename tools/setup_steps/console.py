# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Speak to the user and run commands into a log."""

import shlex
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LOG = ROOT / "log" / "setup.log"
HEARTBEAT_S = 15.0
SHOWN_LINES = 40


class SetupError(Exception):
    """One line for the user: what is wrong and what to do."""


def say(text: str) -> None:
    """Tell the user what is being done."""
    print(f"setup: {text}", flush=True)


def run(command: Sequence[str], what: str, environment: Mapping[str, str]) -> None:
    """Run a command into the log, with a sign of life now and then.

    Parameters
    ----------
    command : sequence of str
        Command and arguments; run at the root of the repository.
    what : str
        What it does, for the user.
    environment : mapping
        Its whole environment.

    Raises
    ------
    SetupError
        The command failed; the end of its output is on stderr.
    """
    start = time.monotonic()
    with LOG.open("ab") as log:
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
        lines = LOG.read_bytes()[begin:].decode(errors="replace").splitlines()
        print("\n".join(lines[-SHOWN_LINES:]), file=sys.stderr)
        where = LOG.relative_to(ROOT)
        raise SetupError(f"{what} failed (exit code {code}); the whole output is in {where}")
    say(f"  done in {time.monotonic() - start:.0f} s")


def _wait(process: subprocess.Popen[bytes]) -> int | None:
    try:
        return process.wait(timeout=HEARTBEAT_S)
    except subprocess.TimeoutExpired:
        return None
