# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The rows of the page's tables: remaining life, last estimates, refused cycles, data quality."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from markupsafe import Markup

from valve_twin.core.aging.verdict import SOON, Outlook, TrendStatus, describe_limit, outlook
from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.types import EstimateStatus, ParameterStatus
from valve_twin.report.text import (
    NONE,
    count,
    day,
    fixed,
    noted,
    number,
    percent,
    unit,
    when,
    with_interval,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.types import Estimate, ParameterValue
    from valve_twin.report.data import ReportData

MAX_ROWS = 60
"""Rows of a list of cycles; the rest is counted."""

STATUS_WORDS = {
    TrendStatus.NOT_ENOUGH_DATA: "not enough data",
    TrendStatus.STEADY: "steady",
    TrendStatus.DRIFTING: "drifting",
    TrendStatus.BEYOND_THRESHOLD: "beyond the limit",
}
_UNUSABLE = {
    ParameterStatus.AT_BOUND: "on its bound: a limit, not a measurement",
    ParameterStatus.NOT_EXCITED: "not excited by this cycle",
    ParameterStatus.REFUSED: "refused",
}


class Table(NamedTuple):
    """Headings and rows of cells; the first cell of a row is its heading."""

    head: list[str]
    rows: list[list[str]]
    caption: str = ""


def life_table(trends: Sequence[Trend], *, remarks: bool = True) -> Table:
    """Return drift and remaining life, one row a parameter; with remarks below the headings."""
    axis = trends[0].axis if trends else "cycles"
    head = [
        ("Parameter", ""),
        ("State", ""),
        ("Level now", "95 % interval"),
        ("Change against new", "95 % interval"),
        (f"Slope in 100 {axis}", "95 % interval"),
        ("Service limit", "warning limit, state"),
        (f"Remaining {axis}", "median, 95 % limits"),
        ("Service date", "median, early 95 % limit"),
    ]
    return Table(
        [noted(h, note if remarks else "") for h, note in head], [_life_row(t) for t in trends]
    )


def _life_row(t: Trend) -> list[str]:
    slope = with_interval(100 * t.slope, 100 * t.slope_lower_95, 100 * t.slope_upper_95)
    p = Markup("p = {}").format(number(t.p_value, 2)) if math.isfinite(t.p_value) else ""
    used = "1 estimate" if t.samples == 1 else f"{count(t.samples)} estimates"
    return [
        t.parameter + unit(t.unit),
        noted(STATUS_WORDS[t.status], used),
        with_interval(t.level, t.mean_lower_95, t.mean_upper_95),
        percent(t.drift_reference, t.drift_reference_lower_95, t.drift_reference_upper_95),
        noted(slope, p),
        _limits(t),
        _remaining(t),
        _service_date(t),
    ]


def _limits(t: Trend) -> Markup | str:
    if not math.isfinite(t.threshold):
        return "none"
    notes = [f"warning {number(t.warning, 4)}" if math.isfinite(t.warning) else ""]
    return noted(number(t.threshold, 4), ", ".join(filter(None, [*notes, describe_limit(t)])))


def _remaining(t: Trend) -> str:
    said = outlook(t)
    law = f" ({t.law})" if t.bends else ""
    if said is Outlook.FORECAST:
        notes = [f"{_cycles(t.remaining_low)} … {_cycles(t.remaining_high)}"]
        notes += [f"bends{law}"] if law else []
        if math.isfinite(t.next_stop_probability):
            notes.append(f"{100.0 * t.next_stop_probability:.0f} % before the next stop")
        return noted(_cycles(t.remaining_median), ", ".join(notes))
    known = said in (Outlook.OPEN, Outlook.BENDS) and SOON <= t.remaining_low < math.inf
    least = f"at least {_cycles(t.remaining_low)}" if known else ""
    return noted(said.value + (law if said is Outlook.BENDS else ""), least)


def _cycles(x: float) -> str:
    if not math.isfinite(x):
        return "unbounded"
    return count(round(x)) if abs(x) >= 10 else fixed(x, 1)


def _service_date(t: Trend) -> str:
    if outlook(t) is Outlook.REACHED:
        return "due"
    if not t.service_date_known:
        return NONE
    early = day(t.service_date_early_ns) if t.service_date_early_ns else ""
    return noted(day(t.service_date_ns), early)


def estimates_table(data: ReportData) -> tuple[int, Table] | None:
    """Return the last accepted cycle and its estimates side by side, a column an estimator."""
    shown = [e for e in data.estimates if e.estimator != FEATURES]
    accepted = [e.cycle for e in shown if e.status is not EstimateStatus.REFUSED]
    if not accepted:
        return None
    cycle = max(accepted)
    last = sorted((e for e in shown if e.cycle == cycle), key=lambda e: not e.used_by_trend)
    rows = [_parameter_row(data, name, last) for name in _published(last)]
    rows += [
        ["State", *(noted(e.status.name.lower(), e.reason) for e in last)],
        [
            noted("Free-run fit", "100 % = perfect; test: model before / training: this estimate"),
            *(f"{_fit(e.fit_test)} / {_fit(e.fit_train)}" for e in last),
        ],
        ["Condition number", *(number(e.condition_number, 3) for e in last)],
        [noted("Lag", "command to position, samples"), *(str(e.lag) for e in last)],
    ]
    if any(e.disagreements for e in last):
        about = "own value minus that of the others, in standard errors of both"
        rows.append([noted("Disagreement", about), *map(_apart, last)])
    if any(e.guards for e in last):
        rows.append(["Checks", *map(_checks, last)])
    reason = next((e.trend_reason for e in last if e.trend_reason), "")
    head = [noted(e.estimator, "feeds the trend" if e.used_by_trend else "") for e in last]
    return cycle, Table(["Parameter", *head], rows, reason)


def _published(estimates: Sequence[Estimate]) -> list[str]:
    return list(dict.fromkeys(p.name for e in estimates for p in e.parameters))


def _parameter_row(data: ReportData, name: str, last: Sequence[Estimate]) -> list[str]:
    known = data.parameter(name)
    label = noted(name + unit(known.unit), known.description) if known else name
    found = [next((p for p in e.parameters if p.name == name), None) for e in last]
    return [label, *map(_value_cell, found)]


def _apart(e: Estimate) -> str:
    """Return how far an estimate lies from each other one, one line an estimator."""
    lines: dict[str, list[str]] = {}
    for d in e.disagreements:
        if math.isfinite(d.standard_errors):
            apart = fixed(d.standard_errors, 1, sign=True)
            lines.setdefault(d.estimator, []).append(f"{d.parameter} {apart}")
    notes = (noted("", f"{name}: {', '.join(values)}") for name, values in lines.items())
    return Markup("").join(notes) or NONE


def _checks(e: Estimate) -> str:
    """Return what did not pass, and how many checks did."""
    failed = [g for g in e.guards if not g.passed]
    shown = [noted(g.name, g.reason) for g in failed]
    passed = f"{len(e.guards) - len(failed)} passed"
    return Markup("").join([*shown, passed]) if e.guards else NONE


def _fit(x: float) -> str:
    return f"{fixed(x, 1)} %" if math.isfinite(x) else NONE


def _value_cell(p: ParameterValue | None) -> str:
    if p is None:
        return NONE
    if p.status is ParameterStatus.OK:
        text = with_interval(p.value, p.lower_95, p.upper_95)
        known = math.isfinite(p.lower_95) and math.isfinite(p.upper_95)
        return noted(text, p.reason if known else "interval not calibrated")
    value = number(p.value) if math.isfinite(p.value) else NONE
    return noted(value, p.reason or _UNUSABLE[p.status])


def refused_cycles(data: ReportData) -> Table:
    """Return the cycles nothing was learnt from, and why; newest first."""
    refused = data.refused
    started = {e.cycle: e.start_ns for e in data.trend_estimates if e.cycle in refused}
    started |= {c.cycle: c.start_ns for c in data.cycles}
    found = sorted(refused.items(), reverse=True)
    rows = [[str(cycle), when(started[cycle]), why] for cycle, why in found[:MAX_ROWS]]
    before, of_all = data.condensed_refused
    total = len(found) + before
    more = f"the newest {len(rows)} of {total}" if total > len(rows) > 0 else ""
    if rows and not of_all:
        more = f"the newest {len(rows)} of at least {total}"
    head = ["Cycle", "Start", "Why it was refused"]
    if data.files:
        head.append("File")
        rows = [[*row, data.files.get(int(row[0]), NONE)] for row in rows]
    return Table(head, rows, more)


def source_files(data: ReportData) -> Table:
    """Return the imported files with the cycles that come from each, in their order."""
    numbers: dict[str, list[int]] = {}
    for cycle, name in sorted(data.files.items()):
        numbers.setdefault(name, []).append(cycle)
    good = {e.cycle for e in data.trend_estimates if e.status is not EstimateStatus.REFUSED}
    rows = [
        [name, _span(own), count(len(own)), count(len(good.intersection(own)))]
        for name, own in list(numbers.items())[-MAX_ROWS:]
    ]
    more = f"the newest {MAX_ROWS} of {len(numbers)}" if len(numbers) > MAX_ROWS else ""
    return Table(["File", "Cycles", "How many", "Estimated"], rows, more)


def _span(numbers: Sequence[int]) -> str:
    return str(numbers[0]) if len(numbers) == 1 else f"{numbers[0]} … {numbers[-1]}"


def refused_parameters(data: ReportData) -> Table:
    """Return how often a parameter of the trend's estimator could not be used, and why."""
    why: dict[tuple[str, str], Counter[str]] = {}
    for e in data.trend_estimates:
        for p in e.parameters if e.status is not EstimateStatus.REFUSED else ():
            if not p.usable:
                word = p.status.name.lower().replace("_", " ")
                why.setdefault((p.name, word), Counter())[p.reason] += 1
    rows = [
        [name, word, count(sum(reasons.values())), reasons.most_common(1)[0][0]]
        for (name, word), reasons in sorted(why.items())
    ]
    about = "single parameters that a cycle said nothing usable about; "
    about += "the others of that cycle count"
    return Table(["Parameter", "State", "Cycles", "Most frequent reason"], rows, about)


def quality(data: ReportData) -> dict[str, object]:
    """Return what share of the samples was lost or masked and what is known of the sensor."""
    counts = [e.counts for e in data.trend_estimates]
    totals = data.totals
    samples, lost = totals.samples, totals.lost
    fitted = sum(c.used for c in counts)
    masked = {k: sum(getattr(c, k) for c in counts) for k in ("seat", "stuck", "stale", "bad")}
    total = fitted + sum(masked.values())
    missed, unknown = count(totals.missed), totals.gaps
    noise = [e.noise_sigma for e in data.trend_estimates if math.isfinite(e.noise_sigma)]
    return {
        "samples": samples,
        "lost": share(lost, samples + lost),
        "fitted": fitted,
        "masked": {name: share(n, total) for name, n in masked.items()},
        "missed": missed + (f", and {count(unknown)} gaps of unknown length" if unknown else ""),
        "noise": float(np.median(noise)) if noise else math.nan,
        "reproducible": f"{count(totals.reproducible)} / {count(totals.cycles)}",
    }


def share(part: int, total: int) -> str:
    """Return a number and what percentage of all it is."""
    return f"{count(part)} ({fixed(100.0 * part / total, 2)} %)" if total else count(part)
