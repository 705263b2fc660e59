# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin budget`: which source of error moves which parameter, and by how much."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    OK,
    add_config,
    add_simulation,
    add_verb,
    chosen_config,
    fail,
    positive,
    progress_of,
    rate_number,
)
from valve_twin.cli.output import console, plain, print_json, table

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.core.valves.error_budget import Budget


def add(verbs: Verbs) -> None:
    """Add the verb."""
    text = "Compute the error budget of the simulated valve of a configuration, row by row."
    parser = add_verb(verbs, "budget", text, _budget)
    add_config(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument(
        "--offset",
        type=rate_number,
        default=1e-3,
        metavar="X",
        help="offset of commands and position where measurement.*_offset is 0, default 1e-3",
    )
    parser.add_argument(
        "--command-noise",
        type=rate_number,
        default=1e-5,
        metavar="X",
        help="standard deviation of the noise of the logged commands, default 1e-5",
    )
    parser.add_argument(
        "--realisations", type=positive, default=8, metavar="N", help="draws of every noise"
    )
    add_simulation(parser, "a setting of the simulation, e.g. measurement.noise=1e-4")


def _budget(arguments: argparse.Namespace) -> int:
    from valve_twin.core.valves.error_budget import row_count
    from valve_twin.core.valves.registry import get_model
    from valve_twin.io.offline.budget import configured_budget
    from valve_twin.io.offline.simulated_bag import simulation_of

    config = chosen_config(arguments)
    names = ("offset", "command_noise", "realisations", "seed")
    sizes = {name: getattr(arguments, name) for name in names}
    rows = row_count(get_model(config.model), simulation_of(config, arguments.set))
    with progress_of("estimating", rows) as advance:
        budget = configured_budget(config, sizes, overrides=arguments.set, advance=advance)
    if not budget.columns:
        return fail(f"{config.name}: no estimate of the simulated cycle: {budget.reason}")
    if arguments.json:
        print_json(_plain(config.name, budget))
    else:
        _show(config.name, budget)
    return OK


def _plain(valve: str, budget: Budget) -> dict[str, object]:
    """Return the budget as plain data; what an estimator refuses = null."""
    return {
        "kind": "budget",
        "valve": valve,
        "parameters": [
            {
                "parameter": column.parameter,
                "estimator": column.estimator,
                "value": column.value,
                "errors": {row.letter: plain(row.errors[k], None) for row in budget.rows},
                "total": budget.total(k),
                "root_sum_square": budget.root_sum_square(k),
                "largest": budget.largest(k).letter,
            }
            for k, column in enumerate(budget.columns)
        ],
        "sources": [
            {"row": row.letter, "source": row.text, "size": row.size} for row in budget.rows
        ],
    }


def _show(valve: str, budget: Budget) -> None:
    """Print the table: relative errors in percent, the largest of each column marked."""
    from rich.text import Text

    title = f"{valve}: error of a parameter in one cycle [%]; * = its largest source"
    shown = table(title)
    shown.add_column("source")
    shown.add_column("size", justify="right", no_wrap=True)
    for column in budget.columns:
        name = column.estimator.replace("_", "\n")  # a word a line: a narrow column
        shown.add_column(f"{column.parameter}\n{name}", justify="right", no_wrap=True)
    most = [budget.largest(k).letter for k in range(len(budget.columns))]
    for row in budget.rows:
        cells = [
            Text(f"{_percent(error)} *", "bold")
            if letter == row.letter
            else f"{_percent(error)}  "
            for letter, error in zip(most, row.errors, strict=True)
        ]
        shown.add_row(f"({row.letter}) {row.text}", f"{row.size:.1e}", *cells)
    shown.add_section()
    columns = range(len(budget.columns))
    shown.add_row("sum of all", "", *[_percent(budget.total(k)) + "  " for k in columns])
    squares = [_percent(budget.root_sum_square(k)) + "  " for k in columns]
    shown.add_row("root of the sum of squares", "", *squares)
    shown.add_row("value", "", *[f"{column.value:.4g}  " for column in budget.columns])
    console().print(shown)


def _percent(error: float) -> str:
    """Return a relative error in percent, two digits; refused = a dash."""
    if not math.isfinite(error):
        return "-"
    percent = 100.0 * error
    if percent < 5e-4:
        return "0"
    return f"{percent:.2g}" if percent < 100.0 else f"{percent:.0f}"
