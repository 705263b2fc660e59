# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The report page: one HTML file with everything in it, to be read, printed and filed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from valve_twin.core.aging.series import in_force
from valve_twin.core.aging.verdict import Outlook, VerdictKind, outlook
from valve_twin.core.faults.advice import FAILURE_MODES, advise
from valve_twin.core.types import EstimateStatus, ParameterStatus
from valve_twin.io.errors import ValveTwinError, unwritable
from valve_twin.io.history.tiers.extent import told
from valve_twin.io.whole import write_whole
from valve_twin.report.budget import budget_section
from valve_twin.report.faults import faults_section, operation_section, steps_section
from valve_twin.report.language.words import figures, whole_page
from valve_twin.report.plots import Marks, draws_laws, has_line, plot_cycle, plot_parameter
from valve_twin.report.signals import plot_signals
from valve_twin.report.tables import (
    STATUS_WORDS,
    estimates_table,
    life_table,
    quality,
    refused_cycles,
    refused_parameters,
    source_files,
)
from valve_twin.report.text import count, fixed, render

if TYPE_CHECKING:
    from markupsafe import Markup

    from valve_twin.core.aging.assess import TrendDetail
    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.types import Parameter
    from valve_twin.report.data import ReportData


class Light(NamedTuple):
    """The verdict at the top: class of the style sheet, one sentence, its evidence."""

    style: str
    word: str
    why: str = ""
    state: str = ""
    action: str = ""


class Figure(NamedTuple):
    """One parameter over cycles."""

    name: str
    known: Parameter | None
    trend: Trend | None
    state: str
    plot: Markup


_LIGHTS = {
    VerdictKind.OK: Light("ok", "Nothing has changed"),
    VerdictKind.VALVE: Light("bad", "The valve needs attention"),
    VerdictKind.COMMAND: Light("warn", "The command looks wrong, not the valve"),
    VerdictKind.SENSOR: Light("warn", "The sensor looks wrong, not the valve"),
    VerdictKind.SUPPLY: Light("warn", "The supply looks wrong, not the valve"),
    VerdictKind.NOT_ENOUGH_DATA: Light("unsure", "Not enough data for a verdict"),
    VerdictKind.NO_REFERENCE: Light("unsure", "Nothing to compare the valve with yet"),
    VerdictKind.RECORDING_UNUSABLE: Light("bad", "The recording cannot be used"),
}


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
    try:
        write_whole(target, render_report(data))
    except OSError as err:
        raise ValveTwinError(unwritable(target, err)) from err
    return target


def render_report(data: ReportData) -> str:
    """Return the page as HTML; the same data give the same bytes."""
    prediction = data.prediction
    seen = prediction is not None and len(prediction.stamp_ns) > 1
    pairs = _trends(data)
    page = render(
        "page.html",
        data=data,
        light=_light(data),
        facts=_facts(data),
        cycle_plot=plot_cycle(prediction) if prediction is not None and seen else "",
        signal_plot=_signal_plot(data),
        figures=_figures(data, pairs),
        legend_keys=_legend_keys(data, pairs),
        life=life_table([trend for trend, _ in pairs.values()]),
        faults=faults_section(data.assessment if data.aging else None),
        operation=operation_section(data.counters, data.events, data.stroke_due),
        steps=steps_section(data.steps),
        last=estimates_table(data),
        budget=budget_section(data.budget),
        refused_cycles=refused_cycles(data),
        refused_before=data.condensed_refused,
        source_files=source_files(data),
        refused_parameters=refused_parameters(data),
        quality=quality(data),
        condensed=told(data.condensed) if data.condensed else "",
        versions=sorted({c.software for c in data.cycles if c.software}),
    )
    return figures(whole_page(page, data.language), data.language)


def _signal_plot(data: ReportData) -> Markup | str:
    """Draw all signals of the last estimated cycle; empty without its samples."""
    if data.cycle is None or len(data.cycle.frames) < 2:
        return ""
    return plot_signals(data.cycle.frames.stamp_ns, data.signals)


def _trends(data: ReportData) -> dict[str, tuple[Trend, TrendDetail]]:
    """Return the trends to be shown, with what they were computed from, by parameter."""
    found = data.assessment if data.aging else None
    if found is None:
        return {}
    return {t.parameter: (t, d) for t, d in zip(found.trends, found.details, strict=True)}


def _light(data: ReportData) -> Light:
    if not data.aging:
        why = f"The cycles differ ({data.label}); what changes between them is not taken for wear."
        return Light("unsure", "No aging verdict", why)
    if data.assessment is None:
        return _LIGHTS[VerdictKind.NOT_ENOUGH_DATA]._replace(why="The trend was not assessed.")
    verdict = data.assessment.verdict
    advice = advise(verdict, data.assessment.trends)
    words = [f"NE 107: {advice.ne107.value}"]
    if advice.failure_mode:
        words.append(f"{advice.failure_mode} {FAILURE_MODES[advice.failure_mode]} (ISO 14224)")
    if advice.cause:
        words.append(f"probably {advice.cause}")
    light = _LIGHTS[verdict.kind]
    return light._replace(why=verdict.evidence, state="; ".join(words), action=advice.sentence)


