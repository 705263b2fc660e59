# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read a file of any instrument: what it is shows its beginning, not its name."""

from __future__ import annotations

import logging
import warnings
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from valve_twin.io.apart import run_apart
from valve_twin.io.errors import BagError
from valve_twin.io.instruments.clock import ClockChoice, with_clock
from valve_twin.io.instruments.derived import resampled
from valve_twin.io.instruments.table import load_package
from valve_twin.io.limits import TOO_MUCH, bounded_memory

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from valve_twin.io.instruments.cells import RawColumn, Sheet
    from valve_twin.io.instruments.table import Column, Recording

    _Channel = TypeVar("_Channel", Column, RawColumn)

SUFFIXES = (
    *(".csv", ".txt", ".tsv", ".dat", ".asc", ".log", ".xlsx", ".xlsm", ".mat", ".h5", ".hdf5"),
    *(".tdms", ".mf4", ".mdf", ".parquet", ".db3"),
)
"""Endings, each also with .gz where it is text, of the files that a folder is searched for."""

_BEGINS = {
    b"PK\x03\x04": "excel",
    b"\x89HDF": "hdf5",
    b"TDSm": "tdms",
    b"TDSh": "tdms",
    b"MDF ": "mdf",
    b"UnFinMF": "mdf",
    b"PAR1": "parquet",
    b"SQLite format 3": "sqlite",
    b"MATLAB 5.0": "mat",
}
_PACKAGES = {
    "excel": "openpyxl",
    "hdf5": "h5py",
    "tdms": "nptdms",
    "mdf": "asammdf",
    "parquet": "pyarrow.parquet",
    "sqlite": "rosbags.rosbag2",
    "mat": "scipy.io",
}
"""What reads a kind: code of others, which unpacks and may die of it."""

_LOGGING = ("nptdms", "asammdf")  # packages that tell by a logger what they make of a file
_LONGEST = 400  # characters of a line that quotes them
_OLD_EXCEL = b"\xd0\xcf\x11\xe0"
_MAT_HDF5 = b"MATLAB 7.3"


def kind_of(path: Path) -> str:
    """Return "text", "excel", "hdf5", "mat", "tdms", "mdf", "parquet", "sqlite" or "mcap".

    Raises
    ------
    BagError
        If the file is not there or of a kind that is not read.
    """
    if path.is_dir():
        packed_too = (*path.glob("*.db3"), *path.glob("*.db3.zstd"))
        return "sqlite" if packed_too else "mcap"
    try:
        with path.open("rb") as file:
            begin = file.read(64)
    except OSError as err:
        msg = f"{path}: cannot be read ({err.strerror or err}); give a file that is there"
        raise BagError(msg) from err
    if begin.startswith(b"\x89MCAP"):
        return "mcap"
    if begin.startswith(_OLD_EXCEL):
        msg = f"{path}: is an Excel file of before 2007; save it as .xlsx"
        raise BagError(msg)
    if begin.startswith(_MAT_HDF5):
        return "hdf5"
    found = next((kind for start, kind in _BEGINS.items() if begin.startswith(start)), "")
    if found:
        return found
    if path.suffix == ".mcap":
        msg = f"{path}: is no MCAP file: it does not begin as one; give a bag, or rename a table"
        raise BagError(msg)
    return "mat" if path.suffix == ".mat" else "text"


def read_recording(path: Path, choice: ClockChoice | None = None) -> Recording:
    """Read all numeric channels of a file with their times.

    Parameters
    ----------
    path : path
        Text table (any encoding, separator, preamble; plain or gzip), Excel, MAT, HDF5, TDMS, MDF,
        Parquet, or rosbag2 of storage sqlite3.
    choice : ClockChoice, optional
        What is known of the time; by default it is found.

    Returns
    -------
    Recording
        With at least one channel.

    Raises
    ------
    BagError
        One line: file, place, value, what to do.
    """
    choice = choice or ClockChoice()
    kind = kind_of(path)
    if kind in _PACKAGES:
        load_package(_PACKAGES[kind], path)  # once, not in each process
        whole = path.parent if kind == "sqlite" and path.is_file() else path  # all its files
        found = run_apart(whole, partial(_read, path, kind, choice))
    else:
        found = _read(path, kind, choice)
    if not found.columns:
        msg = f"{path}: holds no channel of numbers beside the time"
        raise BagError(msg)
    return resampled(found, choice.resample_s) if choice.resample_s else found


