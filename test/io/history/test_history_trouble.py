# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The file of an open history is deleted, replaced, damaged or out of reach: nothing is lost."""

from __future__ import annotations

import os
import resource
import shutil
import sqlite3
import tempfile
import threading
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from test.io.history.test_store import VALVE, both, filled, record, store_cycles
from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.core.state import Announced
from valve_twin.core.types import Maintenance
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import CycleTakenError, History

if TYPE_CHECKING:
    from collections.abc import Iterator

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


class TestTruncatedFile:
    """`truncate`, `cp /dev/null` or a disk that lost pages, under an open history."""

    @pytest.mark.parametrize("left", [0, 32, 9000, -2000], ids=str)
    def test_a_truncated_log_is_written_back(self, file: Path, left: int) -> None:
        log = Path(f"{file}-wal")
        with filled(file) as history:
            history.add_maintenance(VALVE, Maintenance(5, 2, "seal"))
            os.truncate(log, left if left >= 0 else log.stat().st_size + left)
            assert history.store(VALVE, record(4), both(4))
            (notice,) = history.notices
            assert "log was truncated while in use: what it held was written back" in notice
            assert history.maintenance(VALVE) == [Maintenance(5, 2, "seal")]
            assert stored(file) == [1, 2, 3, 4]
        assert stored(file) == [1, 2, 3, 4]

    def test_a_truncated_log_is_written_back_while_nothing_is_stored(self, file: Path) -> None:
        with filled(file) as history:
            os.truncate(f"{file}-wal", 0)
            history.repair()
            assert stored(file) == [1, 2, 3]

    def test_a_log_that_is_truncated_just_before_the_end_is_written_back(self, file: Path) -> None:
        with filled(file):
            os.truncate(f"{file}-wal", 0)
        assert stored(file) == [1, 2, 3]

    def test_a_cycle_whose_log_was_truncated_while_it_was_stored_is_not_stored(
        self, file: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with filled(file) as history:
            database = history._database
            log, size = Path(f"{file}-wal"), Path(f"{file}-wal").stat().st_size
            look = database.check_file

            def cut_after(*, grown: bool = False) -> None:
                if grown:
                    os.truncate(log, size)
                look(grown=grown)

            with monkeypatch.context() as change:
                change.setattr(database, "check_file", cut_after)
                with pytest.raises(StoreError, match="log was truncated while in use"):
                    history.store(VALVE, record(4), both(4))
            history.store(VALVE, record(4), both(4))  # may be there: the open file remembers it
            assert "it was written again with" in history.notices[0]
            store_cycles(history, 5, 7)
        assert stored(file) == [1, 2, 3, 4, 5, 6]

    @pytest.mark.parametrize("left", [0, 1000, 4096, 12288], ids=str)
    def test_a_truncated_file_is_written_again_as_far_as_it_is_known(
        self, file: Path, left: int
    ) -> None:
        with filled(file) as history:
            with closing(sqlite3.connect(file)) as other:
                other.execute("PRAGMA wal_checkpoint(PASSIVE)")  # the log has it still
            history.repair()  # looks
            os.truncate(file, left)
            assert history.store(VALVE, record(4), both(4))
            assert "the file was truncated while in use: it was written" in history.notices[0]
            assert stored(file) == [1, 2, 3, 4]
        assert stored(file) == [1, 2, 3, 4]

    def test_a_truncated_file_that_nobody_knows_is_told_until_a_backup_is_there(
        self, file: Path, tmp_path: Path
    ) -> None:
        with filled(file) as history:
            backup = history.backup(tmp_path / "backup.db")
            store_cycles(history, 4, 700)  # more than the open file remembers
            with closing(sqlite3.connect(file)) as other:
                other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            os.truncate(file, file.stat().st_size // 2)
            for _ in range(2):
                with pytest.raises(StoreError, match=r"truncated while .*put the last backup"):
                    history.store(VALVE, record(700), both(700))
            file.rename(file.with_name("damaged.db"))
            backup.rename(file)
            assert history.store(VALVE, record(700), both(700))
        assert stored(file) == [1, 2, 3, 700]

    def test_a_vacuumed_file_is_whole(self, file: Path) -> None:
        with filled(file) as history:
            with history._database.write() as connection:
                connection.exec_driver_sql("CREATE TABLE big AS SELECT zeroblob(400000) AS x")
            for statement in ("PRAGMA wal_checkpoint", "DROP TABLE big", "VACUUM"):
                with closing(sqlite3.connect(file, isolation_level=None)) as other:
                    other.execute(statement)
                    other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                history.repair()
            assert history.store(VALVE, record(4), both(4))
            assert not history.notices
        assert stored(file) == [1, 2, 3, 4]

    def test_a_file_that_was_vacuumed_and_then_written_to_is_whole(self, file: Path) -> None:
        with filled(file) as history, History(file) as other:
            with closing(sqlite3.connect(file, isolation_level=None)) as shell:
                shell.execute("CREATE TABLE big AS SELECT zeroblob(400000) AS x")
                shell.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                history.repair()  # looks
                for statement in ("DROP TABLE big", "VACUUM", "PRAGMA wal_checkpoint(TRUNCATE)"):
                    shell.execute(statement)
            for number in range(1, 30):  # pages that the file gets later
                other.store("/other", record(number), both(number))
            assert history.store(VALVE, record(4), both(4))
            assert not history.notices
        assert stored(file) == [1, 2, 3, 4]

    def test_two_that_write_to_it_lose_nothing(self, file: Path) -> None:
        with filled(file) as first, History(file) as second:
            second.store("/other", record(1), both(1))
            for number in range(4, 10):
                os.truncate(f"{file}-wal", 0)
                for history, valve in ((first, VALVE), (second, "/other")):
                    assert history.store(valve, record(number), both(number))
            assert stored(file) == [1, 2, 3, *range(4, 10)]
            assert [c.cycle for c in first.cycles("/other")] == [1, *range(4, 10)]


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


@pytest.fixture
def nobodys_file() -> Iterator[Path]:
    """A history of nobody, whom permissions bind; root they do not."""
    user = os.geteuid()
    with tempfile.TemporaryDirectory() as folder:
        if user == 0:
            os.chown(folder, 65534, 65534)
            os.seteuid(65534)
        try:
            yield Path(folder, "history.db")
        finally:
            os.seteuid(user)


class TestPermissions:
    def test_that_are_taken_away_cost_nothing_that_was_stored(self, nobodys_file: Path) -> None:
        file, folder, log = nobodys_file, nobodys_file.parent, Path(f"{nobodys_file}-wal")
        with filled(file) as history:
            for path, mode in ((file, 0), (log, 0), (folder, 0o500)):
                path.chmod(mode)
            assert history.store(VALVE, record(4), both(4))  # what is open stays open
            folder.chmod(0)
            for _ in range(2):
                with pytest.raises(StoreError, match="Permission denied: give this user"):
                    history.store(VALVE, record(5), both(5))
            folder.chmod(0o700)
            for path in (file, log):
                path.chmod(0o600)
            assert history.store(VALVE, record(5), both(5))
        assert stored(file) == [1, 2, 3, 4, 5]


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
