# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The offline face of the core.

`valve-twin simulate | import | configure | estimate | replay | report | history | bench`

Exit codes: 0 ok, 1 the data or a check failed, 2 wrong usage. Errors are one line on stderr.
"""

from __future__ import annotations

import argparse
import errno
import math
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from valve_twin import __version__
from valve_twin.io.errors import ConfigError, ValveTwinError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from contextlib import AbstractContextManager

    from valve_twin.core.aging import Assessment
    from valve_twin.io.config import ValveConfig
    from valve_twin.io.offline import Record

OK, FAILED, USAGE = 0, 1, 2


class _Parser(argparse.ArgumentParser):
    """Say what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        sys.stderr.write(f"{self.prog}: {message}; see {self.prog} --help\n")
        raise SystemExit(USAGE)


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
    arguments = _parser().parse_args(argv)
    verb: Callable[[argparse.Namespace], int] = arguments.run
    try:
        code = verb(arguments)
        sys.stdout.flush()
    except ConfigError as err:
        return _fail(str(err), USAGE)
    except ValveTwinError as err:
        return _fail(str(err), FAILED)
    except BrokenPipeError:
        # the reader has seen enough; nothing may be written when the interpreter ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except OSError as err:
        return _fail(f"{err.filename or 'standard output'}: {err.strerror or err}; {_ACCESS}")
    except KeyboardInterrupt:
        return _fail("interrupted")
    return code


_ACCESS = "check the folder, its access rights and the free space"


def _fail(text: str, code: int = FAILED) -> int:
    """Say in one line why it ends."""
    sys.stderr.write(f"valve-twin: {' '.join(text.split())}\n")
    return code


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="valve-twin", description="Digital twins of valves, offline.")
    parser.add_argument("--version", action="version", version=f"valve-twin {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for add in (
        _add_simulate,
        _add_import,
        _add_configure,
        _add_estimate,
        _add_replay,
        _add_report,
        _add_history,
        _add_bench,
    ):
        add(verbs)
    return parser


_Verbs = argparse._SubParsersAction