def _read(path: Path, kind: str, choice: ClockChoice) -> Recording:
    """Read a file of a known kind, with what its reader says of it."""
    try:
        with _what_is_said() as said, bounded_memory() if kind in _PACKAGES else nullcontext():
            found = _own_times(path, kind, choice) or with_clock(_sheet(path, kind), choice)
    except (BagError, MemoryError) as err:
        memory = isinstance(err.__cause__ or err, MemoryError)
        msg = f"{path}: {TOO_MUCH}" if memory else _one_line(str(err))
        raise BagError(msg) from err
    told = (f"{path}: {text}" for text in dict.fromkeys(said))
    return replace(found, notices=(*found.notices, *told))


class _Listener(logging.Handler):
    """Keeps what is logged, a line each."""

    def __init__(self, said: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._said = said

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record."""
        self._said.append(_one_line(record.getMessage()))


@contextmanager
def _what_is_said() -> Iterator[list[str]]:
    """Collect what readers of others tell by loggers and warnings, a line each, none printed."""
    said: list[str] = []
    listener = _Listener(said)
    names = [n for n in logging.root.manager.loggerDict if n.partition(".")[0] in _LOGGING]
    loggers = [logging.getLogger(name) for name in {*_LOGGING, *names}]
    before = [(logger, logger.handlers, logger.propagate) for logger in loggers]
    for logger in loggers:
        logger.handlers, logger.propagate = [listener], False
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("default")
            yield said
        said += [_one_line(str(one.message)) for one in warned]
    finally:
        for logger, handlers, propagate in before:
            logger.handlers, logger.propagate = handlers, propagate


def _one_line(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 4]} ..."


def _native(path: Path, kind: str, choice: ClockChoice) -> Recording | None:
    """Read a kind whose channels have times of their own, None where it is none."""
    if kind == "tdms":
        from valve_twin.io.instruments.tdms import read_tdms

        return read_tdms(path, choice)
    if kind == "mdf":
        from valve_twin.io.instruments.mdf import read_mdf

        return read_mdf(path)
    if kind == "sqlite":
        from valve_twin.io.instruments.sqlite_bag import read_sqlite_bag

        return read_sqlite_bag(path)
    if kind == "mcap":
        msg = f"{path}: is a bag already; it needs no import"
        raise BagError(msg)
    return None


def _own_times(path: Path, kind: str, choice: ClockChoice) -> Recording | None:
    found = _native(path, kind, choice)
    if found is None:
        return None
    columns, told = _without_infinite(path, found.columns)
    return replace(found, columns=tuple(columns), notices=(*found.notices, *told))


def _sheet(path: Path, kind: str) -> Sheet:
    from valve_twin.io.instruments import excel, mat, parquet
    from valve_twin.io.instruments.text.table import read_text_table

    readers = {
        "excel": excel.read_excel,
        "hdf5": mat.read_hdf5,
        "mat": mat.read_mat,
        "parquet": parquet.read_parquet,
        "text": read_text_table,
    }
    sheet = readers[kind](path)
    columns, told = _without_infinite(path, sheet.columns)
    return replace(sheet, columns=columns, notices=[*sheet.notices, *told])


def _without_infinite(
    path: Path, columns: Iterable[_Channel]
) -> tuple[list[_Channel], tuple[str, ...]]:
    """Return columns in which infinite values are NaN, and a line for each that had some."""
    made, told = [], []
    for column in columns:
        over = np.isinf(column.values)
        count = int(np.count_nonzero(over))
        if count:
            some = "1 value is" if count == 1 else f"{count} values are"
            told.append(
                f"{path}: column '{column.name}': {some} over the range (infinite), the first is "
                f"value {int(np.argmax(over)) + 1} of {len(over)}; read as no value"
            )
            column = replace(column, values=np.where(over, np.nan, column.values))  # noqa: PLW2901
        made.append(column)
    return made, tuple(told)
