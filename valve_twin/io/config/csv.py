# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How measured CSV files are read: the `csv` section of a valve's configuration."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.quantity import quantity, setting

BASE_STAMP = "2020-01-01T00:00:00Z"
"""Where the clock of a file without dates starts: every import gives the same bag."""


@dataclass(frozen=True, slots=True)
class CsvConfig:
    """How the columns of a CSV file become stamped samples."""

    reader: str = setting(
        "csv",
        "csv = plain CSV with one line of names, read strictly; any = every channel of any CSV, "
        "Excel, MAT, HDF5, TDMS, MDF, Parquet or sqlite3 bag, as configure found them.",
        choices=("csv", "any"),
    )
    separator: str = setting("", "One character; empty = found from the first lines.")
    time_column: str = setting(
        "", "Name or number of the column with the time; empty = rows are period_s apart."
    )
    time_scale: float = quantity(
        1.0,
        "s",
        "Seconds in one unit of the time column, 0.001 for milliseconds.",
        lower=1e-12,
        upper=1e9,
    )
    base_stamp: str = setting(
        BASE_STAMP,
        "Date and time (ISO 8601, UTC) of time 0, moved up to the next start of a "
        "window where cycles are windows; empty = the time column counts from 1970.",
    )
    row_s: float = quantity(
        0.0, "s", "Time between two rows of a file without times; 0 = period_s.", lower=0.0
    )
    resample_s: float = quantity(
        0.0,
        "s",
        "Step of one grid that all channels are put on when they are imported; 0 = their own "
        "times. Reader `any` only.",
        lower=0.0,
    )
    times_measured: bool = setting(
        default=True,
        text="Whether the files state their times; false = rows were counted or a unit was "
        "assumed: reports then call rates and dates not measured.",
    )
    leave_out: tuple[str, ...] = setting(
        (),
        "Files that are not imported, by name or by the end of the path where two have one "
        "name: configure puts those unlike the others here.",
    )
    batch: int = quantity(
        100,
        "1",
        "Samples in one message of a signal of type Float64Series.",
        lower=1,
        upper=1_000_000,
    )
    gap_s: float = quantity(
        5.0, "s", "Time between the last sample of one file and the first of the next.", lower=0.0
    )
