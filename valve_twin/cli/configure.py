# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin configure`: a proposed YAML for an unknown bag or for files of any instrument."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.cli.common import OK, add_verb, check_writable, fail, positive_number, say
from valve_twin.cli.output import shown, write
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.core.types import FloatArray
    from valve_twin.io.configure.channels import Survey
    from valve_twin.io.configure.limits import Limit
    from valve_twin.io.configure.survey import Choice
    from valve_twin.io.instruments.clock import ClockChoice


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "configure", "Propose a commented YAML for an unknown recording.", _configure
    )
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="a bag, or files: CSV, Excel, MAT, HDF5, TDMS, MDF, Parquet, sqlite3 bag",
    )
    parser.add_argument("--out", metavar="FILE", help="file to write, default standard output")
    parser.add_argument(
        "--position",
        default="",
        metavar="NAME",
        help="the channel that answers (in a bag TOPIC:FIELD), where it is known",
    )
    parser.add_argument(
        "--period",
        type=positive_number,
        default=0.0,
        metavar="S",
        help="time between two rows where the files do not state it [s]",
    )
    parser.add_argument(
        "--resample",
        type=positive_number,
        default=0.0,
        metavar="S",
        help="put all channels on one grid of this step, averaged where they are denser [s]",
    )
    parser.add_argument("--picture", metavar="SVG", help="picture to write, default beside --out")
    parser.add_argument("--yes", action="store_true", help="ask nothing, take the default")


def _configure(arguments: argparse.Namespace) -> int:
    check_writable(arguments.out)
    first = Path(arguments.files[0])
    if not _is_bag(first):
        return _configure_files(arguments)
    if len(arguments.files) > 1:
        return fail(f"{arguments.files[1]}: a bag is configured alone; give one")
    from valve_twin.io.offline.propose import propose_yaml

    text = propose_yaml(arguments.files[0], position=arguments.position, on_doubt=say)
    _write(arguments, text)
    return OK


def _is_bag(path: Path) -> bool:
    """Whether it is an MCAP bag, or is not there at all, which its reader tells."""
    from valve_twin.io.instruments.read import kind_of

    if path.is_dir():
        return bool(list(path.glob("*.mcap")) or list(path.glob("metadata.yaml"))) and (
            kind_of(path) == "mcap"
        )
    if not path.exists():
        return "*" not in path.name
    return path.suffix == ".yaml" or kind_of(path) == "mcap"


def _configure_files(arguments: argparse.Namespace) -> int:
    from valve_twin.io.configure.channels import look
    from valve_twin.io.configure.limits import MOST_CYCLES, justified_limits
    from valve_twin.io.configure.odd import odd_files, without
    from valve_twin.io.configure.proposal import limit_line, not_proposed, reasons, yaml_text
    from valve_twin.io.configure.survey import choose, even_step
    from valve_twin.io.instruments.clock import ClockChoice
    from valve_twin.io.instruments.into_bag import recording_files

    paths = recording_files(arguments.files)
    clock = ClockChoice(period_s=arguments.period, resample_s=arguments.resample)
    survey = look(paths, clock)
    if not survey.recordings[0].measured and not arguments.period:
        clock = _asked(arguments, survey, clock)
        if clock.period_s or clock.scale:
            survey = look(paths, clock)
    survey, choice = choose(survey, position=arguments.position)
    if not clock.resample_s and (step_s := even_step(survey, choice)):
        say(
            f"time: {100.0 * survey.jitter:.2g} % of the steps are off by a tenth, as where "
            f"values are stored when they change: one grid of {step_s:g} s is proposed, "
            "--resample S sets another"
        )
        clock = replace(clock, resample_s=step_s)
        survey, choice = choose(look(paths, clock), position=arguments.position)
    odd = odd_files(survey, [choice.pair, *choice.others] if choice.pair else [])
    if odd:
        paths = [p for p in paths if p not in odd]
        survey, choice = choose(without(odd, look(paths, clock)), position=arguments.position)
    for line in reasons(survey, choice, len(paths) + len(odd)):
        say(line)
    if why := not_proposed(choice):
        _picture(arguments, survey, choice)
        return fail(f"{paths[0]}: {why}")
    limits: list[Limit] = []
    if choice.repeat is None or choice.repeat.command:
        first = paths[:MOST_CYCLES]
        cycles = choice.plan.count * len(first) / len(survey.recordings)
        text = yaml_text(survey, choice, arguments.files)
        alone = choice.repeat is not None
        limits = justified_limits(text, first, cycles or math.inf, own=not alone)
        say(limit_line(limits))
    _write(arguments, yaml_text(survey, choice, arguments.files, limits))
    _picture(arguments, survey, choice)
    return OK


def _picture(arguments: argparse.Namespace, survey: Survey, choice: Choice) -> None:
    """Draw what was found beside the proposal, or where it is asked for."""
    picture = arguments.picture or (
        str(Path(arguments.out).with_suffix(".svg")) if arguments.out else ""
    )
    if picture:
        write_whole(picture, _draw(survey, choice))
        say(f"{picture}: picture written")


def _asked(arguments: argparse.Namespace, survey: Survey, known: ClockChoice) -> ClockChoice:
    """Ask the one question: how far rows are apart where the file does not say it."""
    first = survey.recordings[0]
    seconds = first.columns[0].seconds
    default = float(np.median(np.diff(seconds)))
    if arguments.yes or not sys.stdin.isatty():
        return known
    asked = f"{first.path}: {first.clock}. Seconds between two rows? [{default:g}] "
    sys.stderr.write(shown(asked))
    sys.stderr.flush()
    text = sys.stdin.readline().strip().replace(",", ".")
    if not text:
        return known
    period_s = positive_number(text)
    if first.time_column:
        scale = first.time_scale * period_s / default
        return replace(known, column=first.time_column, scale=scale)
    return replace(known, period_s=period_s)


def _write(arguments: argparse.Namespace, text: str) -> None:
    if arguments.out:
        write_whole(arguments.out, text)
        say(f"{arguments.out}: proposal written; check it before you use it")
    else:
        write(text)


def _draw(survey: Survey, choice: Choice) -> str:
    from valve_twin.io.configure.channels import unit_of
    from valve_twin.report.pictures.configure import draw_proposal

    names = [choice.pair.command, choice.pair.answer] if choice.pair else []
    if choice.driven is not None:
        names = [r.source for r in choice.driven.roles[::-1]]
    if choice.repeat is not None:
        names = [choice.repeat.channel]
    measured = survey.recordings[0].measured
    size = 1e-9 if measured else 1e-9 / survey.period_s
    rows: list[tuple[str, FloatArray, FloatArray]] = [
        (f"{name} {unit_of(survey, name)}", np.asarray(size * s.stamp_ns), s.values)
        for name in names
        for s in [survey.signals[name]]
    ]
    free_run: tuple[FloatArray, FloatArray] | None = None
    title = "what repeats" if choice.repeat else "commands and position"
    if choice.trials and choice.halves is not None:
        best, halves = choice.trials[0], choice.halves
        title = f"{best.model}: free run over the half that was not fitted {best.fit:.1f} %"
        if len(best.simulated):
            stamps = rows[-1][1][halves.first :: halves.every]
            free_run = stamps[len(halves.y) :][: len(best.simulated)], best.simulated
    return draw_proposal(title, rows, free_run, "s" if measured else "sample")