def _add_bag(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("bag", metavar="BAG", help="folder, metadata.yaml or .mcap file")


def _verb(
    verbs: _Verbs[_Parser], name: str, text: str, run: Callable[[argparse.Namespace], int]
) -> _Parser:
    parser = verbs.add_parser(name, help=text, description=text)
    parser.set_defaults(run=run)
    return parser


def _add_config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", required=True, metavar="FILE", help="YAML of the valve")
    parser.add_argument(
        "--valve", default="", metavar="NAME", help="which valve of the file, default the first"
    )


def _config(arguments: argparse.Namespace) -> ValveConfig:
    from valve_twin.io.config import load_config

    configs = load_config(arguments.config)
    if not arguments.valve:
        return configs[0]
    wanted = "/" + arguments.valve.strip("/")
    for config in configs:
        if config.name == wanted:
            return config
    names = ", ".join(c.name for c in configs)
    msg = f"{arguments.config}: there is no valve '{wanted}'; give one of {names}"
    raise ConfigError(msg)


# -- simulate


def _add_simulate(verbs: _Verbs[_Parser]) -> None:
    text = "Simulate production cycles of a valve into a bag."
    parser = _verb(verbs, "simulate", text, _simulate)
    _add_config(parser)
    parser.add_argument("--out", required=True, metavar="BAG", help="folder of the bag to write")
    parser.add_argument(
        "--cycles", type=_positive, default=10, metavar="N", help="production cycles"
    )
    parser.add_argument(
        "--seed", type=_seed, default=0, metavar="N", help="seed of all random numbers"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="override a setting, e.g. aging.area_in.rate=-0.0015 or measurement.noise=1e-3",
    )


def _simulate(arguments: argparse.Namespace) -> int:
    from valve_twin.io.simulated_bag import write_simulated_bag

    config = _config(arguments)
    with _progress("simulating", arguments.cycles) as advance:
        messages = write_simulated_bag(
            config,
            arguments.out,
            cycles=arguments.cycles,
            seed=arguments.seed,
            overrides=arguments.set,
            on_cycle=advance,
        )
    _say(f"{arguments.out}: {arguments.cycles} cycles, {messages} messages")
    return OK


# -- import


def _add_import(verbs: _Verbs[_Parser]) -> None:
    parser = _verb(verbs, "import", "Turn measured CSV files into a bag.", _import)
    parser.add_argument("csv", nargs="+", metavar="CSV", help="files (.csv, .csv.gz), in order")
    _add_config(parser)
    parser.add_argument("--out", required=True, metavar="BAG", help="folder of the bag to write")


def _import(arguments: argparse.Namespace) -> int:
    from valve_twin.io.csv_import import import_csv

    config = _config(arguments)
    with _progress("importing", len(arguments.csv)) as advance:
        summary = import_csv(arguments.csv, config, arguments.out, on_file=advance)
    _say(f"{arguments.out}: {summary}")
    return OK


# -- configure


def _add_configure(verbs: _Verbs[_Parser]) -> None:
    parser = _verb(verbs, "configure", "Propose a commented YAML for an unknown bag.", _configure)
    _add_bag(parser)
    parser.add_argument("--out", metavar="FILE", help="file to write, default standard output")
    parser.add_argument(
        "--position", default="", metavar="TOPIC:FIELD", help="the position, where it is known"
    )


def _configure(arguments: argparse.Namespace) -> int:
    from valve_twin.io.configure import propose_yaml

    text = propose_yaml(arguments.bag, position=arguments.position)
    if arguments.out:
        Path(arguments.out).write_text(text, encoding="utf-8")
        _say(f"{arguments.out}: proposal written; check it before you use it")
    else:
        sys.stdout.write(text)
    return OK


# -- estimate and report


def _add_estimate(verbs: _Verbs[_Parser]) -> None:
    parser = _verb(
        verbs, "estimate", "Estimate every cycle of a bag; one JSON object a line.", _estimate
    )
    _add_bag(parser)
    _add_config(parser)
    parser.add_argument("--json", metavar="OUT", help="file to write, default standard output")
    parser.add_argument(
        "--closed-cycles-only",
        action="store_true",
        help="leave out the cycle in which the record ends, as the live node does",
    )


def _estimate(arguments: argparse.Namespace) -> int:
    from valve_twin.io.lines import json_lines

    config = _config(arguments)
    if arguments.json:
        _check_writable(arguments.json)
    record, assessment = _run_offline(config, arguments.bag, not arguments.closed_cycles_only)
    lines = json_lines(record.estimates, assessment, config.name)
    text = "".join(f"{line}\n" for line in lines)
    if arguments.json:
        Path(arguments.json).write_text(text, encoding="utf-8")
        _say(f"{arguments.json}: {len(record.cycles)} cycles; {assessment.verdict.evidence}")
    else:
        sys.stdout.write(text)
    return OK if record.cycles else _no_cycle(config, arguments.bag)


def _no_cycle(config: ValveConfig, bag: str) -> int:
    return _fail(
        f"{bag}: no cycle found by rule '{config.cycles.rule.value}'; "
        "check cycles.* in the configuration, valve-twin configure proposes it"
    )


def _check_writable(path: str) -> None:
    """Find out before the long work whether its result can be written."""
    there = Path(path)
    if there.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder, not a file", path)
    if not os.access(there if there.exists() else there.parent, os.W_OK):
        raise PermissionError(errno.EACCES, "cannot be written", path)


def _add_report(verbs: _Verbs[_Parser]) -> None:
    parser = _verb(verbs, "report", "Write one self-contained HTML page.", _report)
    parser.add_argument("bag", nargs="?", metavar="BAG", help="bag to estimate; else the history")
    _add_config(parser)
    parser.add_argument("--out", required=True, metavar="HTML", help="page to write")
    parser.add_argument(
        "--label", default="", help="what the axis is where it is no aging, default aging.label"
    )


def _report(arguments: argparse.Namespace) -> int:
    from valve_twin.report.build import report_bag, report_history

    config = _config(arguments)
    if arguments.bag:
        record, assessment = _run_offline(config, arguments.bag, close_last=True)
        if not record.cycles:
            return _no_cycle(config, arguments.bag)
        report_bag(config, arguments.bag, record, assessment, arguments.out, arguments.label)
    else:
        report_history(config, arguments.out, arguments.label)
    _say(f"{arguments.out}: written")
    return OK


# -- replay


def _add_replay(verbs: _Verbs[_Parser]) -> None:
    parser = _verb(
        verbs,
        "replay",
        "Play a bag onto ROS topics, under /replay unless told otherwise; needs ROS 2.",
        _replay,
    )
    _add_bag(parser)
    parser.add_argument(
        "--rate",
        type=_rate,
        default=1.0,
        metavar="R",
        help="playback seconds a second, 0 = as fast as the subscribers take it",
    )
    parser.add_argument(
        "--prefix", default="/replay", metavar="NAME", help="put before every topic"
    )
    parser.add_argument("--clock", action="store_true", help="publish /clock")


def _replay(arguments: argparse.Namespace) -> int:
    try:
        from valve_twin.nodes.bag_player import play
    except ImportError as err:
        msg = f"replay needs ROS 2 ({err}); source it or use tools/run, or estimate offline"
        raise ValveTwinError(msg) from err
    return play(arguments.bag, rate=arguments.rate, prefix=arguments.prefix, clock=arguments.clock)


# -- history


def _add_history(verbs: _Verbs[_Parser]) -> None:
    parser = _verb(verbs, "history", "Back up or export the history database.", _history)
    parser.add_argument("action", choices=("backup", "export", "list"))
    parser.add_argument(
        "--url", required=True, help="database: a file or sqlite:///, postgresql://"
    )
    parser.add_argument("--out", default="", help="file (backup) or folder (export) to write")


def _history(arguments: argparse.Namespace) -> int:
    from valve_twin.io.history import History

    with History(arguments.url, read_only=True) as history:
        if arguments.action == "backup":
            _say(f"{history.backup(arguments.out)}: written")
        elif arguments.action == "export":
            for path in history.export(arguments.out or "history_export"):
                _say(f"{path}: written")
        else:
            for valve in history.valves():
                sys.stdout.write(f"{valve}: last cycle {history.last_cycle(valve)}\n")
    return OK


# -- bench


def _add_bench(verbs: _Verbs[_Parser]) -> None:
    parser = _verb(
        verbs, "bench", "Measure against what a user would write otherwise, in one run.", _bench
    )
    parser.add_argument("--quick", action="store_true", help="seconds instead of minutes")


def _bench(arguments: argparse.Namespace) -> int:
    from valve_twin.bench import run_benchmarks

    return OK if run_benchmarks(quick=arguments.quick, write=sys.stdout.write) else FAILED


# -- shared


def _run_offline(config: ValveConfig, bag: str, close_last: bool) -> tuple[Record, Assessment]:
    from valve_twin.io.offline import assess_record, describe_bad, run_bag

    with _progress("estimating", None) as advance:
        record = run_bag(config, bag, close_last=close_last, on_cycle=advance)
    for line in describe_bad(config, bag, record):
        _say(f"valve-twin: {line}")
    return record, assess_record(config, record)


def _positive(text: str) -> int:
    return _whole(text, 1)


def _seed(text: str) -> int:
    return _whole(text, 0)


def _whole(text: str, least: int) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least:
        msg = f"'{text}' is refused: write a whole number, {least} or more"
        raise argparse.ArgumentTypeError(msg)
    return value


def _rate(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        msg = f"'{text}' is refused: write a number, 0 or more"
        raise argparse.ArgumentTypeError(msg)
    return value


def _say(text: str) -> None:
    sys.stderr.write(f"{text}\n")


def _progress(what: str, total: int | None) -> AbstractContextManager[Callable[[], None]]:
    from valve_twin.progress import progress

    return progress(what, total)


if __name__ == "__main__":
    sys.exit(main())
