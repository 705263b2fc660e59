# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The report page: one HTML file with everything in it, to be read, printed and filed."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.core.aging import VerdictKind
from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.types import EstimateStatus, ParameterStatus
from valve_twin.io.errors import ValveTwinError
from valve_twin.report.budget import budget_section
from valve_twin.report.faults import faults_section
from valve_twin.report.plots import Marks, has_line, plot_cycle, plot_parameter
from valve_twin.report.style import CSS
from valve_twin.report.tables import (
    STATUS_WORDS,
    estimates_table,
    life_table,
    maintenance_table,
    quality_table,
    refused_cycles_table,
    refused_parameters_table,
)
from valve_twin.report.text import count, describe, esc, fixed, unit, when

if TYPE_CHECKING:
    from valve_twin.core.aging import Trend, TrendDetail, Verdict
    from valve_twin.core.types import Estimate
    from valve_twin.report.data import ReportData

_LIGHTS = {
    VerdictKind.OK: ("ok", "The valve is in order"),
    VerdictKind.VALVE: ("bad", "The valve needs attention"),
    VerdictKind.COMMAND: ("warn", "The command looks wrong, not the valve"),
    VerdictKind.SENSOR: ("warn", "The sensor looks wrong, not the valve"),
    VerdictKind.SUPPLY: ("warn", "The supply looks wrong, not the valve"),
    VerdictKind.NOT_ENOUGH_DATA: ("unsure", "Not enough data for a verdict"),
}
_ICONS = {  # a shape each, for those who see no difference in the colours
    "ok": '<circle cx="25" cy="25" r="24"/><path d="M14 26l8 8 15-17" class="sign"/>',
    "bad": '<path d="M25 2 49 46H1z"/><path d="M25 18v13M25 38v1" class="sign"/>',
    "warn": '<path d="M25 1 49 25 25 49 1 25z"/><path d="M25 13v15M25 35v1" class="sign"/>',
    "unsure": '<rect x="2" y="2" width="46" height="46" rx="8"/>'
    '<path d="M17 18c1-10 17-10 16 0-1 6-8 6-8 12M25 37v1" class="sign"/>',
}
_SIGN = ".sign { fill: none; stroke: #fff; stroke-width: 5; stroke-linecap: round; }"


def write_report(data: ReportData, path: str | Path) -> Path:
    """Write the report page.

    Parameters
    ----------
    data : ReportData
        What is to be shown.
    path : str or Path
        HTML file; one that exists is replaced when the new one is complete.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ValveTwinError
        If the file cannot be written.
    """
    target = Path(path)
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        part.write_text(render_report(data), encoding="utf-8")
        os.replace(part, target)
    except OSError as err:
        part.unlink(missing_ok=True)
        msg = (
            f"{target}: the report cannot be written: {err.strerror or err}: "
            "check the folder, its access rights and the free space"
        )
        raise ValveTwinError(msg) from err
    return target


def render_report(data: ReportData) -> str:
    """Return the page as HTML; the same data give the same bytes."""
    sections = [
        _header(data),
        _verdict(data),
        _facts(data),
        _last_cycle(data),
        _parameters(data),
        _life(data),
        faults_section(data.assessment if data.aging else None),
        _estimates(data),
        budget_section(data.budget),
        _refused(data),
        _quality(data),
        _reading(data),
        _footer(data),
    ]
    body = "\n".join(s for s in sections if s)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Valve report {esc(data.valve)}</title>\n<style>{CSS}{_SIGN}</style></head>\n"
        f"<body><main>\n{body}\n</main></body></html>\n"
    )


def _header(data: ReportData) -> str:
    kind = "Valve report" + (f": {data.label}" if data.label else ": aging and condition")
    lines = [f"Model {esc(data.model)}. Data: {esc(data.source)}."]
    if data.cycles:
        first, last = data.cycles[0], data.cycles[-1]
        lines.append(
            f"Cycles {first.cycle} to {last.cycle}, from {when(first.start_ns)} to "
            f"{when(last.end_ns)}."
        )
    meta = "".join(f'<p class="meta">{line}</p>' for line in lines)
    return f'<header><p class="kind">{esc(kind)}</p><h1>{esc(data.valve)}</h1>{meta}</header>'


def _verdict(data: ReportData) -> str:
    if not data.aging:
        style, word = "unsure", "No aging verdict"
        why = f"The cycles differ ({data.label}); what changes between them is not taken for wear."
    elif data.assessment is None:
        style, word = _LIGHTS[VerdictKind.NOT_ENOUGH_DATA]
        why = "The trend was not assessed."
    else:
        verdict: Verdict = data.assessment.verdict
        style, word = _LIGHTS[verdict.verdict]
        why = verdict.evidence
    return (
        f'<section class="verdict {style}"><svg viewBox="0 0 50 50" aria-hidden="true">'
        f"{_ICONS[style]}</svg><div><b>{word}</b><p>{esc(why)}</p></div></section>"
    )


