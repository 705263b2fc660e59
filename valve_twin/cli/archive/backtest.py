# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin backtest`: forecasts of the remaining useful life, against what came."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    FAILED,
    OK,
    USAGE,
    add_verb,
    chosen_config,
    fail,
    positive,
    progress_of,
    seed_number,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.core.aging.backtest import BacktestConfig, LifeTest
    from valve_twin.core.aging.coverage import Coverage
    from valve_twin.io.config.valve import ValveConfig

_WIDTH = 150  # columns where standard output is no terminal
_HISTORIES = 500  # of the study, unless told


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "backtest",
        "Judge forecasts of the remaining useful life (RUL) by what the history did afterwards.",
        _backtest,
    )
    parser.add_argument("--url", help="database: a file or sqlite:///, postgresql://")
    parser.add_argument("--config", metavar="FILE", help="YAML of the valve")
    parser.add_argument(
        "--valve", default="", metavar="NAME", help="which valve of the file, default the first"
    )
    parser.add_argument(
        "--confidence", type=_share, default=0.9, help="of the limits, default 0.9"
    )
    parser.add_argument(
        "--alpha", type=_share, default=0.2, help="relative error that is accurate, default 0.2"
    )
    parser.add_argument(
        "--forecasts", type=positive, default=100, help="most forecasts a life, default 100"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object a life")
    parser.add_argument(
        "--study",
        type=positive,
        nargs="?",
        const=_HISTORIES,
        metavar="N",
        help=f"N simulated histories with known truth (default {_HISTORIES}), no database",
    )
    parser.add_argument("--seed", type=seed_number, default=0, help="of the study, default 0")


def _share(text: str) -> float:
    """Read a share between 0 and 1."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < 1.0:
        msg = f"'{text}' is refused: write a number between 0 and 1, such as 0.9"
        raise argparse.ArgumentTypeError(msg)
    return value


def _backtest(arguments: argparse.Namespace) -> int:
    from valve_twin.core.aging.backtest import BacktestConfig

    if arguments.study:
        return _study(arguments)
    if not (arguments.url and arguments.config):
        return fail("backtest: give --url and --config, or --study", USAGE)
    config = chosen_config(arguments)
    how = BacktestConfig(arguments.confidence, arguments.alpha, arguments.forecasts)
    where, tests = _judge(config, arguments.url, how)
    if not tests:
        return fail(f"{where}: holds no estimate of {config.name} that feeds a trend")
    if arguments.json:
        for test in tests:
            sys.stdout.write(f"{json.dumps(_plain(config.name, test, how), allow_nan=False)}\n")
    else:
        _show(f"{where}: {config.name}", tests, how)
    if any(test.forecasts for test in tests):
        return OK
    return fail(f"{where}: {config.name}: nothing to judge: {tests[0].reason}", FAILED)


def _judge(config: ValveConfig, url: str, how: BacktestConfig) -> tuple[str, Sequence[LifeTest]]:
    from valve_twin.core.aging.backtest import backtest
    from valve_twin.core.valves.registry import get_model
    from valve_twin.io.history.store import History

    with History(url, read_only=True) as history:
        where = history.where
        estimates = history.estimates(config.name, used_by_trend=True)
        maintenance = history.maintenance(config.name)
    with progress_of("judging", None) as advance:
        tests = backtest(
            estimates,
            maintenance,
            config.aging,
            parameters=get_model(config.model).parameters,
            how=how,
            on_forecast=advance,
        )
    return where, tests


def _plain(valve: str, test: LifeTest, how: BacktestConfig) -> dict[str, object]:
    """Return a life as plain data: not known = null, unbounded = "Infinity"."""
    from valve_twin.core.aging.backtest import LAMBDAS

    return {
        "kind": "life",
        "valve": valve,
        "parameter": test.parameter,
        "start": _number(test.start),
        "end": _number(test.end),
        "limit": _number(test.limit.value) if test.limit else None,
        "limit_relative": test.limit.relative if test.limit else None,
        "limit_value": _number(test.limit_value),
        "service_limit_reached": test.reached,
        "confidence": how.confidence,
        "coverage": _number(test.coverage),
        "unbounded": _number(test.unbounded),
        "alpha": how.alpha,
        "accurate": _number(test.accurate(how.alpha)),
        "alpha_lambda": [
            {"lambda": share, "error": _number(at.error), "accurate": abs(at.error) <= how.alpha}
            for share in LAMBDAS
            if (at := test.at(share)) is not None
        ],
        "silent": test.silent,
        "forecasts": [
            {k: _number(v) for k, v in dataclasses.asdict(forecast).items()}
            for forecast in test.forecasts
        ],
        "reason": test.reason,
    }


def _number(value: float) -> float | str | None:
    if math.isfinite(value):
        return value
    return None if math.isnan(value) else "Infinity" if value > 0.0 else "-Infinity"


def _show(title: str, tests: Sequence[LifeTest], how: BacktestConfig) -> None:
    """Print one row a life, then how the columns are meant."""
    from rich.console import Console
    from rich.table import Table

    from valve_twin.core.aging.backtest import LAMBDAS

    console = Console(file=sys.stdout)
    if not console.is_terminal:
        console = Console(file=sys.stdout, width=_WIDTH)
    table = Table(title=title, title_justify="left", pad_edge=False)
    table.add_column("parameter", no_wrap=True)
    shares = "/".join(f"{100 * share:.0f}" for share in LAMBDAS)
    columns = ("life", "limit", "told", f"in {how.confidence:.0%}", "open", f"error {shares} %")
    for name in (*columns, f"±{how.alpha:.0%}"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("note", ratio=1, min_width=30)
    for test in tests:
        errors = [f.error if (f := test.at(share)) else math.nan for share in LAMBDAS]
        table.add_row(
            test.parameter,
            f"{test.start:.4g} .. {test.end:.4g}" if test.forecasts else f"{test.start:.4g} ..",
            _limit(test),
            str(len(test.forecasts)),
            _percent(test.coverage),
            _percent(test.unbounded),
            " ".join(f"{e:+.0%}" if math.isfinite(e) else "-" for e in errors),
            _percent(test.accurate(how.alpha)),
            _note(test),
        )
    console.print(table)
    console.print(
        f"told: forecasts judged; in {how.confidence:.0%}: share whose limits hold the end; open: "
        "share without an upper limit;\n"
        f"error: of the median, {shares} % of the way from the first forecast to the end; "
        f"±{how.alpha:.0%}: share of medians that near.\n"
        "Forecasts of one life share their data; those near its end know the scatter at its end.",
        highlight=False,
    )


def _limit(test: LifeTest) -> str:
    if test.limit is None:
        return "-"
    change = f" ({test.limit.value:+.1f} %)" if test.limit.relative else ""
    return f"{test.limit_value:.4g}{change}"


def _note(test: LifeTest) -> str:
    if test.reason:
        return test.reason
    cycles = "cycle" if test.silent == 1 else "cycles"
    silent = f"; nothing told at {test.silent} {cycles}" if test.silent else ""
    what = "service limit reached" if test.reached else "no limit reached: the last level is one"
    return what + silent


def _percent(value: float) -> str:
    return f"{value:.0%}" if math.isfinite(value) else "-"


def _study(arguments: argparse.Namespace) -> int:
    """Print what the limits hold on simulated histories with known truth."""
    from valve_twin.core.aging.coverage import AUTOCORRELATIONS, SAMPLES, coverage_of_life

    kinds = [(n, rho) for rho in AUTOCORRELATIONS for n in SAMPLES]
    with progress_of("simulating", arguments.study * len(kinds)) as advance:
        rows = [
            coverage_of_life(
                n,
                rho,
                histories=arguments.study,
                confidence=arguments.confidence,
                seed=arguments.seed,
                on_history=advance,
            )
            for n, rho in kinds
        ]
    if arguments.json:
        for row in rows:
            plain = {"kind": "coverage", **dataclasses.asdict(row)}
            sys.stdout.write(f"{json.dumps(plain, allow_nan=False)}\n")
    else:
        _show_study(rows)
    return OK


def _show_study(rows: Sequence[Coverage]) -> None:
    from rich.console import Console
    from rich.table import Table

    first = rows[0]
    title = (
        f"{first.histories} simulated histories each, {first.nominal:.0%} limits "
        f"(binomial standard error {first.standard_error:.1%}); unbounded above counts as holding"
    )
    console = Console(file=sys.stdout)
    if not console.is_terminal:
        console = Console(file=sys.stdout, width=_WIDTH)
    table = Table(title=title, title_justify="left", pad_edge=False)
    names = ("cycles", "autocorrelation", "truth held", "all too early", "all too late")
    for name in (*names, "unbounded", "nothing said", "median too late"):
        table.add_column(name, justify="right")
    for row in rows:
        shares = (row.covered, row.too_early, row.too_late, row.unbounded, row.silent)
        table.add_row(
            str(row.samples),
            f"{row.autocorrelation:g}",
            *(f"{share:.1%}" for share in (*shares, row.median_late)),
        )
    console.print(table)
