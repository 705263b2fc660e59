# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin stroke-test`: judge the one stroke of a bag that somebody else commanded."""

from __future__ import annotations

import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.cli.common import FAILED, OK, add_bag, add_config, add_verb, chosen_config, fail
from valve_twin.cli.output import number, plain, print_json
from valve_twin.io.errors import ConfigError

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


def _stroke_test(arguments: argparse.Namespace) -> int:
    from valve_twin.core.operation.stroke_test import StrokeVerdict, judge_stroke

    config = chosen_config(arguments)
    limits = _limits(arguments.set)
    found = judge_stroke(*_signals(config, arguments.bag), limits=limits)
    if found.verdict is StrokeVerdict.REFUSED:
        return fail(f"{arguments.bag}: no stroke to judge: {found.reason}")
    if arguments.json:
        _print(config.name, found)
    else:
        _show(found)
    return OK if found.verdict is StrokeVerdict.PASS else FAILED


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


def _signals(config: ValveConfig, bag: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times [s], the command in force and the position, a sample of the position each."""
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
    times = (stamps[known] - (stamps[known][0] if known.any() else 0)) / 1e9
    return times, command.values[held][at[known]], values[known]


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
    sys.stdout.write("".join(f"{line}\n" for line in [*lines, found.verdict.value]))
