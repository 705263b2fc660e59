# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write topics of a bag, or the signals of a valve, as tables: CSV or Parquet.

One row a message: log time and publish time [ns], then every field of the message by its path.
Arrays take one column an element; where arrays differ in length, what is not there is empty.
"""

from __future__ import annotations

import csv
import os
import shutil
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from valve_twin.core.quantity import suggest
from valve_twin.io.bags.contents import bag_info, bag_types, compare_with_data, topic_name
from valve_twin.io.bags.signals import read_columns
from valve_twin.io.errors import BagError, unwritable
from valve_twin.io.limits import no_formula
from valve_twin.io.playback.player import read_messages
from valve_twin.io.whole import part_of, placed, sync_file

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from valve_twin.io.cdr.message_types import Message
    from valve_twin.io.config.valve import ValveConfig

Cell: TypeAlias = "int | float | str | bool | bytes | None"
FORMATS = (".csv", ".parquet")
LOG_TIME, PUBLISH_TIME = "log_time_ns", "publish_time_ns"
STAMP = "stamp_ns"
MAX_COLUMNS = 4096
"""Most columns of a table: a message with longer arrays is no table."""


@dataclass(frozen=True, slots=True)
class Table:
    """Named columns of equal length."""

    columns: dict[str, list[Cell]]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return max(map(len, self.columns.values()), default=0)


@dataclass(frozen=True, slots=True)
class Written:
    """One file that was written."""

    path: Path
    topic: str
    rows: int
    columns: int


def check_format(out: str | Path) -> None:
    """Check the ending of a file name and that what it needs is installed.

    Raises
    ------
    BagError
        If it is neither .csv nor .parquet, or pyarrow is not installed.
    """
    ending = Path(out).suffix.lower()
    if ending not in FORMATS:
        msg = f"{out}: cannot be written as '{ending}'; end it in .csv or .parquet"
        raise BagError(msg)
    if ending == ".parquet":
        try:
            import pyarrow.parquet  # type: ignore[import-untyped]  # noqa: F401
        except ImportError as err:
            msg = f"{out}: Parquet needs pyarrow; pip install 'valve_twin[parquet]', or write .csv"
            raise BagError(msg) from err


def convert_topics(path: str | Path, out: str | Path, topics: Sequence[str] = ()) -> list[Written]:
    """Write topics as tables; several give one file each, OUT.topic_name.csv.

    Parameters
    ----------
    path : path
        The bag; of a damaged one what is intact.
    out : path
        File to write, .csv or .parquet.
    topics : sequence of str
        Only these; empty = all that hold messages.

    Returns
    -------
    list of Written
        The files.

    Raises
    ------
    BagError
        If the bag cannot be read, a topic is not there, or a file cannot be written.
    """
    check_format(out)
    compare_with_data(path)
    counts = {t.name: t.count for t in bag_info(path).topics}
    wanted = [topic_name(t) for t in topics] or [n for n, count in counts.items() if count]
    for name in wanted:
        if name not in counts:
            msg = f"{path}: there is no topic '{name}'; {suggest(name, counts)}"
            raise BagError(msg)
    if not wanted:
        msg = f"{path}: the bag is empty; record it again"
        raise BagError(msg)
    out = Path(out)
    written = []
    for name in wanted:
        target = out
        if len(wanted) > 1:
            part = name.strip("/").replace("/", "_")
            target = out.with_name(f"{out.stem}.{part}{out.suffix}")
        table = topic_table(path, name)
        write_table(table, target)
        written.append(Written(target, name, table.rows, len(table.columns)))
    return written


def convert_signals(path: str | Path, out: str | Path, config: ValveConfig) -> Written:
    """Write the signals of a valve in their units, one row a stamp; empty where there is no value.

    Parameters
    ----------
    path : path
        The bag.
    out : path
        File to write, .csv or .parquet.
    config : ValveConfig
        Maps topics to signals.

    Returns
    -------
    Written
        The file.

    Raises
    ------
    BagError, ConfigError
        As `convert_topics`.
    """
    check_format(out)
    sources = list(config.signals.values())
    found = read_columns(path, sources)
    stamps = np.unique(np.concatenate([c.stamp_ns for c in found]))
    columns: dict[str, list[Cell]] = {STAMP: stamps.tolist()}
    for source, column in zip(sources, found, strict=True):
        cells: list[Cell] = [None] * len(stamps)
        places = np.searchsorted(stamps, column.stamp_ns).tolist()
        for place, value in zip(places, column.values.tolist(), strict=True):
            cells[place] = value
        columns[source.signal] = cells
    table = Table(columns)
    write_table(table, Path(out))
    return Written(Path(out), "", table.rows, len(columns))


def topic_table(path: str | Path, topic: str) -> Table:
    """Return a topic as a table.

    Raises
    ------
    BagError
        If it cannot be read or has too many columns.
    """
    types = bag_types(path, topic)
    columns: dict[str, list[Cell]] = {LOG_TIME: [], PUBLISH_TIME: []}
    for row, message in enumerate(read_messages(path, [topic])):
        cells: list[tuple[str, Cell]] = [
            (LOG_TIME, message.log_ns),
            (PUBLISH_TIME, message.publish_ns),
        ]
        cells += flatten(types.decode(message.data, message.log_ns))
        for name, value in cells:
            column = columns.get(name)
            if column is None:
                column = columns[name] = [None] * row
                _check_width(path, topic, len(columns))
            column.append(value)
        if len(cells) != len(columns):
            for column in columns.values():
                if len(column) <= row:
                    column.append(None)
    return Table(columns)


def _check_width(path: str | Path, topic: str, width: int) -> None:
    if width > MAX_COLUMNS:
        msg = (
            f"{path}: topic '{topic}' takes more than {MAX_COLUMNS} columns; "
            "leave it out with --topics"
        )
        raise BagError(msg)


def flatten(value: Message, name: str = "") -> Iterator[tuple[str, Cell]]:
    """Yield the numbers and texts in a message by their paths: "pose.x", "values[3]"."""
    if is_dataclass(value):
        for field in value.__dataclass_fields__:
            if not field.startswith("__"):
                yield from flatten(getattr(value, field), f"{name}.{field}" if name else field)
    elif isinstance(value, np.ndarray):
        yield from ((f"{name}[{i}]", cell) for i, cell in enumerate(value.reshape(-1).tolist()))
    elif isinstance(value, list):
        for i, cell in enumerate(value):
            yield from flatten(cell, f"{name}[{i}]")
    elif isinstance(value, np.generic):
        yield name, value.item()
    else:
        yield name, value


def write_table(table: Table, path: Path) -> None:
    """Write a table beside its place and move it there: it is whole or not there.

    Raises
    ------
    BagError
        If it cannot be written.
    """
    check_format(path)
    write = _write_csv if path.suffix.lower() == ".csv" else _write_parquet
    target = Path(os.path.realpath(path))  # a link stays one, as where others are written
    try:
        with placed(target, part_of(target)) as part:
            write(table, part)
            sync_file(part)
            if target.exists():
                shutil.copymode(target, part)
    except OSError as err:
        raise BagError(unwritable(path, err)) from err


def _write_csv(table: Table, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow([no_formula(name) for name in table.columns])
        for row in zip(*table.columns.values(), strict=True):
            writer.writerow([_csv_cell(cell) for cell in row])


def _csv_cell(cell: Cell) -> Cell:
    """Return a cell as it is written: numbers in full."""
    if isinstance(cell, bool):
        return int(cell)
    if isinstance(cell, float):
        return repr(cell)  # reads back as the same number; nan and inf are words
    return f"{no_formula(cell)}" if isinstance(cell, str) else cell


def _write_parquet(table: Table, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {name: pa.array(cells) for name, cells in table.columns.items()}
    pq.write_table(pa.table(arrays), path, compression="zstd")
