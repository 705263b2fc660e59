# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is kept open for the locks that SQLite holds on it, and when it is closed."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
from contextlib import closing

import pytest

from valve_twin.io.history.wal.frames import keep_open

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="an index is kept open on Linux")

_OTHER = """
import os, sys
from valve_twin.io.locks import others_lock
files = [os.open(path, os.O_RDWR) for path in sys.argv[1::2]]
print("open", flush=True)
for line in sys.stdin:
    print([others_lock(file, int(at)) for file, at in zip(files, sys.argv[2::2])], flush=True)
"""
_SHARED, _OPEN = 0x40000002, 128
"""Where SQLite locks a database and an index that it has open [B]."""


@pytest.fixture
def connection(tmp_path):
    with closing(sqlite3.connect(tmp_path / "h.sqlite")) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("CREATE TABLE a (b)")
        yield connection


@pytest.fixture
def are_locked(connection, tmp_path):
    """Return what tells whether another process finds database and index locked by this one."""
    path = tmp_path / "h.sqlite"
    with subprocess.Popen(
        [sys.executable, "-c", _OTHER, str(path), str(_SHARED), f"{path}-shm", str(_OPEN)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as other:
        asked, told = other.stdin, other.stdout
        assert asked
        assert told
        assert told.readline() == "open\n"

        def ask():
            asked.write("\n")
            asked.flush()
            return told.readline().strip()

        yield ask


def keep_deleted(folder, count):
    """Keep files open that are deleted at once."""
    for number in range(count):
        path = folder / f"other_{number}"
        path.touch()
        keep_open(str(path))
        path.unlink()


def opened(folder):
    """Return the names of a folder's files that this process has open."""
    files = [os.path.realpath(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd")]
    return [os.path.basename(file) for file in files if file.startswith(f"{folder}/")]


def test_the_locks_of_a_deleted_database_last_as_long_as_its_connection(
    connection, are_locked, tmp_path
):
    """SQLite maps no database: it was closed though its connection was open, and its lock gone."""
    path = tmp_path / "h.sqlite"
    for name in (str(path), f"{path}-shm"):
        for flags in (os.O_RDONLY, os.O_RDWR):
            keep_open(name, flags)
    for tail in ("", "-wal", "-shm"):
        os.remove(f"{path}{tail}")
    keep_deleted(tmp_path, 25)
    assert are_locked() == "[True, True]"
    assert len(opened(tmp_path)) <= 4 + 3 + 9  # what is kept, what SQLite has, the last ones
    connection.close()
    keep_deleted(tmp_path, 25)
    assert not [name for name in opened(tmp_path) if name.startswith("h.sqlite")]


def test_a_path_that_is_replaced_while_it_is_opened_is_kept_as_what_it_is(tmp_path, monkeypatch):
    """Its descriptor was taken for one of the file before, whose locks are others."""
    path, former = tmp_path / "h.sqlite-shm", tmp_path / "former"
    path.write_text("second")
    former.write_text("first")
    second = keep_open(str(path))
    looked = os.stat

    def looks_and_is_replaced(file):
        status = looked(file)
        os.replace(path.with_name("next"), path)
        return status

    os.rename(path, path.with_name("next"))
    os.link(former, path)  # what is looked at; what is opened is the one kept already
    with monkeypatch.context() as patched:
        patched.setattr(os, "stat", looks_and_is_replaced)
        found = keep_open(str(path))
    assert found == second
    assert keep_open(str(path)) == second
    assert os.pread(keep_open(str(former)), 10, 0) == b"first"


def test_a_second_descriptor_of_a_file_frees_no_lock_of_it(
    connection, are_locked, tmp_path, monkeypatch
):
    """It is kept, too, where a file replaced by one that is kept was looked at."""
    path, former = tmp_path / "h.sqlite", tmp_path / "former"
    former.touch()
    kept, status = keep_open(str(path)), os.stat(former)
    with monkeypatch.context() as patched:
        patched.setattr(os, "stat", lambda _: status)
        found = keep_open(str(path))
    assert found == kept
    assert are_locked() == "[True, True]"
    assert opened(tmp_path).count("h.sqlite") == 3  # SQLite's own, and two
