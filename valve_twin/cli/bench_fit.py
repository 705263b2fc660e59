# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin bench-fit`: what the record of a test bench says about a valve."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.cli.common import OK, add_verb, check_writable, fail, write_file
from valve_twin.cli.output import console, number, plain, print_json, table
from valve_twin.core.quantity import suggest
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    import argparse

    from valve_twin.cli.common import Verbs
    from valve_twin.core.valves.bench_fit import BenchFit, BenchResult, Setting


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "bench-fit",
        "Fit the record of a test bench (CSV, units in the column names), with intervals.",
        _bench_fit,
    )
    parser.add_argument("kind", nargs="?", metavar="KIND", help="what was measured; none: a list")
    parser.add_argument("csv", nargs="?", metavar="CSV", help="record with a header")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="a setting of the kind"
    )
    parser.add_argument("--plot", metavar="SVG", help="picture to write")
    parser.add_argument("--json", action="store_true", help="one JSON object")


def known_fits() -> dict[str, BenchFit]:
    """Return all kinds of bench records by name."""
    return {fit.kind: fit for name in model_names() for fit in get_model(name).bench_fits()}


def _bench_fit(arguments: argparse.Namespace) -> int:
    fits = known_fits()
    if arguments.kind is None:
        _list(fits)
        return OK
    if arguments.kind not in fits:
        known = suggest(arguments.kind, list(fits))
        msg = f"bench-fit: there is no kind '{arguments.kind}'; {known}"
        raise ConfigError(msg)
    fit = fits[arguments.kind]
    if arguments.csv is None:
        msg = f"bench-fit {fit.kind}: give a CSV file with {_columns(fit)}"
        raise ConfigError(msg)
    settings = _settings(fit, arguments.set)
    check_writable(arguments.plot)
    from valve_twin.io.tables.bench_csv import read_bench_record

    path = Path(arguments.csv)
    columns = read_bench_record(path, fit.columns)
    try:
        result = fit.fit(columns, settings)
    except ValueError as err:
        return fail(f"{path}: {err}")
    if arguments.plot:
        from valve_twin.report.bench_fit import draw_bench_fit

        write_file(arguments.plot, draw_bench_fit(fit.kind, result.plots))
    _show(fit, result, as_json=arguments.json)
    if result.doubt:
        return fail(f"{path}: do not use these values: {result.doubt}")
    return OK


def _settings(fit: BenchFit, given: list[str]) -> dict[str, float | str]:
    """Return the settings of a kind from NAME=VALUE, else their defaults."""
    known = {s.name: s for s in fit.settings}
    values: dict[str, float | str | None] = {s.name: s.default for s in fit.settings}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or name not in known:
            wanted = suggest(name, list(known)) if known else "it takes none"
            msg = f"bench-fit {fit.kind}: --set {text}: there is no such setting; {wanted}"
            raise ConfigError(msg)
        values[name] = _value(fit, known[name], value)
    for name, found in values.items():
        if found is None:
            about = known[name].about
            msg = f"bench-fit {fit.kind}: {about} is not in the record; give --set {name}="
            raise ConfigError(msg)
    return {name: found for name, found in values.items() if found is not None}


def _value(fit: BenchFit, setting: Setting, text: str) -> float | str:
    if setting.choices:
        if text in setting.choices:
            return text
        wanted = suggest(text, setting.choices)
    else:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        wanted = f"write a number: {setting.about}"
    msg = f"bench-fit {fit.kind}: --set {setting.name}={text}: {wanted}"
    raise ConfigError(msg)


def _columns(fit: BenchFit) -> str:
    from valve_twin.core.valves.bench_fit import UNITS

    return ", ".join(f"{c.name}_{next(iter(UNITS[c.measures]), 'UNIT')}" for c in fit.columns)


def _list(fits: dict[str, BenchFit]) -> None:
    last = ["settings", "what it tells"]
    shown = table("Bench records that can be fitted", ["kind", "columns"], last=last)
    for fit in fits.values():
        names = ", ".join(
            f"{s.name}={s.default if s.default is not None else '...'}" for s in fit.settings
        )
        shown.add_row(fit.kind, _columns(fit), names, fit.about)
    console().print(shown)


def _show(fit: BenchFit, result: BenchResult, *, as_json: bool) -> None:
    if as_json:
        values = {
            v.name: {
                "value": plain(v.value, None),
                "lower_95": plain(v.lower, None),
                "upper_95": plain(v.upper, None),
                "unit": v.unit,
            }
            for v in result.values
        }
        print_json({"kind": fit.kind, "values": values, "remark": result.remark,
                    "doubt": result.doubt})  # fmt: skip
        return
    shown = table(f"{fit.kind}: {fit.about}", ["value"], ["", "95 % interval", ""], ["unit"])
    for v in result.values:
        cells = (number(x, ".5g") for x in (v.value, v.lower, v.upper))
        shown.add_row(v.name, *cells, v.unit)
    console().print(shown)
    console().print(result.remark, highlight=False)
