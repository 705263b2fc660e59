# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin reference`: what sound valves show, for the first cycles of others."""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING, TypeAlias

from valve_twin.cli.common import (
    OK,
    USAGE,
    add_url,
    add_verb,
    check_writable,
    fail,
    run_offline,
    say,
)
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.core.diagnosis.given.reference import Seen
    from valve_twin.core.past.columns import Past
    from valve_twin.core.valves.interface import ValveModel
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.io.history.store import History

    Taken: TypeAlias = tuple[Seen, dict[str, float]]

_CYCLES = 40
"""Cycles of each valve since its start, or its last maintenance, that are taken by default."""

_AMONG = 4
"""Among so many times as many cycles these must be: of a condensed history some first ones are
kept, and others thousands of cycles later."""


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "reference",
        "Write what the features of sound valves are, for the first cycles of others.",
        _reference,
    )
    add_url(parser, required=False)
    parser.add_argument(
        "--config", required=True, metavar="FILE", help="YAML of the valves: model, sampling time"
    )
    parser.add_argument(
        "--valve",
        action="append",
        default=[],
        metavar="NAME",
        help="valve of the history, again for each that is like it; with --bag: whose each is, in "
        "their order",
    )
    parser.add_argument(
        "--bag",
        action="append",
        default=[],
        metavar="BAG",
        help="recorded bag of a valve, instead; again for each that is like it",
    )
    parser.add_argument(
        "--cycles",
        metavar="A..B",
        help=f"cycles that are taken of each valve, default its first {_CYCLES} since maintenance",
    )
    parser.add_argument("-o", "--out", required=True, metavar="FILE", help="file to write")


def _reference(arguments: argparse.Namespace) -> int:
    from valve_twin.core.diagnosis.given.reference import make_reference
    from valve_twin.core.past.columns import past_of
    from valve_twin.core.valves.registry import get_model
    from valve_twin.io.config.valve import load_config
    from valve_twin.io.feature_reference import write_reference
    from valve_twin.io.history.store import History

    check_writable(arguments.out)
    bags: list[str] = arguments.bag
    if bool(bags) == bool(arguments.url) or not (bags or arguments.valve):
        return fail("reference: give --url and --valve, or --bag", USAGE)
    wanted = _wanted(arguments.cycles)
    given = ["/" + name.strip("/") for name in arguments.valve]
    if bags and given and len(given) != len(bags):
        return fail(f"reference: {len(bags)} --bag and {len(given)} --valve: name all", USAGE)
    names = list(dict.fromkeys(given))
    # a file that is not there yet may be named already
    configs = load_config(arguments.config, without=("aging.feature_reference",))
    config = _config(configs, names)
    model = get_model(config.model)
    taken: list[Taken] = []
    if arguments.url:
        with History(arguments.url, read_only=True) as history:
            taken = [_of_history(history, name, model, wanted) for name in names]
    name_of = dict(zip(bags, given, strict=True)) if given and bags else {}
    for bag in distinct(bags):
        valve = name_of.get(bag, bag)
        own = _config(configs, [valve])
        record, _ = run_offline(own, bag, close_last=False, predict=False)
        taken.append(_taken(bag, valve, past_of(record.estimates), model, wanted, 0))
    where = arguments.url or arguments.config
    try:
        made = make_reference(
            [seen for seen, _ in taken],
            name=str(arguments.out),
            model=model.name,
            features=model.feature_set.names,
            period_s=config.period_s,
            models=[m for _, m in taken] if model.feature_set.of_any_valve else (),
        )
    except ValueError as err:
        msg = f"{where}: no reference: {err}"
        raise ConfigError(msg) from None
    write_reference(made, arguments.out)
    few = "" if len(taken) > 2 else "; few valves tell little of how valves differ"
    say(f"{arguments.out}: {made.name} ({made.made_of}) written{few}")
    return OK


def distinct(bags: Sequence[str]) -> list[str]:
    """Return each bag once, as it was named first: one valve is not two that are alike.

    Parameters
    ----------
    bags : sequence of str
        Paths.
    """
    named: dict[str, str] = {}
    for bag in bags:
        named.setdefault(os.path.realpath(bag), bag)
    return list(named.values())


def _wanted(text: str | None) -> tuple[int, int] | None:
    """Return the first and last cycle of A..B.

    Raises
    ------
    ConfigError
        If it is none.
    """
    if text is None:
        return None
    found = re.fullmatch(r"(\d+)\.\.(\d+)", text.strip())
    if not found or not 0 < int(found[1]) <= int(found[2]):
        msg = f"--cycles: '{text}' is no range of cycles; write one like 1..40"
        raise ConfigError(msg)
    return int(found[1]), int(found[2])


def _config(configs: list[ValveConfig], names: list[str]) -> ValveConfig:
    """Return the configuration of the first valve that the file knows, else its first one."""
    return next((c for c in configs if c.name in names), configs[0])


def _of_history(
    history: History, valve: str, model: ValveModel, wanted: tuple[int, int] | None
) -> Taken:
    """Return the features of some cycles of a valve of a history, and its own first model.

    Raises
    ------
    ConfigError
        If the history does not hold them.
    """
    from valve_twin.core.aging.series import in_force
    from valve_twin.core.diagnosis.features import ESTIMATOR
    from valve_twin.core.past.columns import past_of

    if valve not in history.valves():
        known = ", ".join(history.valves()) or "none"
        msg = f"{history.where}: there is no valve '{valve}': give --valve, one of {known}"
        raise ConfigError(msg)
    past = past_of(history.estimates(valve, estimator=ESTIMATOR))
    since = max((m.cycle for m in in_force(history.maintenance(valve))), default=0)
    return _taken(history.where, valve, past, model, wanted, since)


def _taken(
    where: str,
    valve: str,
    past: Past,
    model: ValveModel,
    wanted: tuple[int, int] | None,
    since: int,
) -> Taken:
    """Return the features of the wanted cycles, or the first since one, and the first model."""
    import numpy as np

    from valve_twin.core.diagnosis.given.judged import first_model, seen_of
    from valve_twin.core.diagnosis.history import followed_features

    rows = followed_features(past)
    if rows is None or rows.models[0] != model.name:
        other = f"they are of model '{rows.models[0]}'" if rows is not None else "there are none"
        msg = f"{where}: no features of {valve} are of model '{model.name}': {other}"
        raise ConfigError(msg)
    begin = since or int(rows.cycle[0])
    first, last = wanted or (begin, begin + _AMONG * _CYCLES - 1)
    index = np.flatnonzero((rows.cycle >= first) & (rows.cycle <= last))
    rows = rows.take(index if wanted else index[:_CYCLES])
    if not len(rows):
        msg = f"{where}: {valve} has no features in cycles {first}..{last}"
        raise ConfigError(msg)
    return seen_of(rows, model, valve), first_model(rows)
