# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The history: exact, durable once acknowledged, never half written, plain about what is wrong."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import sqlalchemy as sa

from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.core.types import (
    Condition,
    Cycle,
    Disagreement,
    Estimate,
    EstimateStatus,
    Frames,
    Guard,
    Maintenance,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.io.errors import StoreError
from valve_twin.io.history import export
from valve_twin.io.history.migrations.schema import migrate
from valve_twin.io.history.store import CycleRecord, History, cycle_record
from valve_twin.io.history.tables import METADATA, SCHEMA_TABLE, SCHEMA_VERSION
from valve_twin.io.history.tables import VALVE as VALVE_TABLE

if TYPE_CHECKING:
    from collections.abc import Iterator

VALVE = "/press/valve_1"
HERE = Path(__file__).resolve().parent
NOBODY = 65534


def record(number: int, **changes: object) -> CycleRecord:
    base = CycleRecord(number, number * 10**10, number * 10**10 + 9 * 10**9, samples=900)
    return dataclasses.replace(base, **changes)  # type: ignore[arg-type]


def estimate(number: int, estimator: str = "output_error", **changes: object) -> Estimate:
    rng = np.random.default_rng(number)
    values = (
        ParameterValue("K_in", rng.normal(), ParameterStatus.OK, "", 1e-3, 0.1 + 0.2, 1 / 3),
        ParameterValue("K_out", -0.0, ParameterStatus.AT_BOUND, "rests on 0"),
        ParameterValue("leak", np.nan, ParameterStatus.NOT_EXCITED, 'no "rest" – ünsicher'),
        ParameterValue(
            "pole", 5e-324, ParameterStatus.OK, "", np.inf, -np.inf, 1.7976931348623157e308
        ),
    )
    base = Estimate(
        model="press_cartridge",
        estimator=estimator,
        cycle=number,
        start_ns=number * 10**10 + 1,
        end_ns=number * 10**10 + 9_000_000_001,
        parameters=values,
        status=EstimateStatus.PARTIAL,
        reason="leak: no rest",
        mse_test=np.nan if number == 1 else rng.normal() ** 2,
        mse_train=1e-300,
        fit_test=-np.inf,
        fit_train=97.1,
        condition_number=np.inf,
        lag=3,
        noise_sigma=1.1e-3,
        counts=MaskCounts(811, 40, 30, 20, 10),
        missed_cycles=-1,
        used_by_trend=estimator == "output_error",
        reproducible=number % 2 == 0,
        trend_reason="output_error always feeds the trend" if number % 3 else "",
        disagreements=(
            Disagreement("kalman", "K_in", -1.5e-5 / 7, 1.0 / 3),
            Disagreement("kalman", "leak", 0.0, np.nan),
        )[: number % 3],
        guards=(
            Guard("identifiability", True, 0.1 / 3, 0.5, "largest error 3.3 %"),
            Guard("condition number", False, np.inf, 1e6, "not finite: \u221e"),
        )[: number % 3],
        conditions=(Condition("stroke", 0.28), Condition("load", np.nan))[: number % 3],
    )
    return dataclasses.replace(base, **changes)  # type: ignore[arg-type]


def both(number: int) -> list[Estimate]:
    return [estimate(number), estimate(number, "equation_error_qp4")]


def bits(values: Estimate) -> str:
    """Write every field with its type, floats by their bits: NaN equals NaN, -0.0 not 0.0."""

    def write(x: object) -> str:
        if dataclasses.is_dataclass(x):
            return ",".join(write(getattr(x, f.name)) for f in dataclasses.fields(x))
        if isinstance(x, tuple):
            return ";".join(map(write, x))
        return (
            np.float64(x).tobytes().hex() if isinstance(x, float) else f"{type(x).__name__}:{x!r}"
        )

    return write(values)


def filled(path: Path | str, cycles: int = 3) -> History:
    history = History(path)
    store_cycles(history, 1, cycles + 1)
    return history


def store_cycles(history: History, first: int, stop: int) -> None:
    for number in range(first, stop):
        history.store(VALVE, record(number), both(number))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "history.db"


class TestWhatIsStored:
    def test_comes_back_bit_for_bit_after_closing(self, file: Path) -> None:
        filled(file).close()
        with History(file) as again:
            got = again.estimates(VALVE)
        assert [bits(e) for e in got] == [bits(e) for n in (1, 2, 3) for e in both(n)]

    def test_can_be_asked_for_by_estimator_cycle_and_number(self, file: Path) -> None:
        with filled(file, 5) as history:
            assert [e.cycle for e in history.estimates(VALVE, "output_error", 2, 3)] == [2, 3, 4]
            assert {e.estimator for e in history.estimates(VALVE, used_by_trend=True)} == {
                "output_error"
            }
            assert [c.cycle for c in history.cycles(VALVE, first_cycle=4)] == [4, 5]
            assert [e.cycle for e in history.recent_estimates(VALVE, 2)] == [4, 4, 5, 5]
            assert history.estimates("/press/valve_2") == []
            assert history.recent_estimates("/press/valve_2") == []

    def test_includes_refused_cycles_with_their_reason(self, file: Path) -> None:
        refused = record(
            7,
            accepted=False,
            reason="shorter than 1 s",
            lost=3,
            missed_cycles=-1,
            software="0.1.0",
        )
        with History(file) as history:
            assert history.last_cycle(VALVE) == 0
            assert history.last_record(VALVE) is None
            history.store(VALVE, refused)
            assert history.cycles(VALVE) == [refused]
            assert history.last_cycle(VALVE) == 7

    def test_of_a_cycle_names_the_version_that_computed_it(self, file: Path) -> None:
        n = 5
        none = np.full(n, np.nan)
        stamps = np.arange(10, 10 + n)
        frames = Frames(stamps, np.zeros(n), np.zeros((n, 2)), none, none, np.ones(n, bool))
        cycle = Cycle(
            number=4, period_s=0.03, frames=frames, lost=2, reason="idle", reproducible=False
        )
        with History(file, software="0.3.1") as history:
            history.store(VALVE, cycle)
            got = history.last_record(VALVE)
        assert got == cycle_record(cycle, "0.3.1")
        assert got == CycleRecord(4, 10, 14, 5, 2, 0, True, "idle", False, "0.3.1")

    def test_keeps_valves_apart(self, file: Path) -> None:
        with filled(file, 2) as history:
            history.store("/press/valve_2", record(1), [estimate(1, lag=9)])
            assert history.valves() == ["/press/valve_1", "/press/valve_2"]
            assert [e.lag for e in history.estimates("/press/valve_2")] == [9]
            assert history.last_cycle(VALVE) == 2

    def test_twice_is_stored_once(self, file: Path) -> None:
        with History(file) as history:
            assert history.store(VALVE, record(1), both(1)) is True
            assert history.store(VALVE, record(1), both(1)) is False
            assert len(history.estimates(VALVE)) == 2

    @pytest.mark.parametrize(
        ("cycle", "estimates"),
        [
            (record(1, samples=899), both(1)),
            (record(1), [estimate(1)]),
            (record(1), [estimate(1, lag=4), both(1)[1]]),
            (record(1), [estimate(1, mse_train=1e-299), both(1)[1]]),
        ],
        ids=["cycle", "fewer estimates", "other lag", "other error"],
    )
    def test_is_never_changed(
        self, file: Path, cycle: CycleRecord, estimates: list[Estimate]
    ) -> None:
        with History(file) as history:
            history.store(VALVE, record(1), both(1))
            with pytest.raises(
                StoreError,
                match=r"cycle 1 of /press/valve_1 is already stored.*number the cycles on",
            ):
                history.store(VALVE, cycle, estimates)
            assert [bits(e) for e in history.estimates(VALVE)] == [bits(e) for e in both(1)]

    def test_must_fit_together(self, file: Path) -> None:
        with History(file) as history:
            with pytest.raises(ValueError, match="estimate of cycle 2 given with cycle 1"):
                history.store(VALVE, record(1), [estimate(2)])
            with pytest.raises(ValueError, match="estimator twice"):
                history.store(VALVE, record(1), [estimate(1), estimate(1)])
            assert history.cycles(VALVE) == []

    def test_maintenance_comes_back_in_order_and_once(self, file: Path) -> None:
        late, early = (
            Maintenance(9, 20, "seal", new_reference=True),
            Maintenance(5, 10, "sensor swap"),
        )
        with History(file) as history:
            assert history.add_maintenance(VALVE, late) is True
            assert history.add_maintenance(VALVE, early) is True
            assert history.add_maintenance(VALVE, late) is False
            assert history.maintenance(VALVE) == [early, late]
            assert history.maintenance(VALVE, first_cycle=11) == [late]


class TestDurability:
    def test_sqlite_flushes_every_commit(self, file: Path) -> None:
        with History(file) as history, history._database.engine.connect() as connection:
            assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
            assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == 2

    def test_no_acknowledged_cycle_is_lost_when_the_process_is_killed(
        self, file: Path, root: Path
    ) -> None:
        rng = random.Random(5)
        acknowledged: list[int] = []
        command = [sys.executable, str(HERE / "crash_writer.py"), str(file)]
        environment = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"}
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        ) as parent:
            assert parent.stdin is not None
            assert parent.stdout is not None
            for _ in range(20):
                parent.stdin.write("go\n")
                parent.stdin.flush()
                child = int(parent.stdout.readline())
                acknowledged += [int(parent.stdout.readline()) for _ in range(rng.randint(0, 12))]
                # some way into the next transaction, nobody knows how far
                for _ in range(rng.randint(0, 30_000)):
                    pass
                os.kill(child, signal.SIGKILL)
                while (line := parent.stdout.readline().strip()) != "ended":
                    acknowledged.append(int(line))
            parent.stdin.close()
        assert len(acknowledged) > 50
        with History(file) as history:
            stored = [c.cycle for c in history.cycles(VALVE)]
            estimated = [e.cycle for e in history.estimates(VALVE)]
        assert set(acknowledged) <= set(stored)
        assert stored == list(range(1, len(stored) + 1))
        assert estimated == [
            n for n in stored for _ in range(2)
        ]  # a cycle is there with all its estimates

    def test_a_write_ahead_log_left_by_a_killed_process_is_read(
        self, file: Path, tmp_path: Path
    ) -> None:
        history = filled(file)
        left = tmp_path / "left.db"
        for tail in ("", "-wal"):
            shutil.copy(
                f"{file}{tail}", f"{left}{tail}"
            )  # what a dead process leaves: nothing checkpointed
        history.close()
        assert Path(f"{left}-wal").stat().st_size > 0
        with History(left) as again:
            assert [bits(e) for e in again.estimates(VALVE)] == [
                bits(e) for n in (1, 2, 3) for e in both(n)
            ]

    def test_threads_and_processes_may_share_a_file(self, file: Path) -> None:
        with History(file) as first, History(file) as second:

            def fill(history: History, valve: str) -> None:
                for number in range(1, 16):
                    history.store(valve, record(number), both(number))

            jobs = [(first, "/a"), (first, "/b"), (second, "/c"), (second, "/d")]
            threads = [threading.Thread(target=fill, args=job) for job in jobs]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert {v: second.last_cycle(v) for v in second.valves()} == dict.fromkeys(
                ["/a", "/b", "/c", "/d"], 15
            )


