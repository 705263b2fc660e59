# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin import`: measured files into a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_config, add_verb, chosen_config, progress_of, say

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "import", "Turn measured files into a bag.", _import)
    parser.add_argument(
        "csv",
        nargs="+",
        metavar="FILE",
        help="files in order: CSV, Excel, MAT, HDF5, TDMS, MDF, Parquet, sqlite3 bag",
    )
    add_config(parser)
    parser.add_argument("--out", required=True, metavar="BAG", help="folder of the bag to write")


def _import(arguments: argparse.Namespace) -> int:
    from valve_twin.io.instruments.into_bag import import_recordings, needs_reader
    from valve_twin.io.tables.csv_import import import_csv

    config = chosen_config(arguments)
    write = import_recordings if needs_reader(arguments.csv, config) else import_csv
    with progress_of("importing", len(arguments.csv)) as advance:
        summary = write(arguments.csv, config, arguments.out, on_file=advance)
    for notice in summary.notices:
        say(f"valve-twin: {notice}")
    say(f"{arguments.out}: {summary}")
    return OK
