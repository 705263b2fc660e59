# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The file of an open history is deleted, replaced, damaged or out of reach: nothing is lost."""

from __future__ import annotations

import resource
import shutil
import sqlite3
import threading
from contextlib import closing
from pathlib import Path

import pytest

from test.io.history.test_store import VALVE, both, filled, record, store_cycles
from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.core.state import Announced
from valve_twin.core.types import Maintenance
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import CycleTakenError, History

TAILS = ("", "-wal", "-shm")
OK = Verdict(6, VALVE, VerdictKind.OK, VerdictKind.OK.text, "largest drift: K_in +0.1 %", 6)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    folder = tmp_path / "data"
    folder.mkdir()
    return folder / "history.db"


def stored(file: Path) -> list[int]:
    with History(file, read_only=True) as history:
        cycles = [c.cycle for c in history.cycles(VALVE)]
        assert [e.cycle for e in history.estimates(VALVE)] == [n for n in cycles for _ in (1, 2)]
    return cycles


def delete(file: Path, tails: tuple[str, ...] = TAILS) -> None:
    for tail in tails:
        Path(f"{file}{tail}").unlink()


class TestDeletedFile:
    @pytest.mark.parametrize("tails", [TAILS, ("",), ("", "-wal")], ids=["all", "main", "log too"])
    def test_is_written_again_with_all_that_it_held(
        self, file: Path, tails: tuple[str, ...]
    ) -> None:
        with filled(file) as history:
            history.add_maintenance(VALVE, Maintenance(5, 2, "seal"))
            delete(file, tails)
            assert history.store(VALVE, record(4), both(4))
            (notice,) = history.notices
            assert "was deleted while in use: it was written again" in notice
            assert stored(file) == [1, 2, 3, 4]
            assert history.maintenance(VALVE) == [Maintenance(5, 2, "seal")]
            store_cycles(history, 5, 8)
        assert stored(file) == [1, 2, 3, 4, 5, 6, 7]
        assert not list(file.parent.glob("*.part"))

    def test_again_and_again(self, file: Path) -> None:
        with filled(file) as history:
            for number in range(4, 9):
                delete(file)
                assert history.store(VALVE, record(number), both(number))
        assert stored(file) == list(range(1, 9))

    def test_is_written_again_once_when_two_write_to_it(self, file: Path) -> None:
        with filled(file) as first, History(file) as second:
            second.store("/other", record(1), both(1))
            delete(file)
            histories = (first, second)

            def go_on(history: History, valve: str) -> None:
                for number in range(10, 20):
                    history.store(valve, record(number), both(number))

            threads = [
                threading.Thread(target=go_on, args=pair)
                for pair in zip(histories, (VALVE, "/other"), strict=True)
            ]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert second.last_cycle(VALVE) == first.last_cycle("/other") == 19
        assert stored(file) == [1, 2, 3, *range(10, 20)]
        with History(file) as history:
            assert [c.cycle for c in history.cycles("/other")] == [1, *range(10, 20)]

    def test_whose_folder_vanished_waits_for_it(self, file: Path) -> None:
        with filled(file) as history:
            shutil.rmtree(file.parent)
            with pytest.raises(StoreError, match=r"cannot be mended: No such file or directory"):
                history.store(VALVE, record(4), both(4))
            assert history.last_cycle(VALVE) == 3
            file.parent.mkdir()
            assert history.store(VALVE, record(4), both(4))
        assert stored(file) == [1, 2, 3, 4]

    def test_keeps_the_claims(self, file: Path) -> None:
        with filled(file) as history:
            history.claim(VALVE).announce(Announced(7, 70))
            shutil.rmtree(file.parent)
            file.parent.mkdir()
            assert history.store(VALVE, record(4), both(4))
            with (
                History(file) as other,
                pytest.raises(StoreError, match="is already written by process"),
            ):
                other.claim(VALVE)
        with History(file) as other:
            assert other.claim(VALVE).announced == Announced(7, 70)

    def test_a_deleted_log_is_emptied_into_the_file(self, file: Path) -> None:
        with filled(file) as history:
            Path(f"{file}-wal").unlink()
            assert history.store(VALVE, record(4), both(4))
            assert "log was deleted while in use: it was emptied" in history.notices[0]
            assert stored(file) == [1, 2, 3, 4]