class TestErrors:
    """Each is one line with the file, the fault and the remedy; nothing is half written."""

    def test_locked(self, file: Path) -> None:
        filled(file).close()
        with closing(sqlite3.connect(file, isolation_level=None)) as other:
            history = History(file, busy_timeout_s=0.05)
            other.execute("BEGIN IMMEDIATE")
            with pytest.raises(
                StoreError, match=r"history.db: cannot be written: database is locked: another"
            ):
                history.store(VALVE, record(4), both(4))
            assert history.last_cycle(VALVE) == 3
            other.execute("ROLLBACK")
            assert history.store(VALVE, record(4), both(4))
            history.close()

    def test_read_only_file(self, file: Path) -> None:
        filled(file).close()
        file.parent.chmod(0o555)
        file.chmod(0o444)
        try:
            with (
                unprivileged(file.parent),
                pytest.raises(StoreError, match=r"history.db: .*give this user write access"),
            ):
                History(file)
            with unprivileged(file.parent), History(file, read_only=True) as history:
                assert len(history.estimates(VALVE)) == 6
        finally:
            file.parent.chmod(0o755)

    def test_opened_for_reading(self, file: Path) -> None:
        filled(file).close()
        with History(file, read_only=True) as history:
            assert len(history.estimates(VALVE)) == 6
            with pytest.raises(StoreError, match="opened for reading only"):
                history.store(VALVE, record(4), both(4))

    def test_reading_where_there_is_no_file(self, file: Path) -> None:
        with pytest.raises(StoreError, match="there is no such file"):
            History(file, read_only=True)
        assert not file.exists()

    def test_disk_full_leaves_no_part_of_a_cycle(self, file: Path) -> None:
        with filled(file) as history:
            driver = history._database.driver  # a disk with room for what is there
            (pages,) = driver.execute("PRAGMA page_count").fetchone()
            driver.execute(f"PRAGMA max_page_count={pages}")
            with pytest.raises(
                StoreError, match=r"disk is full: free some space.*what is stored is intact"
            ):
                store_cycles(history, 4, 100)
            stored = [c.cycle for c in history.cycles(VALVE)]
            assert [e.cycle for e in history.estimates(VALVE)] == [
                n for n in stored for _ in range(2)
            ]

    def test_an_error_between_cycle_and_estimates_leaves_neither(self, file: Path) -> None:
        with filled(file) as history:
            with history._database.engine.connect() as connection:
                connection.exec_driver_sql("DROP TABLE estimate")
                connection.commit()
            with pytest.raises(StoreError, match="no such table"):
                history.store(VALVE, record(4), both(4))
            assert history.last_cycle(VALVE) == 3

    def test_not_a_database(self, file: Path) -> None:
        file.write_text("cycle,K_in\n1,0.1\n" * 100)
        with pytest.raises(
            StoreError, match=r"history.db: .*file is not a database: .*name another file"
        ) as caught:
            History(file)
        assert "\n" not in str(caught.value)
        assert file.read_text().startswith("cycle,K_in")

    def test_damaged(self, file: Path) -> None:
        filled(file, 30).close()
        content = bytearray(file.read_bytes())
        content[8 * 4096 : 12 * 4096] = bytes(4 * 4096)
        file.write_bytes(content)
        with pytest.raises(StoreError, match=r"damaged.*last backup"):
            History(file)

    def test_database_of_another_application(self, file: Path) -> None:
        with closing(sqlite3.connect(file)) as other:
            other.execute("CREATE TABLE invoices (id)")
        with pytest.raises(
            StoreError, match=r"of another application .table 'invoices'.: name another file"
        ):
            History(file)
        with closing(sqlite3.connect(file)) as other:
            assert other.execute("SELECT name FROM sqlite_master").fetchall() == [("invoices",)]

    def test_missing_folder(self, tmp_path: Path) -> None:
        with pytest.raises(StoreError, match=r"nowhere/h.db: .*the folder must exist"):
            History(tmp_path / "nowhere" / "h.db")

    @pytest.mark.parametrize(
        ("url", "message"),
        [
            (
                "mysql://a:secret@host/db",
                r"'mysql://a:\*\*\*@host/db': database 'mysql' is not supported",
            ),
            ("://x", "no database URL: write a file path"),
            ("sqlite://", "would be lost: name a file"),
            (
                "postgresql://a:secret@127.0.0.1:1/db",
                r"a:\*\*\*@127.0.0.1:1/db: .*is the server running",
            ),
        ],
    )
    def test_url(self, url: str, message: str) -> None:
        with pytest.raises(StoreError, match=message) as caught:
            History(url)
        assert "secret" not in str(caught.value)
        assert "\n" not in str(caught.value)


