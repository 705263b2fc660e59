# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Run one verb of the offline command and turn errors into one line and an exit code."""

from __future__ import annotations

import logging
import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING

from valve_twin import __version__
from valve_twin.cli.common import FAILED, OK, USAGE, Parser, fail
from valve_twin.cli.output import shown
from valve_twin.io.errors import ConfigError, IndexLiesError, ValveTwinError, unusable
from valve_twin.io.uncollected import rarely_collected

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

VERBS = {
    "simulate": "simulate",
    "import": "bags.import_",
    "configure": "configure",
    "estimate": "estimate",
    "replay": "bags.replay",
    "report": "report",
    "verify": "archive.verify",
    "batch": "archive.batch",
    "fleet": "archive.fleet",
    "serve": "archive.serve",
    "history": "archive.history",
    "reference": "archive.reference",
    "export-fmu": "archive.export_fmu",
    "info": "bags.info",
    "recover": "bags.recover",
    "cut": "bags.cut",
    "convert": "bags.convert",
    "predict": "bags.predict",
    "stroke-test": "bags.stroke_test",
    "budget": "budget",
    "backtest": "archive.backtest",
    "validate": "validate",
    "check-valve": "check_valve",
    "campaign": "campaign",
    "bench-fit": "bench_fit",
    "design": "design.verb",
    "bench": "bench",
}
"""Module of each verb, in the order of the help."""

_COMPUTE = {
    *("simulate", "configure", "estimate", "report", "verify", "batch", "fleet", "history"),
    *("reference", "predict", "stroke-test", "budget", "backtest", "export-fmu", "check-valve"),
}
"""Verbs whose kernels come compiled from the installation; the others load none or compile."""

TRACE = "VALVE_TWIN_TRACE"
"""Environment variable that shows where something unexpected happened."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments, default `sys.argv[1:]`.

    Returns
    -------
    int
        Exit code.
    """
    if logging.lastResort is not None:  # what the package warns of names foreign things, too
        logging.lastResort.setFormatter(_Shown())
    given = sys.argv[1:] if argv is None else argv
    with rarely_collected():
        return _run(given)


def _run(given: Sequence[str]) -> int:
    arguments = _parser(given[0] if given else "").parse_args(given)
    verb: Callable[[argparse.Namespace], int] = arguments.run
    try:
        if arguments.verb in _COMPUTE:
            from valve_twin.compat.interpreter import load_kernels_alone

            load_kernels_alone(of_arrays=True)
        try:
            code = verb(arguments)
        except IndexLiesError:  # what is wrong has been said; it is known from now on
            code = verb(arguments)
        sys.stdout.flush()
    except ConfigError as err:
        return fail(str(err), USAGE)
    except ValveTwinError as err:
        return fail(str(err), FAILED)
    except BrokenPipeError:
        # the reader has seen enough; nothing may be written when the interpreter ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except OSError as err:
        return fail(unusable(err.filename or "standard output", err))
    except KeyboardInterrupt:
        return fail("interrupted")
    except Exception as err:  # what was read is of foreign origin; no content may end in a trace
        if os.environ.get(TRACE):
            raise
        return fail(
            f"{arguments.verb}: stopped by something unexpected in what was read "
            f"({type(err).__name__}: {err}); please report it with the file; {TRACE}=1 shows where"
        )
    return code


class _Shown(logging.Formatter):
    """Gives the terminal no orders."""

    def format(self, record: logging.LogRecord) -> str:
        """Return a record as it is written."""
        return shown(super().format(record))


def _parser(named: str) -> argparse.ArgumentParser:
    """Return what reads the arguments: of the verb that is named, else of all.

    All of them take 0.3 s of CPU to import, and a server that died is waited for.
    """
    parser = Parser(prog="valve-twin", description="Digital twins of valves, offline.")
    parser.add_argument("--version", action="version", version=f"valve-twin {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for module in [VERBS[named]] if named in VERBS else VERBS.values():
        import_module(f"valve_twin.cli.{module}").add(verbs)
    return parser
