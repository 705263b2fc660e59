# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin convert`: write a bag as CSV or Parquet tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_bag, add_config, add_verb, chosen_config
from valve_twin.cli.output import write
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "convert", "Write a bag as CSV or Parquet tables.", _convert)
    add_bag(parser)
    parser.add_argument(
        "--out",
        required=True,
        metavar="X.csv|X.parquet",
        help="file to write; several topics give X.topic.csv each",
    )
    parser.add_argument("--topics", nargs="+", default=[], metavar="TOPIC", help="only these")
    add_config(parser, "YAML of the valve: write its signals, one row a stamp")


def _convert(arguments: argparse.Namespace) -> int:
    from valve_twin.io.tables.csv_export import convert_signals, convert_topics

    if arguments.config and arguments.topics:
        msg = "--config writes the signals of the valve; leave out --topics"
        raise ConfigError(msg)
    if arguments.config:
        written = [convert_signals(arguments.bag, arguments.out, chosen_config(arguments))]
    else:
        written = convert_topics(arguments.bag, arguments.out, arguments.topics)
    for file in written:
        what = f" of {file.topic}" if file.topic else ""
        write(f"{file.path}: {file.rows} rows, {file.columns} columns{what}\n")
    return OK
