# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin simulate`: production cycles of a simulated valve into a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    OK,
    add_config,
    add_simulation,
    add_verb,
    chosen_config,
    positive,
    progress_of,
    say,
)

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    text = "Simulate production cycles of a valve into a bag."
    parser = add_verb(verbs, "simulate", text, _simulate)
    add_config(parser)
    parser.add_argument("--out", required=True, metavar="BAG", help="folder of the bag to write")
    parser.add_argument(
        "--cycles", type=positive, default=10, metavar="N", help="production cycles"
    )
    add_simulation(parser, "a setting, e.g. aging.area_in.rate=-0.0015 or measurement.noise=1e-3")


def _simulate(arguments: argparse.Namespace) -> int:
    from valve_twin.io.offline.simulated_bag import write_simulated_bag

    config = chosen_config(arguments)
    with progress_of("simulating", arguments.cycles) as advance:
        messages = write_simulated_bag(
            config,
            arguments.out,
            cycles=arguments.cycles,
            seed=arguments.seed,
            overrides=arguments.set,
            on_cycle=advance,
        )
    say(f"{arguments.out}: {arguments.cycles} cycles, {messages} messages")
    return OK
