# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Several processes share one history database: writers, readers, the command, a backup."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from test.io.history.test_store import bits, both
from valve_twin.core.state import Announced
from valve_twin.io.errors import StoreError
from valve_twin.io.history.claim import LEAVE_S
from valve_twin.io.history.store import History

if TYPE_CHECKING:
    from collections.abc import Iterator

WRITER = Path(__file__).with_name("shared_writer.py")
COUNT = 60


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "history.db"


class Writer:
    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def go(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("go\n")
        self.process.stdin.flush()


@contextmanager
def writer(file: Path, valve: str, root: Path, first: int = 1) -> Iterator[Writer]:
    environment = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, str(WRITER), str(file), valve, str(first), str(COUNT)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            yield Writer(process)
        finally:
            process.kill()


def test_two_write_while_others_read_back_up_and_list(
    file: Path, tmp_path: Path, root: Path
) -> None:
    History(file).close()
    valves = ("/a", "/b")
    with (
        writer(file, "/a", root) as first,
        writer(file, "/b", root) as second,
        History(file, read_only=True) as reader,
        History(file) as third,
    ):
        writers = (first, second)
        assert [w.line() for w in writers] == ["claimed", "claimed"]
        for w in writers:
            w.go()
        copies: list[Path] = []
        for number in range(1, COUNT + 1):
            assert [w.line() for w in writers] == [str(number)] * 2
            for valve in valves:  # what was acknowledged is seen at once, and whole
                cycles = [c.cycle for c in reader.cycles(valve)]
                assert cycles[: number - 1] == list(range(1, number))
                assert len(reader.estimates(valve, first_cycle=number, limit=2)) == 2
            if number % 20 == 10:
                copies.append(third.backup(tmp_path / f"copy{number}.db"))
            if number == 15:
                command = [sys.executable, "-m", "valve_twin.cli", "history", "list"]
                listed = subprocess.run(
                    [*command, "--url", str(file)], capture_output=True, text=True, check=False
                )
                assert "/a: last cycle" in listed.stdout, listed.stderr
        for w in writers:
            w.go()
            w.process.wait(10)
    expected = [bits(e) for n in range(1, COUNT + 1) for e in both(n)]
    with History(file, read_only=True) as history:
        for valve in valves:
            assert [bits(e) for e in history.estimates(valve)] == expected
    for copy in copies:
        with History(copy, read_only=True) as saved:
            for valve in valves:
                found = [bits(e) for e in saved.estimates(valve)]
                assert found == expected[: len(found)]


def test_one_valve_has_one_writing_process_until_it_dies(file: Path, root: Path) -> None:
    with writer(file, "/a", root) as first:
        assert first.line() == "claimed"
        with writer(file, "/a", root) as second:
            refusal = second.line()
            assert f"/a is already written by process {first.process.pid} on" in refusal
            assert refusal.startswith("refused: ")
        first.go()
        assert [first.line() for _ in range(5)] == ["1", "2", "3", "4", "5"]
        with History(file) as third:
            with pytest.raises(StoreError, match="is already written by process"):
                third.claim("/a")
            first.process.kill()
            first.process.wait(10)
            announced = third.claim("/a").announced
            stored = third.last_cycle("/a")
    assert stored >= 5
    assert announced.number in (stored, stored + 1)  # killed between the two
    assert announced == Announced(announced.number, announced.number * 10**10)


def test_the_next_writer_waits_for_one_that_is_just_ending(file: Path) -> None:
    with History(file) as first, History(file) as second:
        first.claim("/a")
        end = threading.Timer(0.5 * LEAVE_S, first.close)
        end.start()
        second.claim("/a")
        end.join()
