# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin predict`: what the twin predicts of a bag, a row a sample."""

from __future__ import annotations

import math
import statistics
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    OK,
    add_bag,
    add_config,
    add_freeze,
    add_verb,
    chosen_config,
    fail,
)
from valve_twin.cli.output import print_json, write

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "predict", "Write measurement, one-step prediction and free run a sample.", _predict
    )
    add_bag(parser)
    add_config(parser)
    parser.add_argument(
        "--out", required=True, metavar="X.csv|X.parquet", help="table to write, a row a sample"
    )
    add_freeze(parser)
    parser.add_argument("--json", action="store_true", help="errors as one JSON object a cycle")


def _predict(arguments: argparse.Namespace) -> int:
    from valve_twin.io.tables.predictions import write_predictions

    config = chosen_config(arguments)
    errors = write_predictions(config, arguments.bag, arguments.out, freeze_after=arguments.freeze)
    if not errors:
        return fail(
            f"{arguments.bag}: no cycle could be predicted: the estimate of a cycle is in force "
            "from the second cycle after it; give a longer record, or see valve-twin estimate for "
            "why cycles are refused"
        )
    if arguments.json:
        for error in errors:
            print_json(
                {
                    "kind": "error",
                    "cycle": error.cycle,
                    "model": "frozen" if error.frozen else "learning",
                    "cycle_is": "test",
                    "one_step_rmse": error.one_step_rmse,
                    "free_run_fit": error.free_run_fit,
                }
            )
        return OK
    for frozen in (False, True):
        of = [e for e in errors if e.frozen is frozen]
        if of:
            what = "frozen" if frozen else "learnt from the cycles before"
            rmse = statistics.median(e.one_step_rmse for e in of)
            fits = [e.free_run_fit for e in of if math.isfinite(e.free_run_fit)]
            fit = statistics.median(fits) if fits else math.nan
            write(
                f"{arguments.out}: {len(of)} cycles, model {what}; median on cycles that it does "
                f"not know: one-step error {rmse:.3g} (RMS), free-run fit {fit:.1f} %\n"
            )
    return OK
