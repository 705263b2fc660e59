# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The database under the history: durable commits, schema upgrades, errors in plain words.

SQLite runs in WAL mode with synchronous=FULL: a commit returns after its bytes were flushed to the
disk. Writers take the write lock at BEGIN, so that a transaction either waits or fails at its
start and never in its middle.
"""

from __future__ import annotations

import sqlite3
import threading
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa
from sqlalchemy.engine import URL, Connection, Engine, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError, NoSuchTableError

from valve_twin.io.errors import StoreError, unusable
from valve_twin.io.history.check_sums import SEALED_SINCE, seal_all
from valve_twin.io.history.errors import explain
from valve_twin.io.history.migrations.schema import create, migrate
from valve_twin.io.history.tables import METADATA, SCHEMA_TABLE, SCHEMA_VERSION
from valve_twin.io.history.valves.names import seal_names, sound_names
from valve_twin.io.history.wal.watch import FileWatch, Trouble

if TYPE_CHECKING:
    from collections.abc import Iterator

_ADVISORY_LOCK = 0x56414C56
"""Key of the PostgreSQL lock that lets one process at a time upgrade the schema ("VALV")."""

_LACKS_LOG = "unable to get the page. error code=522"
"""What SQLite says of a page that stands nowhere, though the index of the log knows it."""


class Database:
    """Connections to one database; every error that leaves it is a `StoreError` of one line.

    Parameters
    ----------
    url : str
        Path of a SQLite file, or a URL: sqlite:///relative.db, sqlite:////absolute.db,
        postgresql://user@host/name.
    read_only : bool
        Never write; the database must exist and be current.
    busy_timeout_s : float
        How long to wait for another program's lock [s].

    Raises
    ------
    StoreError
        If the database cannot be used.
    """

    def __init__(self, url: str, *, read_only: bool = False, busy_timeout_s: float = 5.0) -> None:
        self.url = _parse_url(url)
        self.read_only = read_only
        self.file = Path(self.url.database or "") if self.is_sqlite else None
        self.where = place_of(url)
        self._busy_timeout_s = busy_timeout_s
        self.files = FileWatch(self.file, lambda: self.driver) if self.file else None
        self._kept: Connection | None = None
        self._turn = threading.Lock()
        self.engine = self._make_engine()
        try:
            with self.errors("opened"):
                self._open()
        except StoreError:
            self.close()
            raise

    @property
    def is_sqlite(self) -> bool:
        """Whether this is a SQLite file."""
        return self.url.get_backend_name() == "sqlite"

    def close(self) -> None:
        """Give all connections back."""
        if self.files is not None:
            self.files.close()
        self._let_go()

    def _let_go(self) -> None:
        with self._turn, self.files.index.left_alone() if self.files else nullcontext():
            if self._kept is not None:
                self._kept.close()
                self._kept = None
            self.engine.dispose()

    def again(self) -> Database:
        """Open what stands under the name now, as at the first time."""
        return Database(
            self.url.render_as_string(hide_password=False), busy_timeout_s=self._busy_timeout_s
        )

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """Run one transaction that is on the disk when the block ends, or leaves nothing.

        Raises
        ------
        StoreError
            If it was not stored.
        """
        with self.errors("written"):
            if self.read_only:
                msg = f"{self.where}: cannot be written: it was opened for reading only"
                raise StoreError(msg)
            self.check_file()
            with self.transaction() as connection:
                self.check_file()
                before = self._changes()
                yield connection
                grown = self._changes() > before
            self.check_file(grown=grown)

    @contextmanager
    def transaction(self) -> Iterator[Connection]:
        """Run one transaction in what is open, whatever stands under its name by now."""
        if not self.is_sqlite:
            with self.engine.begin() as connection:
                yield connection
            return
        with self._turn:
            kept = self.kept()
            with kept.begin():
                yield kept

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """Run reads that all see one state of the database."""
        self.mend_index()
        level: dict[str, Any] = {} if self.is_sqlite else {"isolation_level": "REPEATABLE READ"}
        with (
            self.errors("read"),
            self.engine.connect().execution_options(**level) as connection,
            connection.begin(),
        ):
            yield connection
            if self.files is not None:
                self.files.adopt_index()

    @contextmanager
    def errors(self, done: str) -> Iterator[None]:
        """Turn the driver's errors into one line: what, why, what to do."""
        try:
            yield
        except (DBAPIError, sqlite3.Error) as err:
            msg = f"{self.where}: cannot be {done}: {explain(err, sqlite=self.is_sqlite)}"
            raise StoreError(msg) from err
        except (UnicodeDecodeError, NoSuchTableError) as err:
            msg = (
                f"{self.where}: cannot be {done}: the file is damaged ({err}): move it away and"
                " put the last backup in its place"
            )
            raise StoreError(msg) from err
        except OSError as err:
            raise StoreError(unusable(f"{self.where}: cannot be {done}", err)) from err

    def kept(self) -> Connection:
        """Return the one connection that lives as long as the database is open (SQLite)."""
        if self._kept is None:
            self._kept = self.engine.connect().execution_options(valve_twin_write=True)
        return self._kept

    @property
    def driver(self) -> sqlite3.Connection:
        """SQLite's own connection under `kept`: for copies and pragmas, outside a transaction."""
        driver = self.kept().connection.driver_connection
        assert isinstance(driver, sqlite3.Connection)
        return driver

    def trouble(self, *, grown: bool = False) -> Trouble | None:
        """Return what happened to the SQLite file: its commits would be lost.

        Parameters
        ----------
        grown : bool
            Whether something was just written, so that its log must have grown.
        """
        with self.errors("looked at"):
            return None if self.files is None else self.files.trouble(grown=grown)

    def mend_index(self) -> None:
        """Make the index of the log usable again where it is not; StoreError says why not."""
        if self.files is not None and self.files.thaw():
            self._let_go()
        if self.files is None or self.files.index_trouble() is None:
            return
        with self.errors("used"):
            self.files.mend_index(self.where, self._let_go)
            if not self.read_only:
                self._keep_open()

    def _changes(self) -> int:
        return self.driver.total_changes if self.is_sqlite else 0

    def check_file(self, *, grown: bool = False) -> None:
        """Refuse to go on with a SQLite file that is no longer there, or not whole.

        Raises
        ------
        StoreError
            If the path no longer leads to the files that were opened.
        """
        trouble = self.trouble(grown=grown)
        if trouble is not None:
            msg = (
                f"{self.where}: cannot be written: {trouble.value}: what was stored is kept and"
                " written again as soon as the place can be written"
            )
            raise StoreError(msg)

    def _make_engine(self) -> Engine:
        if self.is_sqlite:
            engine = sa.create_engine(
                self.url, creator=self._connect_sqlite, max_overflow=-1, paramstyle="named"
            )
            sa.event.listen(engine, "begin", _begin_sqlite)
            return engine
        timeout_ms = int(1e3 * self._busy_timeout_s)
        options = f"-c synchronous_commit=on -c lock_timeout={timeout_ms}"
        options += " -c default_transaction_read_only=on" if self.read_only else ""
        given = self.url.query.get("options")
        given_text = given if isinstance(given, str) else " ".join(given or ())
        try:
            return sa.create_engine(
                self.url.difference_update_query(["options"]),
                pool_pre_ping=True,
                connect_args={"connect_timeout": 10, "options": f"{options} {given_text}".strip()},
            )
        except ImportError as err:
            msg = (
                f"{self.where}: cannot be opened: the driver is not installed: python -m pip"
                " install 'psycopg[binary]'"
            )
            raise StoreError(msg) from err

    def _connect_sqlite(self) -> sqlite3.Connection:
        assert self.file is not None
        assert self.files is not None
        mode = self.files.open_mode(read_only=self.read_only)
        self.files.index.heal()
        connection = sqlite3.connect(
            f"{self.file.absolute().as_uri()}?mode={mode}",
            uri=True,
            timeout=self._busy_timeout_s,
            isolation_level=None,
            check_same_thread=False,
            cached_statements=256,
        )
        connection.text_factory = _text
        if self.read_only:
            return connection
        try:
            connection.execute("PRAGMA foreign_keys=ON")
            connection.execute("PRAGMA synchronous=FULL")
        except sqlite3.Error:
            connection.close()
            raise
        return connection

    def _open(self) -> None:
        if self.file is not None:
            if self.read_only:
                must_be_there(str(self.file))
            with self.engine.connect() as connection:
                self._check_content(connection)
                if not self.read_only:
                    connection.rollback()
                    self._set_wal(connection)
                assert self.files is not None
                self.files.adopt_index()
            self.files.mend_index(self.where, self._let_go)
            self.check_file()
        with self.engine.connect() as connection:
            current = self._schema_is_current(connection)
        if not current:
            if self.read_only:
                msg = (
                    f"{self.where}: cannot be read: its schema is old: open it once with write"
                    " access to upgrade it"
                )
                raise StoreError(msg)
            self._upgrade()
        with self.engine.connect() as connection:
            sound_names(connection, self.where)
        if self.file is not None and not self.read_only:
            self._keep_open()

    def _keep_open(self) -> None:
        """Hold a connection, so that the files stay reachable whatever happens to the path.

        Another one, for readers, stays in the pool.
        """
        self.driver.execute(f"SELECT count(*) FROM {SCHEMA_TABLE}").fetchone()  # takes no lock
        with self.read() as connection:
            self._schema_is_current(connection)
        assert self.files is not None
        self.files.begin()

    def _check_content(self, connection: Connection) -> None:
        problem = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar_one()
        if _LACKS_LOG in str(problem):
            msg = (
                f"{self.where}: cannot be read: its write-ahead log (-wal) was deleted or cut: a"
                " twin that writes it mends that with its next cycle; where none does, stop all"
                " that has it open, then try again"
            )
            raise StoreError(msg)
        if problem != "ok":
            msg = (
                f"{self.where}: the file is damaged ({str(problem).splitlines()[-1]}): move it"
                " away and put the last"
                " backup in its place"
            )
            raise StoreError(msg)

    def _set_wal(self, connection: Connection) -> None:
        driver = connection.connection.driver_connection
        assert driver is not None
        mode = driver.execute("PRAGMA journal_mode=WAL").fetchone()[0]
        if mode != "wal":
            msg = (
                f"{self.where}: cannot be opened: this file system allows no WAL (mode '{mode}'):"
                " use a local disk"
            )
            raise StoreError(msg)

    def _schema_is_current(self, connection: Connection) -> bool:
        tables = set(sa.inspect(connection).get_table_names())
        if SCHEMA_TABLE not in tables:
            foreign = tables if self.is_sqlite else tables & set(METADATA.tables)
            if foreign:
                msg = (
                    f"{self.where}: is a database of another application (table '{min(foreign)}'):"
                    " name another"
                    f" {'file' if self.is_sqlite else 'database or schema'}"
                )
                raise StoreError(msg)
            return False
        version = _version(connection)
        if version > SCHEMA_VERSION:
            msg = (
                f"{self.where}: was written by a newer valve_twin (schema {version}, this one"
                f" knows {SCHEMA_VERSION}):"
                " update valve_twin or name another database"
            )
            raise StoreError(msg)
        return version == SCHEMA_VERSION

    def _upgrade(self) -> None:
        with self.transaction() as connection:
            if not self.is_sqlite:
                connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_ADVISORY_LOCK)))
            if self._schema_is_current(connection):  # another process was faster
                return
            if not sa.inspect(connection).has_table(SCHEMA_TABLE):
                create(connection)
                return
            before = _version(connection)
            migrate(connection)
            if before < SEALED_SINCE:
                seal_all(connection)
            seal_names(connection)


