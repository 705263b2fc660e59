# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the verbs share: arguments, checks and the one line in which they speak."""

from __future__ import annotations

import argparse
import errno
import math
import os
import signal
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeAlias, TypeVar

from valve_twin.cli.output import shown
from valve_twin.compat.interpreter import take_exponents
from valve_twin.io.errors import ConfigError
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from contextlib import AbstractContextManager

    from valve_twin.core.aging.assess import Assessment
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.io.offline.run import Record
    from valve_twin.progress import Steps

    Verbs: TypeAlias = "argparse._SubParsersAction[Parser]"

OK, FAILED, USAGE = 0, 1, 2

N = TypeVar("N", int, float)
T = TypeVar("T")
R = TypeVar("R")


class Parser(argparse.ArgumentParser):
    """Say what is wrong in one line; -5e-4 is a number."""

    def __init__(self, **given: object) -> None:
        """Make the parser, arguments as of `argparse.ArgumentParser`."""
        super().__init__(**given)  # type: ignore[arg-type]
        take_exponents(self)

    def error(self, message: str) -> NoReturn:
        """End with the usage exit code."""
        say(f"{self.prog}: {message}; see {self.prog} --help")
        raise SystemExit(USAGE)


def add_verb(
    verbs: Verbs, name: str, text: str, run: Callable[[argparse.Namespace], int]
) -> Parser:
    """Add one verb: its line of help and what it runs.

    Parameters
    ----------
    verbs : Verbs
        Where it is added.
    name, text : str
        The verb and its line of help.
    run : callable
        Takes the parsed arguments and returns the exit code.
    """
    parser = verbs.add_parser(name, help=text, description=text)
    parser.set_defaults(run=run)
    return parser


def add_bag(parser: argparse.ArgumentParser) -> None:
    """Add the bag as argument."""
    parser.add_argument("bag", metavar="BAG", help="folder, metadata.yaml or .mcap file")


def add_config(parser: argparse.ArgumentParser, about: str = "") -> None:
    """Add --config and --valve; with `about`, what it is for, the file may be left out."""
    text = about or "YAML of the valve"
    parser.add_argument("--config", required=not about, metavar="FILE", help=text)
    parser.add_argument(
        "--valve", default="", metavar="NAME", help="which valve of the file, default the first"
    )


def add_url(parser: argparse.ArgumentParser, *, required: bool = True) -> None:
    """Add --url of a history."""
    text = "database: a file or sqlite:///, postgresql://"
    parser.add_argument("--url", required=required, help=text)


def add_freeze(parser: argparse.ArgumentParser) -> None:
    """Add --freeze."""
    parser.add_argument(
        "--freeze",
        type=cycle_number,
        default=0,
        metavar="N",
        help="learn from the first N cycles only; later ones are test data for that model",
    )


def cycle_number(text: str) -> int:
    """Return the number of a cycle, 1 or more."""
    return _read(int, text, lambda value: value >= 1, "a number of cycles, 1 or more")


def add_simulation(parser: argparse.ArgumentParser, about: str) -> None:
    """Add --seed and --set of a simulation; `about` says what may be set."""
    parser.add_argument(
        "--seed", type=seed_number, default=0, metavar="N", help="seed of all random numbers"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help=f"override {about}"
    )


def add_runner(parser: argparse.ArgumentParser, needs: str) -> None:
    """Add --jobs and --scheduler; `needs` says what the workers of a cluster need."""
    parser.add_argument("--jobs", type=positive, metavar="N", help="processes, default one a core")
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help=f"run on this Dask cluster, such as tcp://host:8786; {needs}",
    )


def runner_of(
    arguments: argparse.Namespace,
    work: Callable[[T], R],
    lost: Callable[[T, str], R],
    *,
    keep: bool = False,
) -> Callable[[Sequence[T]], Iterable[R]]:
    """Return what runs tasks as --jobs or --scheduler say.

    Parameters
    ----------
    arguments : argparse.Namespace
        Of `add_runner`.
    work, lost, keep : callable, callable, bool
        As of `LocalRunner`.
    """
    from valve_twin.io.batch.runners import ClusterRunner, LocalRunner, core_count

    if not arguments.scheduler:
        return LocalRunner(arguments.jobs or core_count(), work, lost, keep=keep)

    def on_cluster(tasks: Sequence[T]) -> Iterable[R]:
        """Connect only when something is left to do."""
        return ClusterRunner(arguments.scheduler, work, lost)(tasks)

    return on_cluster