def _facts(data: ReportData) -> str:
    accepted = sum(c.accepted for c in data.cycles)
    refused = len(data.cycles) - accepted
    lost = sum(c.lost for c in data.cycles)
    facts = [("Cycles", count(len(data.cycles)), f"{count(refused)} refused")]
    used = [e for e in data.trend_estimates if e.status is not EstimateStatus.REFUSED]
    if used:
        last = used[-1]
        fit, which = (
            (last.fit_test, "model from the cycles before")
            if math.isfinite(last.fit_test)
            else (last.fit_train, "model of this cycle itself")
        )
        facts.append((f"Free-run fit, cycle {last.cycle}", f"{fixed(fit, 1)} %", which))
    samples = sum(c.samples for c in data.cycles) + lost
    share = f"{fixed(100.0 * lost / samples, 2)} % of all" if samples else ""
    facts.append(("Samples lost", count(lost), share))
    trends = data.assessment.trends if data.assessment and data.aging else ()
    moving = [t for t in trends if math.isfinite(t.remaining_median)]
    if moving:
        first = min(moving, key=lambda t: t.remaining_median)
        left = max(round(first.remaining_median), 0)
        text = f"in {count(left)} {esc(first.axis)}" if left else "reached"
        facts.append(("First service limit", text, f"{esc(first.parameter)}, median"))
    items = "".join(
        f"<div><dt>{name}</dt><dd>{value}<small>{note}</small></dd></div>"
        for name, value, note in facts
    )
    return f'<dl class="facts">{items}</dl>'


def _last_cycle(data: ReportData) -> str:
    prediction = data.prediction
    if prediction is None or len(prediction.stamp_ns) < 2:
        return "<h2>Last cycle</h2><p>No cycle with a prediction is in these data.</p>"
    legend = _legend(
        ("measured", "measured"),
        ("predicted", "one-step prediction from the measured past"),
        ("freerun", "free run: from the commands alone since the cycle began"),
        ("unused", "grey: nothing can be said (start, stop, stale or bad sample)"),
    )
    return (
        f"<h2>Last cycle: {prediction.cycle}</h2>{legend}"
        f'<figure class="scroll">{plot_cycle(prediction)}</figure>'
    )


def _parameters(data: ReportData) -> str:
    estimates = data.trend_estimates
    names = _shown_parameters(data)
    if not names or not estimates:
        return "<h2>Parameters over cycles</h2><p>No estimate is in these data.</p>"
    pairs = {}
    if data.assessment is not None and data.aging:
        both = zip(data.assessment.trends, data.assessment.details, strict=True)
        pairs = {t.parameter: (t, d) for t, d in both}
    figures = [
        _parameter_figure(data, name, estimates, *pairs.get(name, (None, None))) for name in names
    ]
    calibrated = any(math.isfinite(p.lower_95) for e in estimates for p in e.parameters)
    limits = (
        ("limits", "95 % limits of a single estimate")
        if calibrated
        else ("none", "limits of single estimates: not calibrated (fewer than 10 cycles)")
    )
    keys = [("estimate", "one cycle"), limits]
    if any(has_line(trend) for trend, _ in pairs.values()):
        keys += [
            ("trend", "trend"),
            ("mean", "95 % interval of the trend"),
            ("prediction", "95 % interval of the next estimate"),
            ("threshold", "service limit"),
            ("segment", "change found"),
        ]
        wild = any(d.wild.any() for _, d in pairs.values())
        keys += [("wild", "left out as an outlier")] if wild else []
    keys += [("service", "maintenance")] if data.maintenance and pairs else []
    states = {p.status for e in estimates for p in e.parameters if p.name in names}
    keys += [("atbound", "on its bound: a limit, not a measurement")] * (
        ParameterStatus.AT_BOUND in states
    )
    keys += [("refused", "refused")]
    title = "Parameters over cycles" + (f" ({data.label})" if data.label else "")
    return f'<h2>{esc(title)}</h2>{_legend(*keys)}<div class="pair">{"".join(figures)}</div>'


def _shown_parameters(data: ReportData) -> list[str]:
    if data.assessment is not None and data.aging:
        return [t.parameter for t in data.assessment.trends]
    published = dict.fromkeys(p.name for e in data.trend_estimates for p in e.parameters)
    followed = [p.name for p in data.parameters if p.trend and p.name in published]
    return followed or list(published)


def _parameter_figure(
    data: ReportData,
    name: str,
    estimates: tuple[Estimate, ...],
    trend: Trend | None,
    detail: TrendDetail | None,
) -> str:
    known = data.parameter(name)
    marks = Marks(trend, detail, data.maintenance if data.aging else ())
    axis = trend.axis if trend is not None else "cycle"
    if trend is not None:
        text = f"<b>{STATUS_WORDS[trend.status]}</b>: {esc(trend.reason)}"
    else:
        text = describe(known) if known else ""
    about = f"<small>{describe(known)}</small>" if known and trend else ""
    return (
        f"<figure><h3>{esc(name)}{unit(known.unit) if known else ''}{about}</h3><p>{text}</p>"
        f"{plot_parameter(name, estimates, marks, axis)}</figure>"
    )


