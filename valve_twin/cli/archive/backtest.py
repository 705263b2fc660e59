# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin backtest`: forecasts of the remaining useful life, against what came."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

from valve_twin.cli.common import (
    FAILED,
    OK,
    USAGE,
    add_config,
    add_url,
    add_verb,
    chosen_config,
    fail,
    positive,
    progress_of,
    say,
    seed_number,
    share_number,
)
from valve_twin.cli.output import console, number, plain, print_json, table

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from valve_twin.cli.common import Verbs
    from valve_twin.core.aging.backtest import BacktestConfig, LifeTest
    from valve_twin.core.aging.coverage import Coverage
    from valve_twin.core.aging.laws.study import LawCoverage
    from valve_twin.io.config.valve import ValveConfig

_HISTORIES = 500  # of the study, by default


def add(verbs: Verbs) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs,
        "backtest",
        "Judge forecasts of the remaining useful life (RUL) by what the history did afterwards.",
        _backtest,
    )
    add_url(parser, required=False)
    add_config(parser, "YAML of the valve, not for --study")
    parser.add_argument(
        "--confidence", type=share_number, default=0.9, help="of the limits, default 0.9"
    )
    parser.add_argument(
        "--alpha",
        type=share_number,
        default=0.2,
        help="relative error that is accurate, default 0.2",
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
            print_json(_plain(config.name, test, how))
    else:
        _show(f"{where}: {config.name}", tests, how)
    if any(test.forecasts for test in tests):
        return OK
    return fail(f"{where}: {config.name}: nothing to judge: {tests[0].reason}", FAILED)


def _judge(config: ValveConfig, url: str, how: BacktestConfig) -> tuple[str, Sequence[LifeTest]]:
    from valve_twin.core.aging.backtest import backtest
    from valve_twin.core.valves.registry import get_model
    from valve_twin.io.history.store import History
    from valve_twin.io.history.tiers.extent import condensed, told

    with History(url, read_only=True) as history:
        where = history.where
        estimates = history.estimates(config.name, used_by_trend=True)
        maintenance = history.maintenance(config.name)
        old = condensed(history, config.name)
    if old is not None:
        say(f"{where}: {told(old)}: only those are judged")
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

    errors = [(share, at.error) for share in LAMBDAS if (at := test.at(share)) is not None]
    values: dict[str, object] = {
        "kind": "life",
        "valve": valve,
        "parameter": test.parameter,
        "start": test.start,
        "end": test.end,
        "limit": test.limit.value if test.limit else None,
        "limit_relative": test.limit.relative if test.limit else None,
        "limit_value": test.limit_value,
        "service_limit_reached": test.reached,
        "confidence": how.confidence,
        "coverage": test.coverage,
        "unbounded": test.unbounded,
        "brier": test.brier,
        "brier_skill": test.brier_skill,
        "alpha": how.alpha,
        "accurate": test.accurate(how.alpha),
        "alpha_lambda": [
            {"lambda": share, "error": error, "accurate": abs(error) <= how.alpha}
            for share, error in errors
        ],
        "silent": test.silent,
        "forecasts": [dataclasses.asdict(forecast) for forecast in test.forecasts],
        "reason": test.reason,
    }
    return {name: plain(value) for name, value in values.items()}


def _show(title: str, tests: Sequence[LifeTest], how: BacktestConfig) -> None:
    """Print one row a life, then how the columns are meant."""
    from valve_twin.core.aging.backtest import LAMBDAS

    out, shown = console(), table(title, ("parameter",))
    shares = "/".join(f"{100 * share:.0f}" for share in LAMBDAS)
    columns = ("life", "limit", "judged", f"in {how.confidence:.0%}", "open", f"error {shares} %")
    for name in (*columns, f"±{how.alpha:.0%}", "Brier skill"):
        shown.add_column(name, justify="right", no_wrap=True)
    shown.add_column("note", ratio=1, min_width=30)
    for test in tests:
        errors = [f.error if (f := test.at(share)) else math.nan for share in LAMBDAS]
        shown.add_row(
            test.parameter,
            f"{test.start:.4g} .. {test.end:.4g}" if test.forecasts else f"{test.start:.4g} ..",
            _limit(test),
            str(len(test.forecasts)),
            number(test.coverage, ".0%"),
            number(test.unbounded, ".0%"),
            " ".join(number(e, "+.0%") for e in errors),
            number(test.accurate(how.alpha), ".0%"),
            number(test.brier_skill, "+.2f"),
            _note(test),
        )
    out.print(shown)
    out.print(
        f"judged: forecasts; in {how.confidence:.0%}: share whose limits hold the end; open: "
        "share without an upper limit;\n"
        f"error: of the median, {shares} % of the way from the first forecast to the end; "
        f"±{how.alpha:.0%}: share of medians that near; Brier skill: of the probability to reach "
        "the limit\nbefore a next stop, against the base rate (1 = knows the future, 0 = no "
        "better).\n"
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
    silent = f"; no forecast at {test.silent} {cycles}" if test.silent else ""
    what = "service limit reached" if test.reached else "no limit reached: the last level is one"
    return what + silent


def _study(arguments: argparse.Namespace) -> int:
    """Print what the limits hold on simulated histories with known truth."""
    from valve_twin.core.aging.config import LAWS
    from valve_twin.core.aging.coverage import AUTOCORRELATIONS, SAMPLES, coverage_of_life
    from valve_twin.core.aging.laws.study import study_laws

    count = arguments.study
    kinds = [(n, rho) for rho in AUTOCORRELATIONS for n in SAMPLES]
    with progress_of("simulating", count * (len(kinds) + len(LAWS))) as advance:
        how = {"confidence": arguments.confidence, "seed": arguments.seed, "on_history": advance}
        lines = [coverage_of_life(n, rho, histories=count, **how) for n, rho in kinds]
        laws = study_laws(histories=count, **how)
    if arguments.json:
        for row in lines:
            print_json({"kind": "coverage", **dataclasses.asdict(row)})
        for law in laws:
            print_json({"kind": "law_coverage", **dataclasses.asdict(law)})
    else:
        _show_study(lines)
        _show_laws(laws)
    return OK


def _show_study(rows: Sequence[Coverage]) -> None:
    first = rows[0]
    title = (
        f"{first.histories} simulated lines each, known to be lines, {first.nominal:.0%} limits "
        f"(binomial standard error {first.standard_error:.1%}); unbounded above counts as holding"
    )
    names = ("cycles", "autocorrelation", "truth held", "all too early", "all too late")
    shown = table(title, (), (*names, "unbounded", "nothing said", "median too late"))
    for row in rows:
        shares = (row.covered, row.too_early, row.too_late, row.unbounded, row.silent)
        shown.add_row(
            str(row.samples),
            f"{row.autocorrelation:g}",
            *(f"{share:.1%}" for share in (*shares, row.median_late)),
        )
    console().print(shown)


def _show_laws(rows: Sequence[LawCoverage]) -> None:
    """Print one row a law, then all of them."""
    from valve_twin.core.aging.laws.study import brier_skill

    title = f"{rows[0].histories} random histories of each law, which the twin is not told"
    names = ("truth held", "all too early", "all too late", "with an upper limit", "bends")
    shown = table(title, ("law",), (*names, "Brier score"))
    for row in rows:
        shares = (row.covered, row.too_early, row.too_late, row.bounded, row.bends)
        shown.add_row(row.law, *(f"{share:.1%}" for share in shares), f"{row.brier:.3f}")
    console().print(shown)
    console().print(
        f"Brier skill of the probability to reach the limit before the next stop, all laws: "
        f"{brier_skill(rows):+.2f} (1 = knows the future, 0 = no better than the base rate).",
        highlight=False,
    )