class TestSchema:
    def test_of_the_first_version_is_upgraded_and_all_data_kept(self, file: Path) -> None:
        with closing(sqlite3.connect(file)) as old:
            old.executescript((HERE / "data" / "history_0001.sql").read_text(encoding="utf-8"))
        with History(file, software="0.2.0") as history:
            assert [(c.cycle, c.lost, c.samples, c.software) for c in history.cycles(VALVE)] == [
                (41, 0, 500, ""),
                (42, 1, 500, ""),
            ]
            estimates = history.estimates(VALVE, "output_error")
            assert [e.value("K_in") for e in estimates] == [0.1 + 41 / 7, 0.1 + 42 / 7]
            assert [e.parameters[1].status for e in estimates] == [ParameterStatus.NOT_EXCITED] * 2
            assert estimates[0].counts == MaskCounts(480, 1, 2, 3, 4)
            assert history.maintenance(VALVE) == [
                Maintenance(41_500_000_000, 42, "new seal", new_reference=True)
            ]
            assert history.store(VALVE, record(43), both(43))
        assert version(file) == SCHEMA_VERSION

    def test_before_verdicts_named_their_fault_is_upgraded(self, file: Path) -> None:
        check_upgrade_of_verdicts(f"sqlite:///{file}", f"sqlite:///{file}")
        assert version(file) == SCHEMA_VERSION

    def test_of_the_first_version_is_not_touched_by_a_reader(self, file: Path) -> None:
        with closing(sqlite3.connect(file)) as old:
            old.executescript((HERE / "data" / "history_0001.sql").read_text(encoding="utf-8"))
        with pytest.raises(StoreError, match="its schema is old: open it once with write access"):
            History(file, read_only=True)
        assert version(file) == "0001"

    def test_of_a_newer_version_is_refused_and_left_alone(self, file: Path) -> None:
        filled(file).close()
        with closing(sqlite3.connect(file)) as connection, connection:
            connection.execute(f"UPDATE {SCHEMA_TABLE} SET version_num = '0099'")
        with pytest.raises(
            StoreError, match=r"newer valve_twin .schema 0099, this one knows .*update valve_twin"
        ):
            History(file)
        assert version(file) == "0099"

    def test_after_all_migrations_is_the_one_the_code_uses(self, file: Path) -> None:
        from alembic.autogenerate import compare_metadata
        from alembic.runtime.migration import MigrationContext

        engine = sa.create_engine(f"sqlite:///{file}")
        with engine.begin() as connection:
            migrate(connection)
        with engine.connect() as connection:
            context = MigrationContext.configure(connection, opts={"version_table": SCHEMA_TABLE})
            assert compare_metadata(context, METADATA) == []
            assert context.get_current_revision() == SCHEMA_VERSION
        engine.dispose()

    def test_of_a_new_file_is_what_all_migrations_lead_to(self, file: Path) -> None:
        History(file).close()
        migrated = file.with_name("migrated.sqlite")
        engine = sa.create_engine(f"sqlite:///{migrated}")
        with engine.begin() as connection:
            migrate(connection)
        engine.dispose()
        assert version(file) == version(migrated) == SCHEMA_VERSION
        assert described(file) == described(migrated)

    @pytest.mark.parametrize("cycles", [0, 3])
    def test_needs_no_migration_tool_when_it_is_new_or_current(
        self, file: Path, root: Path, cycles: int
    ) -> None:
        if cycles:
            filled(file).close()
        code = (
            "import sys; from valve_twin.io.history.store import History;"
            "h = History(sys.argv[1]);"
            f"assert h.last_cycle('/press/valve_1') == {cycles};"
            "assert 'alembic' not in sys.modules"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, str(file)],
            env={**os.environ, "PYTHONPATH": str(root)},
            check=False,
        )
        assert done.returncode == 0