def _life(data: ReportData) -> str:
    if not data.aging or data.assessment is None or not data.assessment.trends:
        return ""
    trends = data.assessment.trends
    sources = sorted({t.reference_source.replace("_", " ") for t in trends})
    return (
        "<h2>Remaining life</h2>"
        f"{life_table(trends)}"
        f'<p class="soft">"New" is the mean of the reference cycles ({esc(", ".join(sources))}). '
        "The remaining life follows the present trend line to the limit; its 95 % limits are "
        'those of Fieller and are widened for autocorrelation. "Unbounded" is an answer: the data '
        "do not exclude that the limit is never reached.</p>"
        f"{_maintenance(data)}"
    )


def _maintenance(data: ReportData) -> str:
    rows = maintenance_table(data)
    return f"<h2>Maintenance</h2>{rows}" if rows else ""


def _estimates(data: ReportData) -> str:
    shown = [e for e in data.estimates if e.estimator != FEATURES]
    accepted = [e.cycle for e in shown if e.status is not EstimateStatus.REFUSED]
    if not accepted:
        return ""
    last = [e for e in shown if e.cycle == max(accepted)]
    last.sort(key=lambda e: not e.used_by_trend)
    return f"<h2>Estimates of cycle {max(accepted)}</h2>{estimates_table(data, last)}"


def _refused(data: ReportData) -> str:
    return (
        "<h2>Refused cycles and parameters</h2>"
        f"{refused_cycles_table(data)}{refused_parameters_table(data)}"
    )


def _quality(data: ReportData) -> str:
    return f"<h2>Data quality</h2>{quality_table(data)}"


def _reading(data: ReportData) -> str:
    notes = "".join(f"<p>{esc(note)}</p>" for note in data.notes)
    return (
        f"<h2>How to read this page</h2>{notes}"
        "<p>Positions are shares of the stroke (0 = closed stop, 1 = open stop), commands shares "
        "of full scale; a parameter without a unit is dimensionless. All times are UTC unless "
        "the data's clock was not set.</p>"
        "<p>The free-run fit is 100 % for a perfect simulation and 0 % for one no better than "
        "the mean of the measurement. The model it tests was estimated from earlier cycles.</p>"
        "<p>An interval that is not calibrated is not shown: until 10 cycles tell how much "
        "estimates scatter, no honest one is known. A value on its bound is a limit and not a "
        "measurement, and no trend uses it. The valve is compared with its own past, never with "
        "other valves.</p>"
    )


def _footer(data: ReportData) -> str:
    versions = sorted({c.software for c in data.cycles if c.software})
    parts = [f"valve_twin {esc(data.version)}" if data.version else "valve_twin"]
    if data.written_ns:
        parts.append(f"written {when(data.written_ns)}")
    if versions and versions != [data.version]:
        parts.append(f"cycles computed by {esc(', '.join(versions))}")
    estimators = list(dict.fromkeys(e.estimator for e in data.estimates))
    if estimators:
        parts.append(f"estimators: {esc(', '.join(estimators))}")
    options = "; ".join(f"{k} = {v}" for k, v in sorted(data.options.items()))
    line = f"<p>Options: {esc(options)}.</p>" if options else ""
    return f"<footer><p>{'; '.join(parts)}.</p>{line}</footer>"


_KEYS = {
    "measured": '<path class="measured" d="M1 7H29"/>',
    "predicted": '<path class="measured" d="M1 7H29"/><path class="predicted" d="M1 7H29"/>',
    "freerun": '<path class="freerun" d="M1 7H29"/>',
    "unused": '<rect class="unused" width="30" height="14"/>',
    "estimate": '<path class="estimate" d="M15 7h0"/>',
    "atbound": '<path class="estimate" d="M15 7h0"/><path class="atbound" d="M15 7h0"/>',
    "limits": '<path class="limits" d="M15 0v14"/>',
    "trend": '<path class="trend" d="M1 7H29"/>',
    "mean": '<rect class="mean" y="2" width="30" height="10"/>',
    "prediction": '<rect class="prediction" y="0" width="30" height="14"/>',
    "threshold": '<path class="threshold" d="M1 7H29"/>',
    "segment": '<path class="segment" d="M15 0v14"/>',
    "service": '<path class="service" d="M15 0v14"/>',
    "wild": '<path class="wild" d="M12 4l6 6m-6 0l6 -6"/>',
    "refused": '<path class="refused" d="M15 6v8"/>',
}


def _legend(*keys: tuple[str, str]) -> str:
    items = "".join(
        "<li>"
        + (
            f'<svg viewBox="0 0 30 14" aria-hidden="true">{_KEYS[key]}</svg>'
            if key in _KEYS
            else ""
        )
        + f"{esc(text)}</li>"
        for key, text in keys
    )
    return f'<ul class="legend">{items}</ul>'
