# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Show a valve's twin at work.

Starts the installed nodes on a ROS domain of their own that does not leave this machine, shows a
live table, and ends with trend, report page and recorded bag.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.core.valves.registry import DEFAULT_MODEL
from valve_twin.demo.cases import ROOT, case_names, find_case
from valve_twin.demo.measured import BOILER_DATA, run_boiler
from valve_twin.demo.processes import fresh_folder, isolate, say
from valve_twin.demo.simulated import run_case, say_stopped
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
    from collections.abc import Sequence

STOPPED = 130
"""Exit status of what Ctrl-C has stopped, as of a shell."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demo.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments, default `sys.argv[1:]`.

    Returns
    -------
    int
        0; 1 where the demo did not reach its cycles or its trend missed the injected drift; 2
        where there is no such valve or file; 130 where it was stopped by Ctrl-C.
    """
    arguments = _arguments(argv)
    try:
        case = find_case(
            arguments.valve,
            file=Path(arguments.config) if arguments.config else None,
            cycles=arguments.cycles,
            rate=arguments.rate,
        )
    except (ValueError, ValveTwinError) as err:
        sys.stderr.write(f"demo: {err}\n")
        return 2
    isolate()
    out = fresh_folder(Path(arguments.out))
    say(f"writing to {out}")
    boiler = case.model == DEFAULT_MODEL and not arguments.config
    try:
        ok = run_case(case, out)
        if boiler:
            ok = _boiler(out, Path(arguments.data) / BOILER_DATA) and ok
    except KeyboardInterrupt:
        say_stopped(case, out)
        return STOPPED
    return 0 if ok else 1


def _boiler(out: Path, data: Path) -> bool:
    if data.is_file():
        return run_boiler(out, data)
    say(f"no measured data at {data}: the second part, a real boiler valve, is left out")
    return True


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make demo", description=__doc__)
    names = f"one of {', '.join(case_names())}"
    parser.add_argument("--valve", default="", help=f"{names}; default {DEFAULT_MODEL}")
    parser.add_argument("--config", default="", help="parameter file of a simulated valve to show")
    parser.add_argument("--cycles", type=int, default=0, help="production cycles to wait for")
    parser.add_argument("--rate", type=float, default=0.0, help="simulated seconds a second")
    parser.add_argument("--out", default="demo_output", help="folder for reports and bags")
    data = ROOT.parent / "shared" / "data"
    parser.add_argument("--data", default=str(data), help="folder of measured data")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