class TestReplacedFile:
    def test_is_used_and_gets_what_it_lacks(self, file: Path, tmp_path: Path) -> None:
        backup = tmp_path / "backup.db"
        with filled(file) as history:
            history.backup(backup)
            store_cycles(history, 4, 7)
            history.add_maintenance(VALVE, Maintenance(5, 6, "seal"))
            history.add_verdict(VALVE, OK)
            delete(file)
            backup.rename(file)
            assert history.store(VALVE, record(7), both(7))
            assert "3 cycles were added that it lacked" in history.notices[0]
            assert history.maintenance(VALVE) == [Maintenance(5, 6, "seal")]
            assert history.verdicts(VALVE) == [OK]
        assert stored(file) == [1, 2, 3, 4, 5, 6, 7]

    def test_keeps_cycles_that_only_it_has(self, file: Path) -> None:
        history = filled(file)
        file.rename(file.with_name("old.db"))
        with History(file.with_name("new.db")) as new:
            new.store("/other", record(1), both(1))
        file.with_name("new.db").rename(file)
        history.store(VALVE, record(4), both(4))
        assert history.valves() == ["/other", VALVE]
        history.close()
        assert stored(file) == [1, 2, 3, 4]

    def test_with_other_cycles_is_refused_and_left_alone(self, file: Path) -> None:
        with filled(file) as history:
            file.rename(file.with_name("old.db"))
            with History(file.with_name("new.db")) as new:
                new.store(VALVE, record(2, samples=7), both(2))
            file.with_name("new.db").rename(file)
            for _ in range(2):
                with pytest.raises(StoreError, match=r"holds other cycles: cycle 2 of .* differs"):
                    history.store(VALVE, record(4), both(4))
            assert history.last_cycle(VALVE) == 3
            file.unlink()
            file.with_name("old.db").rename(file)
            assert history.store(VALVE, record(4), both(4))
        assert stored(file) == [1, 2, 3, 4]

    def test_that_is_no_database_is_refused_until_it_is_gone(self, file: Path) -> None:
        with filled(file) as history:
            delete(file)
            file.write_text("not a database, but long enough to look at\n" * 100)
            with pytest.raises(StoreError, match="file is not a database"):
                history.store(VALVE, record(4), both(4))
            file.unlink()
            assert history.store(VALVE, record(4), both(4))
        assert stored(file) == [1, 2, 3, 4]


class TestDamagedFile:
    def damage(self, history: History, file: Path) -> None:
        store_cycles(history, 4, 200)
        with closing(sqlite3.connect(file)) as other:
            other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        content = file.read_bytes()
        with file.open("r+b") as out:
            out.seek(4096)
            out.write(b"\xa5" * (len(content) - 4096))

    def test_is_named_and_a_backup_put_in_its_place_is_used(
        self, file: Path, tmp_path: Path
    ) -> None:
        with filled(file) as history:
            backup = history.backup(tmp_path / "backup.db")
            self.damage(history, file)
            with pytest.raises(StoreError, match=r"damaged: move it away and put the last backup"):
                store_cycles(history, 200, 300)
            file.rename(file.with_name("damaged.db"))
            backup.rename(file)
            assert history.store(VALVE, record(300), both(300))
            assert "the one before was damaged" in history.notices[0]
        assert stored(file) == [1, 2, 3, 300]


class TestFullDisk:
    def test_refuses_whole_cycles_and_goes_on_when_there_is_room(self, file: Path) -> None:
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        with filled(file) as history:
            size = Path(f"{file}-wal").stat().st_size
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
            try:
                for _ in range(2):
                    with pytest.raises(StoreError, match=r"(disk|space)"):
                        history.store(VALVE, record(4), both(4))
                assert history.last_cycle(VALVE) == 3
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
            assert history.store(VALVE, record(4), both(4))
        assert stored(file) == [1, 2, 3, 4]


class TestNumbers:
    def test_a_taken_number_is_told_from_trouble(self, file: Path) -> None:
        with filled(file) as history, pytest.raises(CycleTakenError, match="number the cycles on"):
            history.store(VALVE, record(2, lost=7), both(2))

    def test_one_valve_has_one_writer(self, file: Path) -> None:
        with History(file) as first, History(file) as second:
            first.claim(VALVE)
            second.claim("/other")
            for history, valve in ((second, VALVE), (first, "/other")):
                with pytest.raises(
                    StoreError, match=rf"{valve} is already written by process \d+ on .*: stop"
                ):
                    history.claim(valve)
            first.close()
            second.claim(VALVE)

    def test_what_was_announced_is_known_to_the_next_writer(self, file: Path) -> None:
        with History(file) as history:
            claim = history.claim(VALVE)
            assert claim.announced == Announced()
            claim.announce(Announced(41, 10**18))
            history.claim("/other").announce(Announced(5, 6))
        with History(file) as again:
            assert again.claim(VALVE).announced == Announced(41, 10**18)
            assert again.claim("/other").announced == Announced(5, 6)
