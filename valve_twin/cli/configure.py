# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin configure`: a proposed YAML for an unknown bag."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_bag, add_verb, say

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "configure", "Propose a commented YAML for an unknown bag.", _configure
    )
    add_bag(parser)
    parser.add_argument("--out", metavar="FILE", help="file to write, default standard output")
    parser.add_argument(
        "--position", default="", metavar="TOPIC:FIELD", help="the position, where it is known"
    )


def _configure(arguments: argparse.Namespace) -> int:
    from valve_twin.io.offline.propose import propose_yaml

    text = propose_yaml(arguments.bag, position=arguments.position)
    if arguments.out:
        Path(arguments.out).write_text(text, encoding="utf-8")
        say(f"{arguments.out}: proposal written; check it before you use it")
    else:
        sys.stdout.write(text)
    return OK