def _facts(data: ReportData) -> list[tuple[str, str, str]]:
    """Return what stands in large figures: name, value, remark."""
    totals, lost = data.totals, data.totals.lost
    refused = f"{count(len(data.refused) + data.condensed_refused.cycles)} refused"
    if not data.condensed_refused.of_all:
        refused = f"at least {refused}"
    facts = [("Cycles", count(totals.cycles), refused)]
    used = [e for e in data.trend_estimates if e.status is not EstimateStatus.REFUSED]
    if used:
        fit, which = used[-1].fit_test, "test: model from the cycles before"
        if not math.isfinite(fit):
            fit, which = used[-1].fit_train, "training: model of this cycle itself"
        facts.append((f"Free-run fit, cycle {used[-1].cycle}", f"{fixed(fit, 1)} %", which))
    samples = totals.samples + lost
    rate = f"{fixed(100.0 * lost / samples, 2)} % of all" if samples else ""
    facts.append(("Samples lost", count(lost), rate))
    done = data.counters
    if done is not None and done.cycles:
        way = f"{count(round(done.strokes))} strokes of travel " if done.stroke > 0.0 else ""
        facts.append(("Movements", count(done.movements), f"{way}in {count(done.cycles)} cycles"))
    moving = [t for t, _ in _trends(data).values() if outlook(t).says_when]
    if moving:
        first = min(moving, key=lambda t: t.remaining_median)
        left = max(round(first.remaining_median), 0)
        reached = outlook(first) is Outlook.REACHED
        text = "reached" if reached else f"in {count(left)} {first.axis}"
        facts.append(("First service limit", text, f"{first.parameter}, median"))
    return facts


def parameter_figures(data: ReportData) -> list[Figure]:
    """Return the charts of the followed parameters over cycles."""
    return _figures(data, _trends(data))


def _figures(data: ReportData, pairs: dict[str, tuple[Trend, TrendDetail]]) -> list[Figure]:
    estimates = data.trend_estimates
    events = in_force(data.maintenance) if data.aging else ()
    figures = []
    for name in _shown_parameters(data) if estimates else ():
        trend, detail = pairs.get(name, (None, None))
        axis = trend.axis if trend is not None else "cycle"
        days = [c for c in data.condensates if c.parameter == name and c.usable]
        plot = plot_parameter(name, estimates, Marks(trend, detail, events, days), axis)
        state = STATUS_WORDS[trend.status] if trend is not None else ""
        figures.append(Figure(name, data.parameter(name), trend, state, plot))
    return figures


def _shown_parameters(data: ReportData) -> list[str]:
    if data.assessment is not None and data.aging:
        return [t.parameter for t in data.assessment.trends]
    published = dict.fromkeys(p.name for e in data.trend_estimates for p in e.parameters)
    followed = [p.name for p in data.parameters if p.trend and p.name in published]
    return followed or list(published)


def _legend_keys(
    data: ReportData, pairs: dict[str, tuple[Trend, TrendDetail]]
) -> list[tuple[str, str]]:
    """Return the marks of the charts that occur, each with its meaning."""
    names = _shown_parameters(data)
    values = [p for e in data.trend_estimates for p in e.parameters]
    calibrated = any(math.isfinite(p.lower_95) for p in values)
    line = any(has_line(trend) for trend, _ in pairs.values())
    laws = any(draws_laws(trend, detail) for trend, detail in pairs.values())
    outlier = line and any(detail.outlier.any() for _, detail in pairs.values())
    bound = any(p.status is ParameterStatus.AT_BOUND for p in values if p.name in names)
    none = "limits of single estimates: not calibrated (fewer than 10 cycles)"
    keys = [
        (True, "estimate", "one cycle"),
        (bool(data.condensates), "condensed", "least to greatest of condensed cycles"),
        (calibrated, "limits", "95 % limits of a single estimate"),
        (not calibrated, "none", none),
        (line, "trend", "trend"),
        (line, "mean", "95 % interval of the trend"),
        (line, "prediction", "95 % interval of the next estimate"),
        (laws, "laws", "laws of aging that the estimates allow, with their probability"),
        (line, "threshold", "service limit"),
        (line, "warning", "warning limit"),
        (line, "segment", "change found"),
        (outlier, "outlier", "left out as an outlier"),
        (bool(in_force(data.maintenance) and pairs), "service", "maintenance"),
        (bound, "atbound", "on its bound: a limit, not a measurement"),
        (True, "refused", "refused"),
    ]
    return [(key, text) for occurs, key, text in keys if occurs]