def _version(connection: Connection) -> str:
    schema = sa.table(SCHEMA_TABLE, sa.column("version_num"))
    return connection.scalar(sa.select(schema.c.version_num)) or ""


def must_be_there(url: str) -> None:
    """Refuse the URL of a SQLite file that is not there, which to open would make."""
    parsed = _parse_url(url)
    if parsed.get_backend_name() == "sqlite" and not Path(parsed.database or "").is_file():
        msg = f"{place_of(url)}: cannot be opened: there is no such file: check the path"
        raise StoreError(msg)


def place_of(url: str) -> str:
    """Return file or URL of a database, without a password.

    Parameters
    ----------
    url : str
        As `Database` takes it.

    Raises
    ------
    StoreError
        If it is none.
    """
    parsed = _parse_url(url)
    sqlite = parsed.get_backend_name() == "sqlite"
    return str(Path(parsed.database or "")) if sqlite else _shown(parsed)


def _shown(url: sa.URL) -> str:
    """Return a URL without its password, wherever it stands in it."""
    return url.difference_update_query(("password", "passfile")).render_as_string()


def _parse_url(text: str) -> URL:
    if "://" not in text:
        text = f"sqlite:///{text}"
    try:
        url = make_url(text)
        backend = url.get_backend_name()
        if backend == "postgresql":
            url = url.set(drivername="postgresql+psycopg")
    except (ArgumentError, NoSuchModuleError) as err:
        msg = (
            f"history '{text}': no database URL: write a file path, sqlite:///file.db or"
            " postgresql://user@host/name"
        )
        raise StoreError(msg) from err
    if backend not in {"sqlite", "postgresql"}:
        msg = (
            f"history '{_shown(url)}': database '{backend}' is not supported: use"
            " sqlite:///file.db or postgresql://..."
        )
        raise StoreError(msg)
    if backend == "sqlite" and url.database in {None, "", ":memory:"}:
        msg = (
            f"history '{text}': a history in memory would be lost: name a file, e.g."
            " sqlite:///history.db"
        )
        raise StoreError(msg)
    return url


def _text(data: bytes) -> str:
    """Read a text; what is damaged in it stays so, for its check sum to tell."""
    return data.decode("utf-8", "surrogateescape")


def _begin_sqlite(connection: Connection) -> None:
    write = connection.get_execution_options().get("valve_twin_write", False)
    driver = (
        connection.connection.driver_connection
    )  # past the layers above: BEGIN has no parameters
    assert driver is not None
    driver.execute("BEGIN IMMEDIATE" if write else "BEGIN")
