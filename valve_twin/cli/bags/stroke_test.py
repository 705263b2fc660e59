# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin stroke-test`: judge the one stroke of a bag that somebody else commanded."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.cli.common import FAILED, OK, add_bag, add_config, add_verb, chosen_config, fail
from valve_twin.cli.output import number, plain, print_json, write
from valve_twin.io.errors import ConfigError, StoreError

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.core.operation.stroke_test import StrokeLimits, StrokeTest
    from valve_twin.core.types import FloatArray
    from valve_twin.io.config.valve import ValveConfig


def add(verbs: Verbs) -> None:
    """Add the verb."""
    text = "Judge the one stroke of a bag, partial or full, that somebody else commanded."
    parser = add_verb(verbs, "stroke-test", text, _stroke_test)
    add_bag(parser)
    add_config(parser)
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="a limit, e.g. t63_s=3"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--url", help="history whose event log takes the test down")


def _stroke_test(arguments: argparse.Namespace) -> int:
    from valve_twin.core.operation.stroke_test import StrokeVerdict, judge_stroke

    config = chosen_config(arguments)
    limits = _limits(arguments.set)
    start_ns, *signals = _signals(config, arguments.bag)
    found = judge_stroke(*signals, limits=limits)
    if found.verdict is StrokeVerdict.REFUSED:
        return fail(f"{arguments.bag}: no stroke to judge: {found.reason}")
    if arguments.url:
        _take_down(arguments.url, config.name, start_ns, found)
    if arguments.json:
        _print(config.name, found)
    else:
        _show(found)
    return OK if found.verdict is StrokeVerdict.PASS else FAILED


def _take_down(url: str, valve: str, start_ns: int, found: StrokeTest) -> None:
    """Enter a test in the event log of a valve that the history knows."""
    from valve_twin.core.operation.stroke_due import stroke_event
    from valve_twin.io.history.database import must_be_there
    from valve_twin.io.history.store import History

    must_be_there(url)
    with History(url) as history:
        if valve not in history.valves():
            known = ", ".join(history.valves()) or "no valve"
            msg = f"{history.where}: knows nothing about {valve}; it holds {known}"
            raise StoreError(msg)
        history.log.add_stroke(valve, stroke_event(start_ns, found))


def _limits(given: list[str]) -> StrokeLimits:
    """Return the limits with what was set."""
    from valve_twin.core.operation.stroke_test import StrokeLimits
    from valve_twin.core.quantity import checked, replaced

    values: dict[str, object] = {}
    for text in given:
        name, _, value = text.partition("=")
        try:
            values |= checked(StrokeLimits, {name: _number(value)}, unknown="no such limit")
        except ValueError as err:
            msg = f"--set {text}: {err}"
            raise ConfigError(msg) from None
    return replaced(StrokeLimits(), values)


def _number(text: str) -> float | str:
    """Return the number a text stands for; the text where it stands for none, to be refused."""
    try:
        return float(text)
    except ValueError:
        return text


def _signals(config: ValveConfig, bag: str) -> tuple[int, FloatArray, FloatArray, FloatArray]:
    """Return the first stamp [ns], times from it [s], the command in force and the position."""
    from valve_twin.core.valves.registry import get_model
    from valve_twin.io.bags.read import read_columns

    model = get_model(config.model)
    if len(model.inputs) != 1:
        have = ", ".join(model.inputs) or "none"
        msg = (
            f"{config.name}: a stroke has one command, model {model.name} has {have}; take a "
            "model with one command for the test"
        )
        raise ConfigError(msg)
    sources = [config.signals[name] for name in (model.inputs[0], model.output)]
    command, position = read_columns(bag, sources)
    order = np.argsort(position.stamp_ns, kind="stable")
    stamps, first = np.unique(position.stamp_ns[order], return_index=True)
    values = position.values[order][first]
    held = np.argsort(command.stamp_ns, kind="stable")
    at = np.searchsorted(command.stamp_ns[held], stamps, side="right") - 1
    known = at >= 0
    start_ns = int(stamps[known][0]) if known.any() else 0
    return (
        start_ns,
        (stamps[known] - start_ns) / 1e9,
        command.values[held][at[known]],
        values[known],
    )


def _print(valve: str, found: StrokeTest) -> None:
    criteria = [{**asdict(c), "passed": c.passed, "excess": c.excess} for c in found.criteria]
    fields = {"kind": "stroke_test", "valve": valve, "verdict": found.verdict.value,
              "stroke": found.stroke, "noise": found.noise, "criteria": criteria}  # fmt: skip
    print_json({name: plain(value) for name, value in fields.items()})


def _show(found: StrokeTest) -> None:
    lines = [
        f"{c.name:13} {number(c.value, '8.4g'):>8} of {c.limit:8.4g}  "
        f"{'kept' if c.passed else f'not kept, by {c.excess:.4g}'}"
        for c in found.criteria
    ]
    write("".join(f"{line}\n" for line in [*lines, found.verdict.value]))