def ends_as_interrupted() -> None:
    """Let SIGTERM end the command as Ctrl-C does."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)


def chosen_config(arguments: argparse.Namespace) -> ValveConfig:
    """Return the configuration of the wanted valve, default the first of the file."""
    from valve_twin.io.config.valve import load_config

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


def run_offline(
    config: ValveConfig,
    bag: str,
    *,
    close_last: bool = True,
    predict: bool = True,
    freeze_after: int = 0,
) -> tuple[Record, Assessment]:
    """Estimate a bag and assess its trends; say on stderr what was bad in it.

    Parameters
    ----------
    config : ValveConfig
        The valve's configuration.
    bag : str
        Folder of the bag.
    close_last : bool
        Whether the last cycle counts although nothing follows it.
    predict : bool
        Whether samples are predicted, too.
    freeze_after : int
        The cycle after which nothing more is learnt; 0 = none.
    """
    from valve_twin.io.offline.run import assess_record, describe_bad, describe_refused, run_bag

    with progress_of("estimating", None) as advance:
        record = run_bag(
            config,
            bag,
            close_last=close_last,
            predict=predict,
            freeze_after=freeze_after,
            on_cycle=advance,
        )
    for line in [*describe_bad(config, bag, record), *describe_refused(bag, record)]:
        say(f"valve-twin: {line}")
    return record, assess_record(config, record)


def no_cycle(config: ValveConfig, bag: str) -> int:
    """Say that a bag holds no cycle."""
    return fail(
        f"{bag}: no cycle found by rule '{config.cycles.rule.value}'; "
        "check cycles.* in the configuration, valve-twin configure proposes it"
    )


def check_writable(*paths: str | None) -> None:
    """Find out before the long work whether its results can be written; no path = none."""
    for path in filter(None, paths):
        there = Path(path) if Path(path).exists() else Path(os.path.realpath(path))
        if there.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a folder, not a file", path)
        if not there.parent.is_dir():
            raise FileNotFoundError(errno.ENOENT, f"there is no folder {there.parent}", path)
        if not os.access(there if there.exists() else there.parent, os.W_OK):
            raise PermissionError(errno.EACCES, "cannot be written", path)


def write_file(path: str, text: str) -> None:
    """Write a result, whole or not at all, and say so."""
    write_whole(path, text)
    say(f"{path}: written")


def positive(text: str) -> int:
    """Read a whole number, 1 or more."""
    return _read(int, text, lambda value: value >= 1, "a whole number, 1 or more")


def seed_number(text: str) -> int:
    """Read a whole number, 0 or more."""
    return _read(int, text, lambda value: value >= 0, "a whole number, 0 or more")


def positive_number(text: str) -> float:
    """Read a finite number above 0."""
    return _read(float, text, lambda value: 0.0 < value < math.inf, "a number above 0")


def rate_number(text: str) -> float:
    """Read a finite number, 0 or more."""
    return _read(float, text, lambda value: 0.0 <= value < math.inf, "a number, 0 or more")


def share_number(text: str) -> float:
    """Read a number between 0 and 1."""
    wanted = "a number between 0 and 1, such as 0.9"
    return _read(float, text, lambda value: 0.0 < value < 1.0, wanted)


def _read(kind: Callable[[str], N], text: str, fits: Callable[[N], bool], wanted: str) -> N:
    with suppress(ValueError):
        if fits(value := kind(text)):
            return value
    msg = f"'{text}' is refused: write {wanted}"
    raise argparse.ArgumentTypeError(msg)


def fail(text: str, code: int = FAILED) -> int:
    """Say in one line why it ends."""
    say(f"valve-twin: {' '.join(text.split())}")
    return code


def say(text: str) -> None:
    """Write one line to stderr: stdout carries results only."""
    sys.stderr.write(f"{shown(text)}\n")


def progress_of(what: str, total: int | None) -> AbstractContextManager[Steps]:
    """Show a progress bar on stderr, or a line a minute; call what it gives once a step."""
    from valve_twin.progress import progress

    return progress(what, total)
