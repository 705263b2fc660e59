# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The tables of the page: remaining life, last estimates, refused cycles, data quality."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging import TrendStatus
from valve_twin.core.types import EstimateStatus, ParameterStatus
from valve_twin.report.text import (
    NONE,
    count,
    day,
    describe,
    esc,
    fixed,
    number,
    percent,
    unit,
    when,
    with_interval,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.aging import Trend
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


def table(
    head: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "", style: str = ""
) -> str:
    """Return a table; cells are HTML already, the first of each row is its heading."""
    heads = "".join(f'<th scope="col">{h}</th>' for h in head)
    body = "\n".join(
        f'<tr><th scope="row">{first}</th>' + "".join(f"<td>{c}</td>" for c in rest) + "</tr>"
        for first, *rest in rows
    )
    title = f"<caption>{caption}</caption>" if caption else ""
    return (
        f'<div class="scroll"><table class="{style}">{title}<thead><tr>{heads}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div>"
    )


def life_table(trends: Sequence[Trend]) -> str:
    """Return the table of drift and remaining life, one row a parameter."""
    axis = esc(trends[0].axis) if trends else "cycles"
    head = [
        "Parameter",
        "State",
        "Level now<small>95 % interval</small>",
        "Change against new<small>95 % interval</small>",
        f"Slope in 100 {axis}<small>95 % interval</small>",
        "Service limit",
        f"Remaining {axis}<small>median, 95 % limits</small>",
        "Service date<small>median, early 95 % limit</small>",
    ]
    return table(head, [_life_row(t) for t in trends], style="figures")


def _life_row(t: Trend) -> list[str]:
    name = f"{esc(t.parameter)}{unit(t.unit)}"
    slope = with_interval(100 * t.slope, 100 * t.slope_lower_95, 100 * t.slope_upper_95)
    p = f"<small>p = {number(t.p_value, 2)}</small>" if math.isfinite(t.p_value) else ""
    return [
        name,
        f"{STATUS_WORDS[t.status]}<small>{count(t.samples)} estimates</small>",
        with_interval(t.level, t.mean_lower_95, t.mean_upper_95),
        percent(t.drift_reference, t.drift_reference_lower_95, t.drift_reference_upper_95),
        slope + p,
        number(t.threshold, 4) if math.isfinite(t.threshold) else "none",
        _remaining(t),
        _service_date(t),
    ]


def _remaining(t: Trend) -> str:
    if t.status is TrendStatus.NOT_ENOUGH_DATA:
        return "not enough data"
    if not math.isfinite(t.threshold):
        return "no limit set"
    if t.remaining_high <= 0.0:
        return "reached"
    if not math.isfinite(t.remaining_median):
        low = f"<small>at least {_cycles(t.remaining_low)}</small>"
        return "no end in sight" + (low if math.isfinite(t.remaining_low) else "")
    upper = "unbounded" if t.unbounded else _cycles(t.remaining_high)
    return f"{_cycles(t.remaining_median)}<small>{_cycles(t.remaining_low)} … {upper}</small>"


def _cycles(x: float) -> str:
    if not math.isfinite(x):
        return "unbounded"
    return count(round(x)) if abs(x) >= 10 else fixed(x, 1)


def _service_date(t: Trend) -> str:
    if t.remaining_high <= 0.0:
        return "due"
    if not t.service_date_known:
        return NONE
    early = f"<small>{day(t.service_date_early_ns)}</small>" if t.service_date_early_ns else ""
    return day(t.service_date_ns) + early


def estimates_table(data: ReportData, last: Sequence[Estimate]) -> str:
    """Return the last cycle's estimates side by side, one column an estimator."""
    names = list(dict.fromkeys(p.name for e in last for p in e.parameters))
    head = ["Parameter", *(_estimator_head(e) for e in last)]
    rows = []
    for name in names:
        known = data.parameter(name)
        about = f"<small>{describe(known)}</small>" if known else ""
        label = f"{esc(name)}{unit(known.unit) if known else ''}{about}"
        found = [next((p for p in e.parameters if p.name == name), None) for e in last]
        rows.append([label, *(_value_cell(p) for p in found)])
    rows.append(["State", *(_state(e) for e in last)])
    rows.append(
        [
            "Free-run fit<small>100 % = perfect; of the model before / of this estimate</small>",
            *(f"{_fit(e.fit_test)} / {_fit(e.fit_train)}" for e in last),
        ]
    )
    rows.append(["Condition number", *(number(e.condition_number, 3) for e in last)])
    rows.append(["Lag<small>command to position, samples</small>", *(str(e.lag) for e in last)])
    if any(e.disagreements for e in last):
        about = "own value minus that of the others, in standard errors of both"
        rows.append([f"Disagreement<small>{about}</small>", *(_apart(e) for e in last)])
    if any(e.guards for e in last):
        rows.append(["Checks", *(_checks(e) for e in last)])
    reason = next((e.trend_reason for e in last if e.trend_reason), "")
    return table(head, rows, esc(reason))


def _apart(e: Estimate) -> str:
    """Return how far an estimate lies from each other one, one line an estimator."""
    lines: dict[str, list[str]] = {}
    for d in e.disagreements:
        if math.isfinite(d.standard_errors):
            apart = fixed(d.standard_errors, 1, sign=True)
            lines.setdefault(d.estimator, []).append(f"{esc(d.parameter)} {apart}")
    return "".join(f"<small>{esc(k)}: {', '.join(v)}</small>" for k, v in lines.items()) or NONE


def _checks(e: Estimate) -> str:
    """Return what did not pass, and how many checks did."""
    failed = [g for g in e.guards if not g.passed]
    passed = len(e.guards) - len(failed)
    shown = [f"{esc(g.name)}<small>{esc(g.reason)}</small>" for g in failed]
    return "".join([*shown, f"{passed} passed"]) if e.guards else NONE


def _estimator_head(e: Estimate) -> str:
    return esc(e.estimator) + ("<small>feeds the trend</small>" if e.used_by_trend else "")


def _fit(x: float) -> str:
    return f"{fixed(x, 1)} %" if math.isfinite(x) else NONE


def _state(e: Estimate) -> str:
    return f"{e.status.name.lower()}<small>{esc(e.reason)}</small>"


def _value_cell(p: ParameterValue | None) -> str:
    if p is None:
        return NONE
    if p.status is ParameterStatus.OK:
        text = with_interval(p.value, p.lower_95, p.upper_95)
        known = math.isfinite(p.lower_95) and math.isfinite(p.upper_95)
        return text + ("" if known else "<small>interval not calibrated</small>")
    word = {
        ParameterStatus.AT_BOUND: "on its bound: a limit, not a measurement",
        ParameterStatus.NOT_EXCITED: "not excited by this cycle",
        ParameterStatus.REFUSED: "refused",
    }[p.status]
    reason = p.reason or word
    value = number(p.value) if math.isfinite(p.value) else NONE
    return f"{value}<small>{esc(reason)}</small>"


def refused_cycles_table(data: ReportData) -> str:
    """Return the table of cycles nothing was learnt from, and why; newest first."""
    rows = [
        [str(c.cycle), when(c.start_ns), esc(c.reason or "no reason recorded")]
        for c in data.cycles
        if not c.accepted
    ]
    started = {c.cycle: c.start_ns for c in data.cycles}
    rows += [
        [str(e.cycle), when(started.get(e.cycle, e.start_ns)), esc(e.reason)]
        for e in data.trend_estimates
        if e.status is EstimateStatus.REFUSED
    ]
    rows.sort(key=lambda row: -int(row[0]))
    if not rows:
        return "<p>No cycle was refused.</p>"
    more = len(rows) - MAX_ROWS
    caption = f"the newest {MAX_ROWS} of {len(rows)}" if more > 0 else ""
    return table(["Cycle", "Start", "Why it was refused"], rows[:MAX_ROWS], caption)


def refused_parameters_table(data: ReportData) -> str:
    """Return how often a parameter of the trend's estimator could not be used, and why."""
    why: dict[tuple[str, str], Counter[str]] = {}
    for e in data.trend_estimates:
        for p in e.parameters if e.status is not EstimateStatus.REFUSED else ():
            if not p.usable:
                word = p.status.name.lower().replace("_", " ")
                why.setdefault((p.name, word), Counter())[p.reason] += 1
    if not why:
        return ""
    rows = [
        [esc(name), word, count(sum(reasons.values())), esc(reasons.most_common(1)[0][0])]
        for (name, word), reasons in sorted(why.items())
    ]
    return table(
        ["Parameter", "State", "Cycles", "Most frequent reason"],
        rows,
        "single parameters that a cycle said nothing usable about; the others of that cycle count",
    )


def quality_table(data: ReportData) -> str:
    """Return what share of the samples was lost or masked and what is known of the sensor."""
    used = data.trend_estimates
    samples = sum(c.samples for c in data.cycles)
    lost = sum(c.lost for c in data.cycles)
    missed = sum(max(c.missed_cycles, 0) for c in data.cycles)
    unknown = sum(c.missed_cycles < 0 for c in data.cycles)
    fitted = sum(e.counts.used for e in used)
    rows = [
        ["Samples received", count(samples), ""],
        ["Samples lost", _share(lost, samples + lost), "gaps between stamps above 1.5 periods"],
        ["Samples in the fits", count(fitted), "of all accepted cycles"],
    ]
    masks = {
        "seat": "spool on a stop with the command pushing into it",
        "stuck": "spool did not move although commanded",
        "stale": "sensor repeated its last value",
        "bad": "not a number, or out of its range",
    }
    for name, meaning in masks.items():
        masked = sum(getattr(e.counts, name) for e in used)
        total = fitted + sum(sum(getattr(e.counts, m) for m in masks) for e in used)
        rows.append([f"Masked: {name}", _share(masked, total), meaning])
    text = count(missed) + (f", and {count(unknown)} gaps of unknown length" if unknown else "")
    rows.append(["Cycles missed", text, "while the twin was down"])
    noise = np.array([e.noise_sigma for e in used])
    noise = noise[np.isfinite(noise)]
    middle = number(float(np.median(noise)), 2) if len(noise) else NONE
    rows.append(
        ["Position noise at rest", middle, "median standard deviation, share of the stroke"]
    )
    repeat = sum(c.reproducible for c in data.cycles)
    rows.append(
        ["Reproducible cycles", f"{count(repeat)} of {count(len(data.cycles))}",
         "all inputs carried stamps and none was lost: offline gives the same bits"]
    )  # fmt: skip
    return table(["", "", "Meaning"], rows)


def _share(part: int, total: int) -> str:
    if not total:
        return count(part)
    return f"{count(part)} ({fixed(100.0 * part / total, 2)} %)"


def maintenance_table(data: ReportData) -> str:
    """Return the maintenance events, empty where there are none."""
    if not data.maintenance:
        return ""
    rows = [
        [
            str(m.cycle),
            when(m.stamp_ns),
            esc(m.note),
            "new reference" if m.new_reference else "reference kept",
        ]
        for m in data.maintenance
    ]
    return table(["First cycle after", "Time", "What was done", "Reference"], rows)