class TestCopies:
    def test_backup_is_one_complete_file_while_another_process_writes(
        self, file: Path, tmp_path: Path
    ) -> None:
        with filled(file, 5) as history, History(file) as writer:
            stop = threading.Event()

            def write() -> None:
                number = 5
                while not stop.is_set():
                    number += 1
                    writer.store(VALVE, record(number), both(number))

            thread = threading.Thread(target=write)
            thread.start()
            try:
                copies = [history.backup(tmp_path / f"copy{i}.db") for i in range(3)]
            finally:
                stop.set()
                thread.join()
            last = history.last_cycle(VALVE)
        assert sorted(p.name for p in tmp_path.glob("copy*")) == [
            "copy0.db",
            "copy1.db",
            "copy2.db",
        ]
        for copy in copies:
            with History(copy, read_only=True) as saved:
                cycles = [c.cycle for c in saved.cycles(VALVE)]
                assert cycles == list(range(1, len(cycles) + 1))
                assert 5 <= len(cycles) <= last
                assert [e.cycle for e in saved.estimates(VALVE)] == [
                    n for n in cycles for _ in range(2)
                ]

    def test_backups_at_a_time_under_names_that_begin_alike_are_kept_apart(
        self, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The first to end took the file that both wrote, and the other had none."""
        together, seal = threading.Barrier(2, timeout=30.0), export._seal
        monkeypatch.setattr(export, "_seal", lambda *given: (together.wait(), seal(*given)))
        alike = "press_cartridge_line_three_station_twelve_history_of_2026"
        wanted = {n: tmp_path / f"{alike}_{n}.sqlite" for n in (2, 3)}

        def back_up(count: int) -> None:
            with filled(file.with_name(f"{count}.db"), count) as history:
                history.backup(wanted[count])

        threads = [threading.Thread(target=back_up, args=(n,)) for n in wanted]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for count, path in wanted.items():
            with History(path, read_only=True) as saved:
                assert saved.last_cycle(VALVE) == count

    def test_the_name_of_a_backup_is_on_the_disk(
        self, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        done: list[str] = []
        sync, replace = os.fsync, os.replace

        def synced(number: int) -> None:
            done.append(os.readlink(f"/proc/self/fd/{number}"))
            sync(number)

        def replaced(part: Path, target: Path) -> None:
            done.append(str(target))
            replace(part, target)

        with filled(file) as history:
            monkeypatch.setattr(os, "fsync", synced)
            monkeypatch.setattr(os, "replace", replaced)
            history.backup(tmp_path / "copy.db")
        assert done[-2:] == [str(tmp_path / "copy.db"), str(tmp_path)]

    def test_backup_without_a_name_is_dated_and_beside_the_history(self, file: Path) -> None:
        with filled(file) as history:
            first, second = history.backup(), history.backup()
        assert first != second
        assert first.parent == file.parent
        assert first.name.startswith("history-2")

    def test_backup_never_overwrites(self, file: Path, tmp_path: Path) -> None:
        (tmp_path / "taken.db").write_text("precious")
        with filled(file) as history:
            with pytest.raises(
                StoreError, match=r"taken.db: exists already and is not overwritten"
            ):
                history.backup(tmp_path / "taken.db")
            with pytest.raises(StoreError, match=r"missing/copy.db: cannot be written"):
                history.backup(tmp_path / "missing" / "copy.db")
        assert (tmp_path / "taken.db").read_text() == "precious"

    def test_export_writes_tables_and_lines_that_other_programs_read(
        self, file: Path, tmp_path: Path
    ) -> None:
        with filled(file, 2) as history:
            history.add_maintenance(VALVE, Maintenance(5, 2, "seal, new", new_reference=True))
            files = history.export(tmp_path / "out")
        assert [f.name for f in files] == [
            "cycles.csv",
            "estimates.csv",
            "maintenance.csv",
            "condensates.csv",
            "history.jsonl",
        ]
        cycles, estimates, maintenance = (
            list(csv.DictReader(f.read_text(encoding="utf-8").splitlines())) for f in files[:3]
        )
        assert [row["cycle"] for row in cycles] == ["1", "2"]
        assert maintenance[0]["note"] == "seal, new"
        assert len(estimates) == 2 * 2 * 4
        assert float(estimates[0]["value"]) == estimate(1).parameters[0].value
        assert estimates[2]["value"] == ""
        assert estimates[2]["parameter_status"] == "NOT_EXCITED"
        assert estimates[3]["standard_error"] == "inf"
        lines = [json.loads(line) for line in files[-1].read_text(encoding="utf-8").splitlines()]
        assert [line["kind"] for line in lines] == ["cycle"] * 2 + ["estimate"] * 4 + [
            "maintenance"
        ]
        assert lines[2]["parameters"][0]["value"] == estimate(1).parameters[0].value
        assert lines[2]["mse_test"] is None

    def test_export_into_a_file_is_refused(self, file: Path) -> None:
        with (
            filled(file) as history,
            pytest.raises(StoreError, match=r"history.db: cannot be written"),
        ):
            history.export(file)


class TestPostgresql:
    def test_serves_like_sqlite(self, server: str, tmp_path: Path) -> None:
        with History(server) as history:
            for number in (1, 2):
                assert history.store(VALVE, record(number), both(number))
            assert not history.store(VALVE, record(2), both(2))
            with pytest.raises(StoreError, match="already stored with other content"):
                history.store(VALVE, record(2, lost=7), both(2))
            history.add_maintenance(VALVE, Maintenance(5, 2, "seal"))
        with History(server) as again:
            assert [bits(e) for e in again.estimates(VALVE)] == [
                bits(e) for n in (1, 2) for e in both(n)
            ]
            assert again.last_record(VALVE) == record(2)
            assert again.maintenance(VALVE) == [Maintenance(5, 2, "seal")]
            copy = again.backup(tmp_path / "copy.db")
            assert len(again.export(tmp_path / "out")) == 5
        with History(copy) as saved:
            assert [bits(e) for e in saved.estimates(VALVE)] == [
                bits(e) for n in (1, 2) for e in both(n)
            ]
            assert saved.store(VALVE, record(3), both(3))

    def test_commits_synchronously_and_survives_a_lost_connection(self, server: str) -> None:
        with History(server) as history:
            history.store("/other", record(1), both(1))
            with history._database.engine.connect() as connection:
                assert connection.exec_driver_sql("SHOW synchronous_commit").scalar() == "on"
            engine = sa.create_engine(server.replace("postgresql:", "postgresql+psycopg:"))
            with engine.connect() as connection:
                connection.exec_driver_sql(
                    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <>"
                    " pg_backend_pid()"
                    " AND usename = 'valve'"
                )
            engine.dispose()
            assert history.store("/other", record(2), both(2))
            assert history.last_cycle("/other") == 2

    def test_one_valve_has_one_writer_until_its_connection_ends(self, server: str) -> None:
        with History(server) as first, History(server) as second:
            first.claim("/claimed")
            second.claim("/else")
            with pytest.raises(StoreError, match="/claimed is already written by another twin"):
                second.claim("/claimed")
            assert first.store("/claimed", record(1), both(1))
            first.close()
            second.claim("/claimed")
            assert second.store("/claimed", record(2), both(2))

    def test_before_verdicts_named_their_fault_is_upgraded(self, server: str) -> None:
        engine = sa.create_engine(server.replace("postgresql:", "postgresql+psycopg:"))
        with engine.begin() as connection:
            connection.exec_driver_sql("CREATE SCHEMA before")
        engine.dispose()
        url = f"{server}&options=-csearch_path%3Dbefore"
        check_upgrade_of_verdicts(url, url.replace("postgresql:", "postgresql+psycopg:"))

    def test_locked_table_is_named(self, server: str) -> None:
        with History(server, busy_timeout_s=0.05) as history:
            history.store("/locked", record(1), both(1))
            engine = sa.create_engine(server.replace("postgresql:", "postgresql+psycopg:"))
            with engine.begin() as other:
                other.exec_driver_sql("LOCK TABLE cycle IN EXCLUSIVE MODE")
                with pytest.raises(StoreError, match="lock timeout: another program holds a lock"):
                    history.store("/locked", record(2), both(2))
            engine.dispose()
            assert history.store("/locked", record(2), both(2))


def check_upgrade_of_verdicts(url: str, driver_url: str) -> None:
    """Upgrade a database of revision 0004 that holds a verdict, and go on with it."""
    evidence = "offset of the position sensor, since cycle 41"
    engine = sa.create_engine(driver_url)
    with engine.begin() as connection:
        migrate(connection, "0004")
        connection.execute(VALVE_TABLE.insert(), {"id": 1, "name": VALVE})
        connection.exec_driver_sql(
            "INSERT INTO verdict (valve_id, stamp_ns, verdict, evidence, cycle)"
            f" VALUES (1, 5, 4, '{evidence}', 41)"
        )
    engine.dispose()
    kind = VerdictKind.SENSOR
    old = Verdict(5, VALVE, kind, kind.text, evidence, 41)
    new = dataclasses.replace(old, cycle=42, fault="sensor_offset")
    with History(url) as history:
        assert history.verdicts(VALVE) == [old]
        assert history.add_verdict(VALVE, new)
        assert not history.add_verdict(VALVE, dataclasses.replace(new, cycle=43))
        assert history.verdicts(VALVE) == [old, new]


def version(file: Path) -> str:
    with closing(sqlite3.connect(file)) as connection:
        return str(connection.execute(f"SELECT version_num FROM {SCHEMA_TABLE}").fetchone()[0])


def described(file: Path) -> dict[str, object]:
    """Return tables, columns, keys and indexes of a database; the order of columns is none's."""
    engine = sa.create_engine(f"sqlite:///{file}")
    look = sa.inspect(engine)
    found: dict[str, object] = {}
    for table in look.get_table_names():
        columns = {
            c["name"]: (str(c["type"]), c["nullable"], c["default"])
            for c in look.get_columns(table)
        }
        constraints = {
            (tuple(c["column_names"]), c["name"]) for c in look.get_unique_constraints(table)
        }
        indexes = {(i["name"], tuple(i["column_names"])) for i in look.get_indexes(table)}
        keys = {tuple(k["constrained_columns"]) for k in look.get_foreign_keys(table)}
        primary = look.get_pk_constraint(table)
        found[table] = columns, constraints, indexes, keys, primary
    engine.dispose()
    return found


@contextmanager
def unprivileged(folder: Path) -> Iterator[None]:
    """Act as a user without special rights: to root every file can be written."""
    if os.geteuid() != 0:
        yield
        return
    for parent in folder.parents[:3]:
        parent.chmod(parent.stat().st_mode | 0o055)
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)
